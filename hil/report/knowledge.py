# SPDX-License-Identifier: Apache-2.0
"""What a source can and cannot tell. A report says both before anyone relies on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

SUMMARY: Final[Mapping[str, str]] = {
    "sim": "The firmware is the real one, compiled for a simulated nRF52833; radio, crystals, "
    "timers and the logic analyser are models. A pass shows that the firmware's logic and "
    "arithmetic are right. It says nothing about silicon.",
    "bench": "Two real boards, timed by a logic analyser.",
    "synthetic": "No firmware ran: the streams were computed, to test the checks themselves.",
    "import": "Recorded by something other than this rig; its clocks and limits are taken on "
    "trust.",
}
"""One or two sentences for the head of a run, by source."""

CANNOT_TELL: Final[Mapping[str, tuple[str, ...]]] = {
    "sim": (
        "Jitter of the radio's END event on silicon. The simulated radio has none; until it is "
        "measured on boards, the real sync error has a part that no figure here contains.",
        "The one-way delay of real radios. The model's is fixed at 5.00 µs on 2M PHY and 9.00 µs "
        "on 1M; silicon is near 5.6 µs and 10.0 µs. The two-way exchange cancels it only as far "
        "as both chips are alike.",
        "Times finer than the simulator's 1 µs grid. TIMER ticks come in steps of 16, and GPIO "
        "edges are floored to 1 µs; a figure well below that rests on averaging over drift.",
        "Real crystals: temperature, ageing, start-up. Drift and wander are those that the "
        "scenario asked for.",
        "Whether the 32 MHz crystal stays on between events. The model's TIMER never falls back "
        "to the RC oscillator.",
        "Processor time. Code runs in no simulated time, so interrupt latency, missed captures "
        "under load, processor load and stack use are not those of the chip.",
        "Antennas, interference and other people's radios. Packet loss follows a model of "
        "attenuation.",
        "Buses and lines: the serial line and SPI are lossless and take no time of their own.",
    ),
    "bench": (
        "The clock of the logic analyser is taken as true; its own error adds to every interval "
        "between edges.",
    ),
    "synthetic": ("Anything about firmware or hardware: the data came from a formula.",),
    "import": (
        "Whether the recording's clocks were what it says they were.",
        "Anything that did not come along: of bare samples, only they, their rate and their gaps "
        "are judged; sync, link, FIFO and boot check have no value.",
    ),
}
"""What no figure from a source can show, by source."""
