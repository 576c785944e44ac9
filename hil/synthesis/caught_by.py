# SPDX-License-Identifier: Apache-2.0
"""Which checks find each fault of a synthetic run; the tests hold every one of them to it."""

from __future__ import annotations

from typing import Final

ERROR: Final = {"sync.error_p99_ns", "sync.error_max_ns", "sync.error_rms_ns"}
MODEL_ERROR: Final = {
    "sync.model_error_p99_ns",
    "sync.model_error_max_ns",
    "sync.model_error_rms_ns",
}
EDGE_ERROR: Final = {"sync.edge_error_p99_ns", "sync.edge_error_max_ns"}
REFIT: Final = {"sync.model_vs_refit_p99_ns", "sync.skew_vs_refit_ppb"}
PULSES: Final = {"sync.pulses_missing", "sync.pulses_late", "sync.edges_alone"}
COMPARE: Final = {"sync.compare_to_edge_max_ns"}
SKEW: Final = {"sync.skew_error_ppb"}
CONVERTED: Final = {"imu.follower_at_leader.time_error_p99_ns"}
TIMING: Final = {
    f"imu.{role}.{name}"
    for role in ("leader", "follower")
    for name in ("rate_hz", "period_error_ppm", "time_jitter_us")
}
ROLES: Final = ("leader", "follower")
FOLLOWER_INT1: Final = {"imu.follower.int1_error_p99_us"}
LINE_DELAY: Final = {f"node.{role}.line_delay_s" for role in ROLES}
INT1: Final = {f"imu.{role}.int1_error_p99_us" for role in ROLES}
CAL: Final = (
    *("ready_s", "branch_wrong", "refusal_unsaid"),
    *("gyro_bias_error_dps", "boot_delta_error_dps"),
)
SAMPLES_WRONG: Final = {f"imu.{role}.truth_samples_wrong" for role in ROLES}
TRUTH_TIMES: Final = {
    f"imu.{r}.truth_{n}" for r in ROLES for n in ("time_error_us", "period_error_ppm")
}
CHECKSUMS: Final = {f"fifo.{role}.truth_crc_mismatches" for role in ROLES}
UNREAD: Final = {f"fifo.{role}.truth_slots_unread" for role in ROLES}
FIFO_RATE: Final = {f"fifo.{role}.rate_hz" for role in ROLES}
FIFO_LEVEL: Final = {f"fifo.{role}.level_max_share" for role in ROLES}
BUS: Final = {f"fifo.{role}.bus_occupancy" for role in ROLES}
DRIVER_ERRORS: Final = {
    f"fifo.{role}.{name}"
    for role in ROLES
    for name in (
        "overruns",
        "tag_gaps",
        "parity_errors",
        "config_changes",
        "short_reads",
        "bus_errors",
        "missed_edges",
        "edges_refused",
        "restarts",
    )
}
NEVER_LOCKED: Final = {
    *ERROR,
    *MODEL_ERROR,
    *EDGE_ERROR,
    *REFIT,
    *PULSES,
    *COMPARE,
    *SKEW,
    *CONVERTED,
    "sync.convergence_s",
    "sync.locked_share",
    "sync.model_age_max_s",
}

