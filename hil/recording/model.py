# SPDX-License-Identifier: Apache-2.0
"""What a recording is, once in memory: immutable streams on one clock, and where they come from.

The bench clock is int64 nanoseconds from the start of the run: true simulated time on the
simulated bench, the analyser's and host's clock on a real one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.errors import RecordingError
from hil.recording.clock import ClockModel
from hil.wire.codec import Decoded, decode
from hil.wire.messages import ROLES, WireError, schema, schema_hash

SOURCES: Final = ("sim", "bench", "synthetic", "import")

EDGE_CHANNELS: Final = (
    "leader.radio_end",
    "leader.pulse",
    "follower.radio_end",
    "follower.pulse",
    "leader.imu_int1",
    "follower.imu_int1",
)

IMU_TRUTH_FLAGS: Final[Mapping[str, int]] = {
    "gyro_settled": 1,
    "accel_settled": 2,
    "clipped": 4,
    "in_fifo": 8,
}


def frozen(values: ArrayLike, dtype: Any) -> NDArray[Any]:
    """A read-only view of ``values`` as a contiguous one-dimensional array of ``dtype``."""
    array = np.ascontiguousarray(values, dtype=dtype).reshape(-1).view()
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class SerialStream:
    """Everything one serial port delivered.

    Attributes:
        data: uint8[n], the bytes in order; lost blocks leave no bytes here.
        block_offset: int64[b], where each read begins in ``data``; ascending.
        block_t_ns_bench: int64[b], when each read returned.
        gap_offset: int64[g], offsets in ``data`` before which recorded bytes were lost.
        gap_bytes: int64[g], how many.
    """

    data: NDArray[np.uint8]
    block_offset: NDArray[np.int64]
    block_t_ns_bench: NDArray[np.int64]
    gap_offset: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    gap_bytes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", frozen(self.data, np.uint8))
        for name in ("block_offset", "block_t_ns_bench", "gap_offset", "gap_bytes"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))
        if len(self.block_offset) != len(self.block_t_ns_bench):
            raise RecordingError("a serial stream has not as many block times as block offsets")
        if len(self.data) and (not len(self.block_offset) or self.block_offset[0] != 0):
            raise RecordingError("the first block of a serial stream does not begin at offset 0")

    def t_ns_bench(self, offsets: ArrayLike) -> NDArray[np.int64]:
        """When the bytes at ``offsets`` of ``data`` had been read, int64, shape of ``offsets``.

        A byte was on the line no later than this: the read that brought it returned then.

        Raises:
            IndexError: an offset outside ``data``.
        """
        wanted = np.asarray(offsets, dtype=np.int64)
        if wanted.size and (wanted.min() < 0 or wanted.max() >= len(self.data)):
            raise IndexError(f"offset outside a serial stream of {len(self.data)} bytes")
        block = np.searchsorted(self.block_offset, wanted, side="right") - 1
        return np.asarray(self.block_t_ns_bench[block], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Edges:
    """Level changes of the observed pins, ascending in time.

    Attributes:
        t_ns_bench: int64[n].
        channel: uint8[n], index into ``channels``.
        level: uint8[n], level after the edge.
        channels: names such as ``leader.pulse``.
        resolution_ns: width of the grid that the times lie on.
    """

    t_ns_bench: NDArray[np.int64]
    channel: NDArray[np.uint8]
    level: NDArray[np.uint8]
    channels: tuple[str, ...]
    resolution_ns: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "t_ns_bench", frozen(self.t_ns_bench, np.int64))
        object.__setattr__(self, "channel", frozen(self.channel, np.uint8))
        object.__setattr__(self, "level", frozen(self.level, np.uint8))
        if not len(self.t_ns_bench) == len(self.channel) == len(self.level):
            raise RecordingError("edges need as many times as channels and levels")

    def select(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Times, ns on the bench clock, and levels of the edges of one channel.

        Raises:
            RecordingError: no such channel.
        """
        if name not in self.channels:
            raise RecordingError(
                f"no edge channel '{name}' in this recording",
                "channels: " + (", ".join(self.channels) or "none"),
            )
        chosen = self.channel == self.channels.index(name)
        return frozen(self.t_ns_bench[chosen], np.int64), frozen(self.level[chosen], np.uint8)


