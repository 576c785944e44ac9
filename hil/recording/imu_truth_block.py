# SPDX-License-Identifier: Apache-2.0
"""Blocks of the simulated IMU's truth: packing, unpacking, and gathering on either side.

A slot is one sample instant of the chip. Its counts are kept as differences from slot to slot,
folded so that small ones of either sign are small numbers, low and high bytes apart: of noisy
counts zstd then makes 4 to 6 bytes a slot, of the counts themselves 11.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.recording.layout import LayoutError

AXES: Final = 6
SLOTS_PER_BLOCK: Final = 4096
SLOT_BYTES: Final = 13
TIME_ERROR_US: Final = 1e-3
"""A block is split where a straight line between its ends is further off than this."""
MAX_TIME_US: Final = float(1 << 50)
"""35 years; a float64 still tells a quarter of a microsecond apart."""
MAX_NUMBER: Final = (1 << 32) - 1

SCHEMA_IMU_TRUTH: Final = "hil.imu_truth_block.v1"
LAYOUT_IMU_TRUTH: Final = """\
What a simulated IMU sampled: consecutive slots of one run. Little-endian, unaligned:
  u32 slots             n
  u32 run               counts starts of sampling
  u32 first_slot        counts slots of the run
  f64 t_first_us_true   instant of the first slot, true time, us
  f64 t_last_us_true    of the last one; the slots between are evenly apart, to 1 ns
  u8  low[6][n]         for each axis, gyro xyz and accel xyz, in counts: with
  u8  high[6][n]          d = count - count of the slot before (0 before the first), modulo 2^16,
                          low + 256 high = (d << 1) ^ (0xFFFF if d >= 0x8000 else 0)
  u8  flags[n]          1 gyro settled, 2 accel settled, 4 clipped, 8 in FIFO