CAUGHT_BY: Final[dict[str, set[str]]] = {
    "wrong_skew_sign": {*ERROR, *MODEL_ERROR, *EDGE_ERROR, *REFIT, *SKEW, *CONVERTED},
    "late_captures": {
        *ERROR,
        *MODEL_ERROR,
        *EDGE_ERROR,
        *REFIT,
        *SKEW,
        *CONVERTED,
        "sync.pairs_wrong",
        "sync.one_way_bias_ns",
        "sync.pair_bias_ns",
        "sync.captures_without_edge",
    },
    "some_captures_late": {"sync.pairs_wrong", "sync.captures_without_edge"},
    "all_captures_late": {
        *EDGE_ERROR,
        *COMPARE,
        *CONVERTED,
        "imu.follower.truth_time_error_us",
    },
    "swapped_pair": {"sync.pairs_wrong"},
    "pairs_dropped": {"sync.pairs_used", "sync.pairs_dropped_share"},
    "no_pairs": {"sync.pairs_used", "sync.pairs_dropped_share", "sync.pairs_wrong"},
    "few_pairs": {"sync.pairs_used"},
    "no_states": NEVER_LOCKED,
    "states_pause": {"sync.model_age_max_s"},
    # Without a model no pulse ties INT1 to the nodes' clocks.
    "never_locked": {*NEVER_LOCKED, *INT1},
    "slow_lock": {"sync.convergence_s"},
    "lock_lost": {"sync.locked_share"},
    "model_jitter": {*MODEL_ERROR, "sync.model_vs_refit_p99_ns"},
    "pulse_jitter": {*ERROR, *EDGE_ERROR},
    "missing_pulses": {"sync.pulses_missing"},
    "no_pulses": {*ERROR, *EDGE_ERROR, *PULSES, *COMPARE, *INT1},
    "late_pulses": {"sync.pulses_late"},
    "lost_edge": {"sync.edges_alone", *COMPARE},
    "late_edges": {*EDGE_ERROR, *COMPARE, *FOLLOWER_INT1},
    "coarse_analyser": EDGE_ERROR,
    "wrap_not_extended": {
        *ERROR,
        *MODEL_ERROR,
        *EDGE_ERROR,
        *REFIT,
        *COMPARE,
        *SKEW,
        *CONVERTED,
        "sync.edges_alone",
        "sync.convergence_s",
        *TIMING,
        *TRUTH_TIMES,
        *SAMPLES_WRONG,
        *INT1,
        *CHECKSUMS,
        *UNREAD,
        "sync.wrap_errors",
        "sync.pairs_wrong",
        "sync.pair_bias_ns",
        "sync.captures_without_edge",
    },
    "other_phy_delay": {"sync.one_way_bias_ns"},
    "reconnect": {"sync.reconnects", "sync.locked_share"},
    "lost_frames": {"link.frames_lost"},
    "corrupted_frame": {"link.frame_crc_errors", "link.frames_lost", "link.noise_bytes"},
    "repeated_frame": {"link.frames_duplicated"},
    "short_frame": {"link.frames_malformed"},
    "noise": {"link.noise_bytes", "link.frame_crc_errors"},
    "dropped_batch": {"imu.leader.samples_lost", "imu.follower.samples_lost"},
    "repeated_batch": {
        "imu.leader.samples_duplicated",
        "imu.follower.samples_duplicated",
        "imu.follower_at_leader.samples_duplicated",
    },
    "swapped_batches": {
        "imu.leader.batches_out_of_order",
        "imu.follower.batches_out_of_order",
        "imu.follower_at_leader.batches_out_of_order",
    },
    "overrun": {
        "imu.leader.overruns",
        "imu.follower.overruns",
        "imu.follower_at_leader.overruns",
    },
    "no_batches": {
        "cal.follower.ready_s",
        "imu.follower.samples_lost",
        "imu.follower.samples_duplicated",
        "imu.follower.batches_out_of_order",
        "imu.follower.overruns",
        "imu.follower.rate_hz",
        "imu.follower.period_error_ppm",
        "imu.follower.time_jitter_us",
        "imu.follower_at_leader.samples_missing",
        "imu.follower_at_leader.samples_altered",
        "imu.follower_at_leader.latency_p99_ms",
        *CONVERTED,
        "imu.follower.restarts",
        "imu.follower.truth_time_error_us",
        "imu.follower.truth_period_error_ppm",
        "imu.follower.truth_samples_wrong",
        *FOLLOWER_INT1,
        "fifo.follower.truth_crc_mismatches",
        "fifo.follower.truth_slots_unread",
    },
    "wrong_period": {
        "imu.leader.period_error_ppm",
        "imu.leader.time_jitter_us",
        "imu.leader.truth_period_error_ppm",
        "imu.leader.int1_error_p99_us",
    },
    "wrong_rate": {"imu.leader.rate_hz", "fifo.leader.rate_hz"},
    "batch_time_jitter": {
        "imu.leader.time_jitter_us",
        "imu.leader.truth_time_error_us",
        "imu.leader.int1_error_p99_us",
        *CONVERTED,
    },
    "copy_lost": {
        "imu.follower_at_leader.samples_lost",
        "imu.follower_at_leader.samples_missing",
    },
    "copy_altered": {"imu.follower_at_leader.samples_altered"},
    "copy_not_converted": CONVERTED,
    "copy_stale": {"imu.follower_at_leader.latency_p99_ms"},
    "wrong_role": {"node.follower.hello_errors"},
    "wrong_build_id": {"node.leader.hello_errors"},
    "wrong_schema": {"node.leader.hello_errors"},
    # A boot restarts the sequence numbers too, which a changed uptime alone does not.
    "restart": {"node.leader.restarts", "node.follower.restarts", "link.frames_lost"},
    "fault_frame": {"node.leader.faults", "node.follower.faults"},
    "follower_dies": {"node.follower.silence_s", "sync.pulses_missing"},
    "leader_dies": {
        "node.leader.silence_s",
        "sync.pairs_used",
        "imu.follower_at_leader.samples_missing",
    },
    "radio_crc": {"link.radio_crc_errors"},
    "queue_full": {"link.tx_dropped"},
    "refused_payload": {"link.bad_payloads"},
    "batches_lost": {"link.batches_lost"},
    "line_full": {"link.uart_dropped"},
    "lost_blocks": {"link.recording_lost_blocks"},
    "cut_file": {"link.recording_cut"},
    "times_late": {*(f"imu.{role}.truth_time_error_us" for role in ROLES), *INT1},
    "hidden_loss": {*SAMPLES_WRONG, *CHECKSUMS},
    "swapped_samples": {*SAMPLES_WRONG, *CHECKSUMS},
    "wrong_checksum": CHECKSUMS,
    "samples_not_counted": {*FIFO_RATE, *CHECKSUMS, *UNREAD},
    "slow_counting": {*FIFO_RATE, *CHECKSUMS, *UNREAD},
    "driver_errors": DRIVER_ERRORS,
    "fifo_nearly_full": FIFO_LEVEL,
    "slow_bus": BUS,
    "no_fifo_stats": {*FIFO_RATE, *DRIVER_ERRORS, *FIFO_LEVEL, *BUS, *CHECKSUMS, *UNREAD},
    "no_system": {
        *LINE_DELAY,
        "fifo.leader.cpu_load",
        "fifo.follower.cpu_load",
        "link.uart_dropped",
    },
    "imu_restarts": {"imu.leader.restarts", "imu.follower.restarts"},
    "no_imu_truth": {*TRUTH_TIMES, *SAMPLES_WRONG, *CHECKSUMS, *UNREAD},
    "int1_late": INT1,
    "int1_silent": INT1,
    "cal_late": {f"cal.{role}.ready_s" for role in ROLES},
    "cal_never": {f"cal.{role}.{name}" for role in ROLES for name in CAL},
    "cal_branch": {
        f"cal.{role}.{name}" for role in ROLES for name in ("branch_wrong", "refusal_unsaid")
    },
    # The stream then is not what the chip measured, corrected by that bias.
    "cal_bias": {*SAMPLES_WRONG, *(f"cal.{role}.gyro_bias_error_dps" for role in ROLES)},
    "cal_delta": {f"cal.{role}.boot_delta_error_dps" for role in ROLES},
}
"""Fault -> exactly the measurements that must not pass."""
