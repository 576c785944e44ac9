# SPDX-License-Identifier: Apache-2.0
"""The faults of one run, between its source and its recording: reads and edges go through."""

from __future__ import annotations

import zlib
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.faults import pins, serial
from hil.faults.injection import ROLES, Injection
from hil.recording import Event

Read = tuple[str, int, bytes]
"""Role, bench time in ns, bytes."""
EdgeArrays = tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]
OTHER: Final = dict(zip(ROLES, reversed(ROLES), strict=True))


class Injector:
    """Applies injections in their order. Reads of a stream must come in the order of time.

    Kinds that are done to the nodes themselves change nothing here.

    Args:
        seed: of the scenario: the same run with the same seed has the same faults.
        edge_channels: names of the pins.
    """

    def __init__(
        self, injections: Sequence[Injection], seed: int, edge_channels: Sequence[str]
    ) -> None:
        self.injections = tuple(injections)
        self._stages = [
            _Stage(one, seed, number, tuple(edge_channels))
            for number, one in enumerate(self.injections)
        ]

    def serial(self, role: str, t_ns: int, data: bytes) -> Iterable[Read]:
        """What arrives in place of one read."""
        reads: list[Read] = [(role, t_ns, data)]
        for stage in self._stages:
            reads = [out for read in reads for out in stage.serial(*read)]
        return reads

    def edges(self, t_ns: Any, channel: Any, level: Any) -> EdgeArrays:
        """What is seen in place of these edges."""
        edges: EdgeArrays = (
            np.asarray(t_ns, dtype=np.int64),
            np.asarray(channel, dtype=np.uint8),
            np.asarray(level, dtype=np.uint8),
        )
        for stage in self._stages:
            edges = stage.edges(*edges)
        return edges

    def events(self) -> list[Event]:
        """What was done, as events of the recording: one for each injection."""
        return [
            Event(
                stage.injection.from_ns,
                "inject",
                stage.injection.stream.partition(".")[0],
                {**stage.injection.to_mapping(), "changed": dict(stage.changed)},
            )
            for stage in self._stages
        ]


class _Stage:
    """One injection at work."""

    def __init__(
        self, injection: Injection, seed: int, number: int, channels: tuple[str, ...]
    ) -> None:
        self.injection = injection
        self.changed: Counter[str] = Counter()
        self._channels = channels
        self._key = (seed, injection.seed, number)
        self._generators: dict[str, np.random.Generator] = {}
        self._behind: deque[tuple[int, bytes]] = deque()
        self._last_ns: dict[str, int] = {}

    def serial(self, role: str, t_ns: int, data: bytes) -> list[Read]:  # noqa: PLR0911 (a case each)
        one = self.injection
        if one.kind == "swap":
            self.changed["reads"] += 1
            return [(OTHER.get(role, role), t_ns, data)]
        if not one.covers(role):
            return [(role, t_ns, data)]
        if one.kind == "reboot":
            return self._rebooted(role, t_ns, data)
        if not one.from_ns <= t_ns < one.to_ns:
            # Bytes of one line keep their order: behind late ones, all are late.
            return [(role, max(t_ns, self._last_ns.get(role, t_ns)), data)]
        if one.kind in serial.CHANGES:
            change = serial.CHANGES[one.kind]
            found, hits = change(self._rng(role), np.frombuffer(data, np.uint8), one.value)
            self.changed["bytes"] += hits
            return [(role, t_ns, found.tobytes())]
        match one.kind:
            case "late":
                self.changed["bytes"] += len(data)
                t_ns += round(one.value * 1e9)
                self._last_ns[role] = t_ns
            case "clock-jump":
                self.changed["reads"] += 1
                t_ns += round(one.value * 1e9)
            case "absent":
                self.changed["bytes"] += len(data)
                return []
        return [(role, t_ns, data)]

    def _rebooted(self, role: str, t_ns: int, data: bytes) -> list[Read]:
        """As sent until the power fails; later on what it sent in the run's first moments."""
        one = self.injection
        shift_ns = one.from_ns + round(one.value * 1e9)
        self._behind.append((t_ns + shift_ns, data))
        if t_ns < one.from_ns:
            return [(role, t_ns, data)]
        self.changed["reads"] += 1
        found: list[Read] = []
        while self._behind and self._behind[0][0] <= t_ns:
            found.append((role, *self._behind.popleft()))
        return found

    def edges(
        self, t_ns: NDArray[np.int64], channel: NDArray[np.uint8], level: NDArray[np.uint8]
    ) -> EdgeArrays:
        one = self.injection
        if one.kind == "swap":
            self.changed["edges"] += t_ns.size
            return t_ns, self._swapped()[channel], level
        meant = np.array([one.covers(name) for name in self._channels], dtype=bool)[channel]
        inside = meant & (t_ns >= one.from_ns) & (t_ns < one.to_ns)
        seen = np.ones(t_ns.size, dtype=bool)
        match one.kind:
            case "missing-edges":
                for number, name in enumerate(self._channels):
                    own = channel == number
                    if one.covers(name):
                        seen[own] = pins.missing(self._rng(name), t_ns[own], inside[own], one.value)
            case "late-edges":
                t_ns = pins.late(t_ns, inside, one.value)
                self.changed["edges"] += int(inside.sum())
            case "analyser-drop":
                t_ns, seen = pins.analyser_drop(t_ns, one.from_ns, one.value)
                self.changed["edges"] += int(inside.sum()) - int((~seen).sum())
            case "clock-jump":
                t_ns = pins.late(t_ns, inside, one.value)
                self.changed["edges"] += int(inside.sum())
            case "absent" | "reboot":
                # What it would do on its pins after a boot, nobody can know.
                seen = ~inside
        self.changed["edges"] += int((~seen).sum())
        return t_ns[seen], channel[seen], level[seen]

    def _swapped(self) -> NDArray[np.uint8]:
        """uint8[channels]: index of the pin that each is taken for."""
        names = list(self._channels)
        taken = []
        for number, name in enumerate(names):
            role, _, pin = name.partition(".")
            other = f"{OTHER.get(role, role)}.{pin}"
            taken.append(names.index(other) if other in names else number)
        return np.array(taken, dtype=np.uint8)

    def _rng(self, stream: str) -> np.random.Generator:
        if stream not in self._generators:
            key = (*self._key, zlib.crc32(f"{self.injection.kind}:{stream}".encode()))
            self._generators[stream] = np.random.default_rng(key)
        return self._generators[stream]
