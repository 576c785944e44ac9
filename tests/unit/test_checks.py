# SPDX-License-Identifier: Apache-2.0
"""Every check can fail, and does so for its own fault and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil import checks
from hil.measure import Measurement, Verdict
from hil.recording import Recording
from hil.synthesis import FAULTS, Plan, save, synthesise

PLAN = Plan(duration_s=14.0)

ERROR = {"sync.error_p99_ns", "sync.error_max_ns", "sync.error_rms_ns"}
MODEL_ERROR = {"sync.model_error_p99_ns", "sync.model_error_max_ns", "sync.model_error_rms_ns"}
EDGE_ERROR = {"sync.edge_error_p99_ns", "sync.edge_error_max_ns"}
REFIT = {"sync.model_vs_refit_p99_ns", "sync.skew_vs_refit_ppb"}
PULSES = {"sync.pulses_missing", "sync.pulses_late", "sync.edges_alone"}
COMPARE = {"sync.compare_to_edge_max_ns"}
SKEW = {"sync.skew_error_ppb"}
CONVERTED = {"imu.follower_at_leader.time_error_p99_ns"}
TIMING = {
    f"imu.{role}.{name}"
    for role in ("leader", "follower")
    for name in ("rate_hz", "period_error_ppm", "time_jitter_us")
}
ROLES = ("leader", "follower")
FOLLOWER_INT1 = {"imu.follower.int1_error_p99_us"}
INT1 = {f"imu.{role}.int1_error_p99_us" for role in ROLES}
CAL = (
    *("ready_s", "branch_wrong", "refusal_unsaid"),
    *("gyro_bias_error_dps", "boot_delta_error_dps"),
)
SAMPLES_WRONG = {f"imu.{role}.truth_samples_wrong" for role in ROLES}
TRUTH_TIMES = {f"imu.{r}.truth_{n}" for r in ROLES for n in ("time_error_us", "period_error_ppm")}
CHECKSUMS = {f"fifo.{role}.truth_crc_mismatches" for role in ROLES}
UNREAD = {f"fifo.{role}.truth_slots_unread" for role in ROLES}
FIFO_RATE = {f"fifo.{role}.rate_hz" for role in ROLES}
FIFO_LEVEL = {f"fifo.{role}.level_max_share" for role in ROLES}
BUS = {f"fifo.{role}.bus_occupancy" for role in ROLES}
DRIVER_ERRORS = {
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
NEVER_LOCKED = {
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

CAUGHT_BY: dict[str, set[str]] = {
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
    "no_system": {"fifo.leader.cpu_load", "fifo.follower.cpu_load", "link.uart_dropped"},
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


@pytest.fixture(scope="module")
def clean() -> Recording:
    return synthesise(PLAN)


def bad(measurements: list[Measurement]) -> dict[str, Verdict]:
    return {m.name: m.verdict for m in measurements if m.verdict is not Verdict.PASS}


def test_every_fault_is_in_the_table() -> None:
    assert set(CAUGHT_BY) == set(FAULTS)


def test_every_check_is_caught_failing_by_some_fault(clean: Recording) -> None:
    names = {m.name for m in checks.evaluate(clean)}
    assert names == set().union(*CAUGHT_BY.values())


@pytest.mark.parametrize("fault", CAUGHT_BY)
def test_fault_is_caught_by_its_checks_and_no_other(fault: str) -> None:
    found = bad(checks.evaluate(synthesise(PLAN, [fault])))
    assert set(found) == CAUGHT_BY[fault], FAULTS[fault].meaning
    worst = Verdict.INCONCLUSIVE if fault == "coarse_analyser" else Verdict.FAIL
    assert set(found.values()) == {worst}


@pytest.mark.parametrize(
    "plan",
    [
        PLAN,
        Plan(duration_s=30.0, conn_interval_us=30_000, seed=5),
        Plan(duration_s=20.0, loss=0.04, seed=6),
        Plan(duration_s=20.0, conn_interval_us=30_000, loss=0.04, seed=7),
        Plan(duration_s=14.0, phy=1, delay_us=9.0),
    ],
    ids=["7.5 ms", "30 ms", "lossy", "lossy 30 ms", "1M"],
)
def test_sound_run_passes_everything(plan: Plan) -> None:
    assert bad(checks.evaluate(synthesise(plan))) == {}


def test_verdicts_are_the_same_live_and_replayed(clean: Recording, tmp_path: Path) -> None:
    """Written to a file and read back, a run is judged by the same numbers."""
    for number, recording in enumerate((clean, synthesise(PLAN, ["swapped_pair"]))):
        replayed = save(recording, tmp_path / f"{number}.mcap")
        before = {m.name: m for m in checks.evaluate(recording)}
        after = {m.name: m for m in checks.evaluate(replayed)}
        assert list(before) == list(after)
        for name, m in before.items():
            # A file keeps the chip's own times to 1 ns, everything else to the bit.
            exact = "truth_time" not in name and "truth_period" not in name
            assert after[name].value == (m.value if exact else pytest.approx(m.value, abs=2e-3))
            assert after[name].verdict is m.verdict


def test_suites_partition_the_list(clean: Recording) -> None:
    suites = checks.evaluate_suites(clean)
    assert tuple(suites) == checks.SUITES
    for name, measurements in suites.items():
        assert measurements == checks.suite(clean, name)
        # No firmware ran, so there is no estimator to judge.
        assert {checks.suite_of(m) for m in measurements} == ({name} - {"ekf"})
    everything = [m.name for m in checks.evaluate(clean)]
    assert len(everything) == len(set(everything))
    with pytest.raises(ValueError, match="no suite 'motion'"):
        checks.suite(clean, "motion")


def test_every_measurement_says_how_and_cites_a_line(clean: Recording) -> None:
    for m in checks.evaluate(clean):
        assert len(m.how) > 20, m.name
        assert m.budget, m.name
        assert m.to_json()["verdict"] == "pass"


def test_unknown_fault_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown fault 'gremlins'"):
        synthesise(PLAN, ["gremlins"])
