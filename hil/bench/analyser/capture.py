# SPDX-License-Identifier: Apache-2.0
"""What an analyser saw: packed samples, and the level changes in them.

A sample number counts the analyser's own clock from its first sample. The samples stay packed and
come in pieces; only their changes are ever held whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hil.errors import RecordingError

UNITSIZE_MAX = 8


@dataclass(frozen=True)
class Start:
    """When the first sample was taken, on the host's monotonic clock.

    Attributes:
        t_ns_host: middle of the interval that it lies in.
        uncertainty_ns: half the width of that interval.
    """

    t_ns_host: int
    uncertainty_ns: int


@dataclass(frozen=True, eq=False)
class Progress:
    """How a live capture arrived.

    Attributes:
        t_ns_host: int64[m], when a piece had been read, host's monotonic clock.
        samples: int64[m], samples that had come by then.
    """

    t_ns_host: NDArray[np.int64]
    samples: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CaptureEdges:
    """Level changes of the channels of a capture, ascending in time.

    Attributes:
        samplerate_hz: nominal rate of the analyser's clock.
        samples: length of the capture.
        channels: names, such as ``leader.pulse``.
        initial: uint8[c], level of each channel in the first sample.
        sample: int64[n], number of the first sample with the new level.
        channel: uint8[n], index into ``channels``.
        level: uint8[n], level after the change.
        progress: how it arrived; None of a file.
        start: when it began; None of a file.
    """

    samplerate_hz: float
    samples: int
    channels: tuple[str, ...]
    initial: NDArray[np.uint8]
    sample: NDArray[np.int64]
    channel: NDArray[np.uint8]
    level: NDArray[np.uint8]
    progress: Progress | None = None
    start: Start | None = None

    def __len__(self) -> int:
        return int(self.sample.size)

    @property
    def duration_s(self) -> float:
        """Length by the analyser's own clock."""
        return self.samples / self.samplerate_hz

    def select(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Sample numbers and levels of the changes of one channel.

        Raises:
            RecordingError: no such channel.
        """
        if name not in self.channels:
            raise RecordingError(
                f"the capture has no channel '{name}'",
                "channels: " + (", ".join(self.channels) or "none"),
            )
        chosen = self.channel == self.channels.index(name)
        return self.sample[chosen], self.level[chosen]


@dataclass(frozen=True, eq=False)
class Capture:
    """Packed samples: ``unitsize`` bytes each, little-endian, one bit a channel.

    Attributes:
        samplerate_hz: nominal rate of the analyser's clock.
        channels: name -> bit.
        unitsize: bytes of one sample, 1 to 8.
        pieces: gives the samples from the start, as often as it is called, in pieces of any
            length.
    """

    samplerate_hz: float
    channels: Mapping[str, int]
    unitsize: int
    pieces: Callable[[], Iterator[bytes]]

    def __post_init__(self) -> None:
        check_layout(self.samplerate_hz, self.channels, self.unitsize)


def check_layout(samplerate_hz: float, channels: Mapping[str, int], unitsize: int) -> None:
    """Hold the description of a capture against what samples can be.

    Raises:
        RecordingError: a rate, unit size or bit that no capture has.
    """
    if not 0 < samplerate_hz <= 1e12:
        raise RecordingError(
            f"a capture at {samplerate_hz:g} Hz cannot be", "state the rate as samplerate_hz="
        )
    if not 1 <= unitsize <= UNITSIZE_MAX:
        raise RecordingError(
            f"samples of {unitsize} bytes cannot be read", f"1 to {UNITSIZE_MAX} are possible"
        )
    if not channels:
        raise RecordingError("a capture needs a channel", "name at least one: name -> bit")
    for name, bit in channels.items():
        if not 0 <= bit < 8 * unitsize:
            raise RecordingError(
                f"channel '{name}' is bit {bit}, but samples have {8 * unitsize} bits",
                f"bits are 0 to {8 * unitsize - 1}",
            )
    if len(set(channels.values())) != len(channels):
        raise RecordingError("two channels share a bit", "give each channel a bit of its own")


class Analyser(Protocol):
    """A logic analyser that captures from ``start()`` to ``stop()``."""

    @property
    def channels(self) -> tuple[str, ...]: ...

    @property
    def samplerate_hz(self) -> float: ...

    def start(self, archive: Path | None = None) -> None:
        """Capture until :meth:`stop`; keep the capture itself at ``archive``."""

    def stop(self) -> CaptureEdges:
        """End the capture and give its edges.

        Raises:
            RigError: the capture did not come, came short, or ended by itself.
        """

    def close(self) -> None:
        """Let go of the analyser; a running capture is thrown away."""