@dataclass(frozen=True, eq=False)
class ImuTruth:
    """What the simulated IMU of one node sampled, slot by slot; a slot is one sample instant.

    Attributes:
        run: uint32[n], counts starts of sampling; slots of different runs have nothing in common.
        slot: uint32[n], counts slots of the run, in the FIFO or not.
        t_us_true: float64[n], instant of the sample, true simulated time, us.
        counts: int16[n, 6], gyro x y z, accel x y z.
        flags: uint8[n], bits of :data:`IMU_TRUTH_FLAGS`.
    """

    run: NDArray[np.uint32]
    slot: NDArray[np.uint32]
    t_us_true: NDArray[np.float64]
    counts: NDArray[np.int16]
    flags: NDArray[np.uint8]

    def __post_init__(self) -> None:
        object.__setattr__(self, "run", frozen(self.run, np.uint32))
        object.__setattr__(self, "slot", frozen(self.slot, np.uint32))
        object.__setattr__(self, "t_us_true", frozen(self.t_us_true, np.float64))
        object.__setattr__(self, "flags", frozen(self.flags, np.uint8))
        counts = frozen(self.counts, np.int16)
        n = len(self.slot)
        if not len(self.run) == len(self.t_us_true) == len(self.flags) == n == len(counts) / 6:
            raise RecordingError("the truth of an IMU needs as many times as slots and counts")
        object.__setattr__(self, "counts", counts.reshape(-1, 6))

    def __len__(self) -> int:
        return int(self.slot.size)

    def has(self, flag: str) -> NDArray[np.bool_]:
        """bool[n]: slots with this flag of :data:`IMU_TRUTH_FLAGS` set."""
        return np.asarray((self.flags & IMU_TRUTH_FLAGS[flag]) != 0, dtype=bool)


@dataclass(frozen=True)
class Event:
    """Something that happened to the run: a reset, a flash, a fault injected, a note."""

    t_ns_bench: int
    kind: str
    node: str
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Provenance:
    """Where a recording comes from: enough to repeat the run.

    Attributes:
        source: one of :data:`SOURCES`.
        created_utc: ISO 8601.
        scenario: as :func:`hil.scenario.to_mapping` gives it.
        manifests: role -> build manifest of the image that ran.
        schema: the protocol table that the streams were written with.
        schema_hash: its hash, 16 hex digits.
        tools: program or package -> version.
        host: what is known of the machine.
        notes: free text.
    """

    source: str
    created_utc: str
    scenario: Mapping[str, Any] = field(default_factory=dict)
    manifests: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    schema: Mapping[str, Any] = field(default_factory=schema)
    schema_hash: str = field(default_factory=lambda: f"{schema_hash():016x}")
    tools: Mapping[str, Any] = field(default_factory=dict)
    host: Mapping[str, Any] = field(default_factory=dict)
    notes: str = ""

    def __post_init__(self) -> None:
        for item in fields(self):
            text = item.name in ("source", "created_utc", "schema_hash", "notes")
            if not isinstance(getattr(self, item.name), str if text else Mapping):
                kind = "text" if text else "a mapping"
                raise RecordingError(f"provenance: '{item.name}' is not {kind}")
        if self.source not in SOURCES:
            raise RecordingError(
                f"provenance: source {self.source!r} is unknown", "sources: " + ", ".join(SOURCES)
            )
        if not all(isinstance(manifest, Mapping) for manifest in self.manifests.values()):
            raise RecordingError("provenance: a build manifest is not a mapping")

    @property
    def injected(self) -> tuple[str, ...]:
        """Kinds of the faults that were injected on purpose, as the scenario names them."""
        listed = self.scenario.get("inject") or ()
        if not isinstance(listed, list | tuple):
            return ("faults",)
        return tuple(
            str(one.get("kind", "fault"))[:40] if isinstance(one, Mapping) else "fault"
            for one in listed
        )

    def to_mapping(self) -> dict[str, Any]:
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Provenance:
        """Inverse of :meth:`to_mapping`; keys it does not know are left out.

        Raises:
            RecordingError: a key is missing or has the wrong type.
        """
        known = [item.name for item in fields(cls)]
        missing = [name for name in known if name not in data]
        if missing:
            raise RecordingError("provenance: missing " + ", ".join(missing))
        return cls(**{name: data[name] for name in known})


