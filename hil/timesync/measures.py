# SPDX-License-Identifier: Apache-2.0
"""The sync suite: every measurement of the time sync of one recording."""

from __future__ import annotations

from hil.measure import Measurement
from hil.recording import Recording
from hil.timesync import judge_models, judge_pairs, judge_pulses, judge_wires
from hil.timesync.analysis import Sync


def measure(recording: Recording, sync: Sync) -> list[Measurement]:
    """All measurements of the sync suite."""
    return [
        *judge_pulses.pulse_errors(sync),
        *judge_models.model_errors(sync),
        *judge_models.model_against_refit(sync),
        judge_models.convergence(sync),
        judge_models.locked(sync),
        judge_models.model_age(sync),
        *judge_pulses.edge_errors(recording, sync),
        *judge_wires.wire_errors(recording, sync),
        judge_pulses.compare_to_edge(recording, sync),
        *judge_pulses.pulse_counts(sync),
        *judge_pairs.pair_counts(sync),
        judge_pairs.one_way_bias(sync),
        judge_pairs.pair_bias(sync),
        judge_pairs.captures_without_edge(sync),
        judge_pairs.wrap_errors(recording, sync),
        judge_pairs.reconnects(recording, sync),
    ]
