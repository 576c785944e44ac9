# SPDX-License-Identifier: Apache-2.0
"""Are the two clocks one clock? Limits: docs/error-budget.md, lines T, G, P, B, W."""

from __future__ import annotations

from tests.hil.conftest import Judge


def test_sync_error(judge: Judge) -> None:
    """Both nodes' pulses, programmed for one instant, in exact ticks on the true clocks."""
    judge("sync.error_p99_ns", "sync.error_max_ns", "sync.error_rms_ns")


def test_sync_model_between_updates(judge: Judge) -> None:
    """The firmware's clock model, anywhere between its updates, against the true clocks."""
    judge("sync.model_error_p99_ns", "sync.model_error_max_ns", "sync.model_error_rms_ns")


def test_sync_model_against_independent_fit(judge: Judge) -> None:
    """The firmware's clock model against a fit of the same pairs done apart from it."""
    judge("sync.model_vs_refit_p99_ns", "sync.skew_vs_refit_ppb")


def test_sync_edges_on_analyser(judge: Judge) -> None:
    """Both nodes' pulse edges, as something outside the firmware sees them."""
    judge(
        "sync.edge_error_p99_ns",
        "sync.edge_error_max_ns",
        "sync.edges_alone",
        "sync.compare_to_edge_max_ns",
    )


def test_skew(judge: Judge) -> None:
    judge("sync.skew_error_ppb")


def test_convergence(judge: Judge) -> None:
    judge("sync.convergence_s", "sync.locked_share")


def test_every_pulse_came(judge: Judge) -> None:
    judge("sync.pulses_missing", "sync.pulses_late")


def test_pairs_belong_together(judge: Judge) -> None:
    """No capture of one connection event is ever paired with that of another."""
    judge("sync.pairs_wrong", "sync.captures_without_edge")


def test_pairs_are_used(judge: Judge) -> None:
    judge("sync.pairs_used", "sync.pairs_dropped_share")


def test_radio_chain_delay(judge: Judge) -> None:
    """One-way bias is the radio's own; two ways cancel it."""
    judge("sync.one_way_bias_ns", "sync.pair_bias_ns")


def test_counters_wrap_unseen(judge: Judge) -> None:
    judge("sync.wrap_errors")


def test_reconnects(judge: Judge) -> None:
    judge("sync.reconnects")


def test_nothing_else_of_sync_is_wrong(judge: Judge) -> None:
    """Whatever the suite measures beside what is named above."""
    judge("sync.")
