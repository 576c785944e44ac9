# SPDX-License-Identifier: Apache-2.0
"""A recorded run as two boards would show it: what they say, and what their pins do.

Two things are changed. HELLO says that it comes from a DK, with the chip's identity and today's
protocol table. And edges are where the crystals' exact clocks put them, not on the microsecond
that the simulator rounds its pins to, which no analyser would see.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.recording import Recording, load
from hil.timesync.analysis import analyse
from hil.wire.messages import BY_NAME, ROLES
from tests.bench.virtual.disguise import Disguise

ROOT = Path(__file__).parents[3]
GRID_NS = 1500.0
"""The simulator's pins are late by less than this."""


@dataclass(frozen=True)
class Tape:
    """A run to be played back.

    Attributes:
        bursts: role -> (ns since the start, bytes), in order.
        edges: channel -> float64[n], ns since the start; each is a change of level.
        build_ids: role -> as HELLO says it.
        kconfig: role -> options that the image was built with.
        has_calibration: the firmware had a store of calibrations.
    """

    bursts: Mapping[str, list[tuple[int, bytes]]]
    edges: Mapping[str, NDArray[np.float64]]
    build_ids: Mapping[str, str]
    kconfig: Mapping[str, Mapping[str, Any]]
    has_calibration: bool


@cache
def tape(name: str, device_ids: tuple[int, int]) -> Tape:
    """A recording of ``fixtures/recordings`` on the boards with these chips."""
    return tape_of(load(ROOT / "fixtures/recordings" / name / "recording.mcap"), device_ids)


def tape_of(recording: Recording, device_ids: tuple[int, int]) -> Tape:
    """A recording of the simulated bench, on the boards with these chips."""
    manifests = recording.provenance.manifests
    ids = dict(zip(ROLES, device_ids, strict=True))
    return Tape(
        bursts={role: bursts(recording, role, ids[role]) for role in ROLES},
        edges={channel: edges(recording, channel) for channel in recording.edges.channels},
        build_ids={role: str(manifests[role]["build_id"]) for role in ROLES},
        kconfig={role: manifests[role]["kconfig"] for role in ROLES},
        has_calibration=bool(recording.decoded("leader").messages["cal_status"].size),
    )


def bursts(recording: Recording, role: str, device_id: int) -> list[tuple[int, bytes]]:
    """What the node said, and when, with its HELLO replaced."""
    decoded = recording.decoded(role)
    for message, came in decoded.messages.items():
        if came.size:
            then, now = decoded.table[message], BY_NAME[message]
            same = (then.id, then.fields, then.group) == (now.id, now.fields, now.group)
            assert same, f"{message} has changed since {recording.name} was recorded: record anew"
    stream, disguise = recording.serial[role], Disguise(device_id)
    ends = [*stream.block_offset.tolist()[1:], stream.data.size]
    blocks = zip(stream.block_t_ns_bench.tolist(), stream.block_offset.tolist(), ends, strict=True)
    return [(t_ns, disguise.feed(stream.data[a:b].tobytes())) for t_ns, a, b in blocks]


def edges(recording: Recording, channel: str) -> NDArray[np.float64]:
    """Changes of level of a pin, ns of true time."""
    times, _ = recording.edges.select(channel)
    grid = times.astype(np.float64)
    role, _, signal = channel.partition(".")
    sync = analyse(recording)
    if signal == "pulse":
        exact = sync.truth.clocks[role].true_ns(sync.pulses[role].compare_ticks_node)
    elif signal == "imu_int1":
        exact = recording.imu_truth[role].t_us_true * 1e3
    else:
        return grid
    exact = np.sort(exact)
    after = np.clip(np.searchsorted(exact, grid), 1, exact.size - 1)
    near = np.where(
        np.abs(exact[after] - grid) < np.abs(exact[after - 1] - grid),
        exact[after],
        exact[after - 1],
    )
    shift = np.where(np.abs(near - grid) < GRID_NS, near - grid, 0.0)
    # A pulse keeps its width: its end moves with its beginning.
    if signal == "pulse":
        shift[1::2] = shift[0::2][: shift[1::2].size]
    return np.sort(grid + shift)