@dataclass(frozen=True)
class Integrity:
    """What was found wrong with the file.

    Attributes:
        complete: the run ended by itself, its recording was closed, every block that was
            written was read, and the file ends as it should. ``False`` means "up to a point".
        problems: one sentence each; a complete file can still have some, e.g. a clock that
            went back or a byte changed outside the blocks.
        lost_blocks: blocks known to be missing or unusable; a cut loses blocks that nobody
            can count, and then ``complete`` is False.
        blocks: blocks read and used.
    """

    complete: bool
    problems: tuple[str, ...] = ()
    lost_blocks: int = 0
    blocks: int = 0


@dataclass(frozen=True, eq=False)
class Recording:
    """A whole run.

    ``path`` is None when it was never in a file. ``imu_truth`` maps role to what its simulated
    IMU sampled; roles of which nothing is known are left out.
    """

    provenance: Provenance
    serial: Mapping[str, SerialStream]
    edges: Edges
    events: tuple[Event, ...]
    integrity: Integrity
    path: Path | None = None
    imu_truth: Mapping[str, ImuTruth] = field(default_factory=dict)
    _decoded: dict[str, Decoded] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "serial", MappingProxyType(dict(self.serial)))
        object.__setattr__(self, "events", tuple(self.events))
        object.__setattr__(self, "imu_truth", MappingProxyType(dict(self.imu_truth)))

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles whose serial port was recorded, whether or not it said anything."""
        return tuple(self.serial)

    @property
    def name(self) -> str:
        """The file's name, or its folder's when the file is just ``recording.mcap``.

        With faults injected they are part of it: no view can take such a run for a clean one.
        """
        name = str(self.provenance.scenario.get("name", self.provenance.source))
        if self.path is not None:
            stem = self.path.stem
            name = self.path.absolute().parent.name if stem == "recording" else stem
        return " + ".join([name, *self.provenance.injected])

    @property
    def truth(self) -> Mapping[str, ClockModel]:
        """Role -> the clock it was simulated with; empty when nobody can know.

        Raises:
            RecordingError: the scenario in the provenance does not describe clocks.
        """
        scenario = self.provenance.scenario
        if self.provenance.source not in ("sim", "synthetic") or not scenario:
            return {}
        nodes = scenario.get("nodes", {})
        if not isinstance(nodes, Mapping):
            raise RecordingError("the scenario in the provenance has no table of nodes")
        # A node that the scenario leaves out runs on a perfect clock, as the simulator does it.
        return {role: ClockModel.from_mapping(nodes.get(role, {})) for role in ROLES}

    def decoded(self, role: str) -> Decoded:
        """The serial stream of ``role``, decoded by the table embedded in the recording.

        Decoded once and kept.

        Raises:
            RecordingError: no such role, or the embedded table is not a protocol table.
        """
        if role not in self._decoded:
            if role not in self.serial:
                raise RecordingError(
                    f"{self.name}: no serial stream of '{role}'",
                    "roles in this recording: " + (", ".join(self.roles) or "none"),
                )
            try:
                self._decoded[role] = decode(self.serial[role].data, self.provenance.schema)
            except WireError as error:
                raise RecordingError(
                    f"{self.name}: the embedded protocol table cannot be used: {error}",
                    "record the run again",
                ) from error
        return self._decoded[role]