MCAP message.sequence counts the blocks of the channel from 0."""

_HEAD: Final = struct.Struct("<IIIdd")

U8 = NDArray[np.uint8]
I16 = NDArray[np.int16]
U32 = NDArray[np.uint32]
Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Slots:
    """Slots of a chip: arrays of one length n, ``counts`` of shape (n, 6)."""

    run: U32
    slot: U32
    t_us_true: Float
    counts: I16
    flags: U8

    def __len__(self) -> int:
        return int(self.slot.size)

    def part(self, start: int, end: int) -> Slots:
        cut = slice(start, end)
        return Slots(
            self.run[cut], self.slot[cut], self.t_us_true[cut], self.counts[cut], self.flags[cut]
        )


def slots(
    run: ArrayLike, slot: ArrayLike, t_us_true: ArrayLike, counts: ArrayLike, flags: ArrayLike
) -> Slots:
    """Checked arrays.

    Raises:
        ValueError: shapes that do not fit, a number outside its type, a time that is none.
    """
    t_us = np.asarray(t_us_true, dtype=np.float64)
    whole = {
        "run": (_whole(run, 0, MAX_NUMBER), np.uint32, t_us.shape),
        "slot": (_whole(slot, 0, MAX_NUMBER), np.uint32, t_us.shape),
        "counts": (_whole(counts, -(1 << 15), (1 << 15) - 1), np.int16, (*t_us.shape, AXES)),
        "flags": (_whole(flags, 0, 255), np.uint8, t_us.shape),
    }
    for name, (values, _, shape) in whole.items():
        if t_us.ndim != 1 or (values.shape != shape and t_us.size):
            raise ValueError(f"{name} has shape {values.shape} for {t_us.size} times")
    if not np.all(np.abs(t_us) <= MAX_TIME_US):
        raise ValueError("a time that is not finite, or beyond 35 years")
    # Copies: what the caller does with its arrays afterwards is no concern of the writer.
    n, k, c, f = (np.array(values, dtype=kind) for values, kind, _ in whole.values())
    return Slots(n, k, t_us.copy(), c.reshape(-1, AXES), f)


def _whole(values: ArrayLike, low: int, high: int) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"numbers of type {array.dtype} where whole ones are needed")
    if array.size and not low <= int(array.min()) <= int(array.max()) <= high:
        raise ValueError(f"a number outside {low} .. {high}")
    return array.astype(np.int64)


def spread(t_first_us: float, t_last_us: float, count: int) -> Float:
    """float64[count]: instants evenly from first to last."""
    step_us = (t_last_us - t_first_us) / max(count - 1, 1)
    return np.asarray(t_first_us + step_us * np.arange(count), dtype=np.float64)


def pack(s: Slots) -> bytes:
    """One block; the slots must be consecutive, of one run and evenly apart."""
    counts = s.counts.T.astype(np.uint16)
    step = np.diff(counts, axis=1, prepend=np.uint16(0))
    folded = (step << np.uint16(1)) ^ np.where(step >= 0x8000, 0xFFFF, 0).astype(np.uint16)
    head = _HEAD.pack(
        len(s), int(s.run[0]), int(s.slot[0]), float(s.t_us_true[0]), float(s.t_us_true[-1])
    )
    planes = ((folded & 0xFF).astype(np.uint8), (folded >> 8).astype(np.uint8))
    return b"".join((head, *(plane.tobytes() for plane in planes), s.flags.tobytes()))


def unpack(block: memoryview) -> Slots:
    """Inverse of :func:`pack`.

    Raises:
        LayoutError: sizes that do not fit, numbers beyond 32 bits, times that are none.
    """
    if len(block) < _HEAD.size:
        raise LayoutError(f"{len(block)} bytes are too few for a block of IMU truth")
    count, run, first_slot, t_first_us, t_last_us = _HEAD.unpack_from(block)
    if count == 0 or _HEAD.size + SLOT_BYTES * count != len(block):
        raise LayoutError(f"{count} slots do not fit a block of {len(block)} bytes")
    if first_slot + count - 1 > MAX_NUMBER:
        raise LayoutError(f"slot numbers from {first_slot} leave 32 bits")
    for t_us in (t_first_us, t_last_us):
        if not (math.isfinite(t_us) and abs(t_us) <= MAX_TIME_US):
            raise LayoutError("a time that is not finite, or beyond 35 years")
    if t_last_us < t_first_us or (count == 1 and t_last_us != t_first_us):
        raise LayoutError("its last instant does not fit its first")
    planes = np.frombuffer(block, np.uint8, 2 * AXES * count, _HEAD.size)
    low, high = planes.reshape(2, AXES, count).astype(np.uint16)
    folded = low | high << np.uint16(8)
    step = (folded >> np.uint16(1)) ^ (np.uint16(0) - (folded & np.uint16(1)))
    counts = np.cumsum(step, axis=1, dtype=np.uint16)
    return Slots(
        run=np.full(count, run, np.uint32),
        slot=(first_slot + np.arange(count, dtype=np.int64)).astype(np.uint32),
        t_us_true=spread(t_first_us, t_last_us, count),
        counts=np.ascontiguousarray(counts.T).view(np.int16),
        flags=np.frombuffer(block, np.uint8, count, _HEAD.size + 2 * AXES * count),
    )


def _is_even(t_us: Float) -> bool:
    line = spread(float(t_us[0]), float(t_us[-1]), t_us.size)
    return t_us[-1] >= t_us[0] and bool(np.max(np.abs(t_us - line)) <= TIME_ERROR_US)


def blocks(s: Slots) -> Iterator[Slots]:
    """``s`` in pieces that :func:`pack` can take, as long as they may be."""
    step = s.slot.astype(np.int64)[1:] - s.slot.astype(np.int64)[:-1]
    breaks = np.flatnonzero((step != 1) | (s.run[1:] != s.run[:-1])) + 1
    for start, end in zip([0, *breaks.tolist()], [*breaks.tolist(), len(s)], strict=True):
        at = start
        while at < end:
            size = min(SLOTS_PER_BLOCK, end - at)
            while size > 1 and not _is_even(s.t_us_true[at : at + size]):
                size //= 2
            yield s.part(at, at + size)
            at += size


@dataclass
class Pending:
    """Slots of one chip that wait for the writer to close a block."""

    parts: list[Slots] = field(default_factory=list)
    size: int = 0
    written: int = 0

    def add(self, s: Slots) -> None:
        self.parts.append(s)
        self.size += len(s)

    def take(self) -> Iterator[tuple[float, bytes]]:
        """First time in us and bytes of each block; nothing waits afterwards."""
        if not self.parts:
            return
        columns = zip(
            *((p.run, p.slot, p.t_us_true, p.counts, p.flags) for p in self.parts), strict=True
        )
        waiting = Slots(*(np.concatenate(column) for column in columns))
        self.written += self.size
        self.parts.clear()
        self.size = 0
        for block in blocks(waiting):
            yield float(block.t_us_true[0]), pack(block)


@dataclass
class Gathered:
    """What was read of one chip. Grows in place, however small the blocks of a file are."""

    run: bytearray = field(default_factory=bytearray)
    slot: bytearray = field(default_factory=bytearray)
    t_us_true: bytearray = field(default_factory=bytearray)
    counts: bytearray = field(default_factory=bytearray)
    flags: bytearray = field(default_factory=bytearray)

    def add(self, s: Slots) -> None:
        for name in ("run", "slot", "t_us_true", "counts", "flags"):
            getattr(self, name).extend(getattr(s, name).tobytes())

    def slots(self) -> Slots:
        def column(data: bytearray, kind: type[np.generic]) -> NDArray[np.generic]:
            # A read-only buffer, so that nobody can turn writing back on.
            return np.frombuffer(memoryview(data).toreadonly(), kind)

        return Slots(
            run=np.asarray(column(self.run, np.uint32), np.uint32),
            slot=np.asarray(column(self.slot, np.uint32), np.uint32),
            t_us_true=np.asarray(column(self.t_us_true, np.float64), np.float64),
            counts=np.asarray(column(self.counts, np.int16), np.int16).reshape(-1, AXES),
            flags=np.asarray(column(self.flags, np.uint8), np.uint8),
        )
