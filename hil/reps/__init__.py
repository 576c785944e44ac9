# SPDX-License-Identifier: Apache-2.0
"""Repetitions of a set, from the estimated height and velocity of the bar's centre."""

from hil.reps.find import Figures, Repetition, RepetitionSet, repetitions
from hil.reps.trace import Trace, of_outputs, of_recording

__all__ = [
    "Figures",
    "Repetition",
    "RepetitionSet",
    "Trace",
    "of_outputs",
    "of_recording",
    "repetitions",
]
