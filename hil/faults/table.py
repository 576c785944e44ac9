# SPDX-License-Identifier: Apache-2.0
"""Which check must catch which injected fault, and where that is proven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

FIXTURE: Final = "imu-rest"
"""Recording that the faults between source and recording are put into."""


@dataclass(frozen=True)
class Row:
    """One fault as it is written, and the checks that it must make fail.

    Attributes:
        inject: as on the command line.
        caught_by: measurements of which each must be bad; without the fault all pass.
        live: done to the firmware on the simulated radio, and proven in ``tests/firmware``.
    """

    inject: str
    caught_by: tuple[str, ...]
    live: bool = False


ROWS: Final[tuple[Row, ...]] = (
    Row("drop=1e-5", ("link.frames_lost", "link.frame_crc_errors", "ekf.core_mismatches")),
    Row("duplicate=1e-5", ("link.frames_lost", "link.frame_crc_errors")),
    Row("reorder=1e-5", ("link.frames_lost", "link.frame_crc_errors")),
    Row("corrupt=1e-5", ("link.frames_lost", "link.frame_crc_errors", "link.noise_bytes")),
    Row(
        "late:leader=0.5@15..20",
        ("node.leader.line_delay_s", "imu.follower_at_leader.latency_p99_ms"),
    ),
    Row("late:follower=0.5@15..20", ("node.follower.line_delay_s",)),
    Row(
        "missing-edges=0.01",
        ("sync.edge_error_max_ns", "sync.compare_to_edge_max_ns", "sync.captures_without_edge"),
    ),
    Row(
        "late-edges:follower.pulse=2e-5",
        ("sync.edge_error_p99_ns", "sync.compare_to_edge_max_ns"),
    ),
    Row(
        "analyser-drop=0.001@20",
        ("sync.compare_to_edge_max_ns", "sync.captures_without_edge"),
    ),
    Row("clock-jump=0.5@20", ("node.leader.line_delay_s", "node.follower.line_delay_s")),
    Row("clock-jump=-0.5@20", ("node.leader.line_delay_s", "node.follower.line_delay_s")),
    Row("swap", ("node.leader.hello_errors", "node.follower.hello_errors", "sync.error_p99_ns")),
    Row(
        "absent",
        ("node.follower.silence_s", "node.follower.hello_errors", "sync.error_p99_ns"),
    ),
    Row("reboot@20", ("node.follower.restarts", "imu.follower.restarts", "sync.wrap_errors")),
    Row(
        "absent",
        ("node.follower.silence_s", "node.follower.hello_errors", "sync.locked_share"),
        live=True,
    ),
    Row("storm=5@6..11", ("sync.reconnects",), live=True),
    Row("flash:leader=8", ("cal.leader.boot_delta_error_dps",), live=True),
)

_HERE: Final = "tests/unit/faults/test_other_checks.py"
_HOLD: Final = "tests/unit/test_imu.py::test_a_hold_that_is_not_obeyed_fails"
_FIFO: Final = "tests/unit/test_imu_fifo.py"
_REPS: Final = "tests/unit/firmware/test_reps_measures.py"

OTHERWISE: Final[Mapping[str, str]] = {
    r"cal\.leader\.early_estimates": f"{_HERE}::test_estimates_from_before_the_decision",
    r"ekf\.frames_per_step": f"{_HERE}::test_estimates_that_do_not_arrive",
    r"ekf\.float_.+": f"{_HERE}::test_single_precision_that_errs",
    r"ekf\.reference_error": (
        "tests/unit/test_fusion.py::test_the_reference_check_fails_on_a_changed_parameter"
    ),
    r"ekf\.(mean_velocity|peak_velocity|inclination)_rmse_.+|ekf\.repetitions_wrong|"
    r"ekf\.false_zupt_frames": f"{_HERE}::test_another_lift_than_was_estimated",
    r"ekf\.rep_.+": f"{_REPS}::test_right_frames_pass_and_wrong_ones_fail",
    r"imu\.follower_at_leader\.outage_s": f"{_HERE}::test_an_outage_that_lasts",
    r"imu\.follower_at_leader\.hold_exceeded_s": _HOLD,
    r"fifo\..+\.wake_to_sample_ms": f"{_FIFO}::test_a_rest_is_no_loss_of_rate_but_a_stall_is",
    r"fifo\..+\.fault_.+_detected": f"{_FIFO}::test_a_fault_is_detected_by_its_counters",
    r"fifo\..+\.fault_.+_recovery_s": f"{_HERE}::test_a_recovery_that_lasts",
}
"""Names of checks that neither table has, as a pattern -> the test that makes them fail."""
