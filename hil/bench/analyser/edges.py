# SPDX-License-Identifier: Apache-2.0
"""Level changes out of packed samples, piece by piece."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hil.bench.analyser.capture import Capture, CaptureEdges, Progress, Start, check_layout
from hil.errors import RecordingError

BLOCK_SAMPLES = 1 << 20
"""Small enough for the comparison of neighbours to stay in the processor's cache."""

CHANGES_MAX = 50_000_000
"""More than an hour of two nodes makes; a floating input at 8 MHz makes as many in 10 s."""

TEXT_CHANGES_MAX = 10_000_000
SAMPLE_MAX = 1 << 53

Scalar = TypeVar("Scalar", bound=np.generic)

Words = NDArray[np.unsignedinteger[Any]]

WORD: dict[int, np.dtype[Any]] = {
    1: np.dtype("<u1"),
    2: np.dtype("<u2"),
    4: np.dtype("<u4"),
    8: np.dtype("<u8"),
}


@dataclass(frozen=True)
class _Changes:
    """Samples in which any bit changed: their numbers, which bits changed, all bits after."""

    sample: NDArray[np.int64]
    changed: NDArray[np.uint64]
    after: NDArray[np.uint64]


class EdgeExtractor:
    """Takes pieces of a capture in order and keeps the changes.

    Args:
        channels: name -> bit; other bits are not looked at.
        unitsize: bytes of one sample.
        changes_max: bound on what is kept.
    """

    def __init__(
        self, channels: Mapping[str, int], unitsize: int, *, changes_max: int = CHANGES_MAX
    ) -> None:
        check_layout(1.0, channels, unitsize)
        self.samples = 0
        self._channels = dict(channels)
        self._unitsize = unitsize
        self._word = WORD[1 << (unitsize - 1).bit_length()]
        self._mask = sum(1 << bit for bit in channels.values())
        self._changes: list[_Changes] = []
        self._kept = 0
        self._changes_max = changes_max
        self._rest = b""
        self._last: Words | None = None
        self._first = 0
        self._differ = np.empty(BLOCK_SAMPLES, dtype=np.bool_)

    def feed(self, piece: bytes) -> None:
        """Take the next bytes; a sample may be cut between two pieces.

        Raises:
            RecordingError: more changes than a capture can have.
        """
        if self._rest:
            piece = self._rest + piece
        whole = len(piece) - len(piece) % self._unitsize
        self._rest = piece[whole:]
        step = BLOCK_SAMPLES * self._unitsize
        for begin in range(0, whole, step):
            block = memoryview(piece)[begin : min(begin + step, whole)]
            self._take(self._words(block))

    def finish(
        self,
        samplerate_hz: float,
        *,
        progress: Progress | None = None,
        start: Start | None = None,
    ) -> CaptureEdges:
        """The changes of each channel.

        Raises:
            RecordingError: no sample came, or the last one is cut.
        """
        if self._rest:
            raise RecordingError(
                f"the capture ends within a sample: {len(self._rest)} of {self._unitsize} bytes",
                "state the unit size that the analyser really uses",
            )
        if self.samples == 0:
            raise RecordingError("the capture is empty", "capture for longer")
        sample = _joined([c.sample for c in self._changes], np.int64)
        changed = _joined([c.changed for c in self._changes], np.uint64)
        after = _joined([c.after for c in self._changes], np.uint64)
        rows = [np.flatnonzero(changed & np.uint64(1 << b)) for b in self._channels.values()]
        row = np.concatenate(rows)
        channel = np.repeat(np.arange(len(rows), dtype=np.uint8), [r.size for r in rows])
        # Stable: simultaneous changes stay in the order of the channels.
        order = np.argsort(row, kind="stable")
        row, channel = row[order], channel[order]
        bits = np.array(list(self._channels.values()), dtype=np.uint64)
        return CaptureEdges(
            samplerate_hz=samplerate_hz,
            samples=self.samples,
            channels=tuple(self._channels),
            initial=((np.uint64(self._first) >> bits) & np.uint64(1)).astype(np.uint8),
            sample=sample[row],
            channel=channel,
            level=((after[row] >> bits[channel]) & np.uint64(1)).astype(np.uint8),
            progress=progress,
            start=start,
        )

    def _words(self, block: memoryview) -> Words:
        if self._unitsize == self._word.itemsize:
            words: Words = np.frombuffer(block, dtype=self._word)
            return words
        padded = np.zeros((len(block) // self._unitsize, self._word.itemsize), dtype=np.uint8)
        padded[:, : self._unitsize] = np.frombuffer(block, np.uint8).reshape(-1, self._unitsize)
        widened: Words = padded.view(self._word).reshape(-1)
        return widened

    def _take(self, words: Words) -> None:
        if self._last is None:
            self._first = int(words[0])
        elif words[0] != self._last[0]:
            self._keep(np.zeros(1, np.int64), self._last, words[:1])
        differ = np.not_equal(words[1:], words[:-1], out=self._differ[: words.size - 1])
        at = np.flatnonzero(differ)
        if at.size:
            self._keep(at + 1, words[at], words[at + 1])
        self._last = words[-1:].copy()
        self.samples += int(words.size)

    def _keep(
        self,
        at: NDArray[np.int64],
        before: Words,
        after: Words,
    ) -> None:
        changed = (before ^ after).astype(np.uint64) & np.uint64(self._mask)
        watched = changed != 0
        self._kept += int(np.count_nonzero(watched))
        if self._kept > self._changes_max:
            raise RecordingError(
                f"more than {self._changes_max} level changes in {self.samples + BLOCK_SAMPLES} "
                "samples: an input floats or its threshold lies in the noise",
                "connect the grounds of both boards with the analyser's\n"
                "set the threshold to half of the boards' VDD\n"
                "leave out channels with nothing connected",
            )
        self._changes.append(
            _Changes(
                (at + self.samples)[watched], changed[watched], after.astype(np.uint64)[watched]
            )
        )


def extract(capture: Capture, *, changes_max: int = CHANGES_MAX) -> CaptureEdges:
    """All level changes of a capture, which is read once.

    Raises:
        RecordingError: the capture is empty, cut, or has more changes than ``changes_max``.
    """
    extractor = EdgeExtractor(capture.channels, capture.unitsize, changes_max=changes_max)
    for piece in capture.pieces():
        extractor.feed(piece)
    return extractor.finish(capture.samplerate_hz)


class TimedChanges:
    """Takes changes that a text format lists by time, and puts them on the analyser's samples.

    Args:
        source: what error messages call the input.
        samplerate_hz: rate that the analyser sampled with, finer than ``tick_s`` or as fine.
        tick_s: unit that the times are written in.
    """

    def __init__(
        self, source: str, channels: Sequence[str], *, samplerate_hz: float, tick_s: float
    ) -> None:
        check_layout(samplerate_hz, {name: i for i, name in enumerate(channels[:64])}, 8)
        if len(set(channels)) != len(channels) or len(channels) > 64:
            raise RecordingError(f"{source}: more than 64 channels, or two of one name")
        self._source = source
        self._channels = tuple(channels)
        self._rate_hz = samplerate_hz
        self._scale = samplerate_hz * tick_s
        # Half a unit of the times, and a little for the arithmetic of the program that wrote them.
        self._off_grid_max = 0.02 + 0.5 * self._scale
        if self._off_grid_max >= 0.5:
            raise RecordingError(
                f"{source}: times in steps of {tick_s:g} s cannot tell samples at "
                f"{samplerate_hz:g} Hz apart",
                "export with finer times, or pass the rate really used as samplerate_hz=",
            )
        self._levels: list[int | None] = [None] * len(channels)
        self._initial = [0] * len(channels)
        self._sample, self._channel, self._level = array("q"), bytearray(), bytearray()
        self._end = 0

    def at(self, t_ticks: float, line: int) -> int:
        """Sample number of a time; times must not go back.

        Raises:
            RecordingError: it goes back, or lies between the samples of that rate.
        """
        exact = t_ticks * self._scale
        sample = round(exact)
        if abs(exact - sample) > self._off_grid_max:
            raise RecordingError(
                f"{self._source}: line {line}: a time lies {exact - sample:+.2f} samples beside "
                f"the samples at {self._rate_hz:g} Hz",
                "pass the rate that it was captured with, as samplerate_hz=",
            )
        if sample < self._end or sample > SAMPLE_MAX:
            raise RecordingError(
                f"{self._source}: line {line}: time goes back, or further than a capture lasts"
            )
        self._end = sample
        return sample

    def put(self, sample: int, channel: int, level: int, line: int) -> None:
        """A level from ``sample`` on; the same level again is no change.

        Raises:
            RecordingError: more changes than a text capture can have.
        """
        before, self._levels[channel] = self._levels[channel], level
        if before is None:
            self._initial[channel] = level
        elif before != level:
            if len(self._sample) >= TEXT_CHANGES_MAX:
                raise RecordingError(
                    f"{self._source}: line {line}: more than {TEXT_CHANGES_MAX} changes",
                    "keep such a capture as a sigrok session file (.sr)",
                )
            self._sample.append(sample)
            self._channel.append(channel)
            self._level.append(level)

    def finish(self) -> CaptureEdges:
        """The edges; the capture ends with the last time that was listed."""
        return CaptureEdges(
            samplerate_hz=self._rate_hz,
            samples=self._end + 1,
            channels=self._channels,
            initial=np.array(self._initial, dtype=np.uint8),
            sample=np.array(self._sample, dtype=np.int64),
            channel=np.frombuffer(bytes(self._channel), dtype=np.uint8),
            level=np.frombuffer(bytes(self._level), dtype=np.uint8),
        )


def renamed(edges: CaptureEdges, names: Mapping[str, str]) -> CaptureEdges:
    """The channels of ``names`` alone, by their new names: ``{"D0": "leader.pulse"}``.

    Raises:
        RecordingError: the capture has no such channel.
    """
    for name in names:
        edges.select(name)
    index = [edges.channels.index(name) for name in names]
    new = np.full(len(edges.channels), -1, dtype=np.int64)
    new[index] = np.arange(len(index))
    channel = new[edges.channel]
    kept = channel >= 0
    return replace(
        edges,
        channels=tuple(names.values()),
        initial=edges.initial[index],
        sample=edges.sample[kept],
        channel=channel[kept].astype(np.uint8),
        level=edges.level[kept],
    )


def _joined(parts: list[NDArray[Scalar]], dtype: type[Scalar]) -> NDArray[Scalar]:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=dtype)
