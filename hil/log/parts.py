# SPDX-License-Identifier: Apache-2.0
"""A log over several recordings: a new one when the last is long or large enough.

All have one clock, that of the session. Between two, the stream of each port is cut where a frame
has ended and another begins, so that every frame is whole in one of them and every byte in exactly
one; the event ``joint`` of each but the first says how many bytes went before it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from hil.errors import RecordingError
from hil.recording import Event, Provenance, Writer

BYTES_MAX: Final = 1 << 30
"""Bytes of the ports in one recording: half of what ``hil.recording.load`` takes by default."""
WAIT_NS: Final = 500_000_000
"""How long a joint waits for the end of a frame, then as long for the end of a line."""
IDLE_FLUSH_NS: Final = 500_000_000


@dataclass(frozen=True)
class Rotation:
    """When a new file begins; None: never for that reason."""

    after_ns: int | None = None
    file_bytes: int | None = None

    @property
    def wanted(self) -> bool:
        return self.after_ns is not None or self.file_bytes is not None


@dataclass
class _Port:
    """One port: its last byte, how many there were, and how many of them ``before`` the joint;
    ``behind`` it, bytes go to the new file."""

    last: int = -1
    bytes: int = 0
    before: int = 0
    behind: bool = True


class Parts:
    """Writes a log; a context manager.

    Args:
        path: of the first file; with a rotation, ``name.mcap`` becomes ``name-0001.mcap``, ….
        provenance: of each file.
        roles: of the ports.
        bytes_max: bytes of the ports after which a new file begins in any case.

    Raises:
        RecordingError: from every method: a file exists, or cannot be written. What was written
            before stays readable.
    """

    def __init__(
        self,
        path: Path,
        provenance: Provenance,
        roles: list[str],
        rotation: Rotation,
        *,
        session: str,
        bytes_max: int = BYTES_MAX,
    ) -> None:
        self.paths: list[Path] = []
        self._path = path
        self._provenance = provenance
        self._rotation = rotation
        self._session = session
        self._bytes_max = bytes_max
        self._ports = {role: _Port() for role in roles}
        self._old: Writer | None = None
        self._due_ns = 0
        self._written_ns: int | None = None
        self._remembered: dict[str, Event] = {}
        self._new = self._open(0)

    def __enter__(self) -> Parts:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, traceback: object) -> None:
        self.close("" if kind is None else f"{kind.__name__}: {error}"[:500])

    @property
    def path(self) -> Path:
        """The file that is written now."""
        return self.paths[-1]

    def file_bytes(self) -> int:
        """On the disk, of all files."""
        return sum(map(_size, self.paths))

    def write(self, role: str, t_ns: int, data: bytes) -> None:
        """Append what one read of the port of ``role`` brought."""
        port = self._ports[role]
        self._written_ns = t_ns
        if not port.behind and self._old is not None:
            at = _joint(port.last, data, t_ns - self._due_ns)
            self._put(self._old, role, t_ns, data[: len(data) if at is None else at])
            data = b"" if at is None else data[at:]
            port.behind, port.before = at is not None, port.bytes
        if port.behind:
            self._put(self._new, role, t_ns, data)

    def event(self, event: Event, *, remember: str = "") -> None:
        """Append an event; ``remember`` is a key by which it is repeated in each later file."""
        self._new.write_event(event)
        if remember:
            self._remembered[remember] = event

    def tick(self, t_ns: int) -> None:
        """Begin or end what is due at ``t_ns``; to be called several times a second."""
        if self._old is not None:
            late = t_ns - self._due_ns > 2 * WAIT_NS
            if late or all(port.behind for port in self._ports.values()):
                self._join()
        elif self._due(t_ns):
            self._old, self._due_ns = self._new, t_ns
            self._new = self._open(t_ns)
            for port in self._ports.values():
                port.behind = False
        if self._written_ns is not None and t_ns - self._written_ns > IDLE_FLUSH_NS:
            self._written_ns = None
            self._new.flush()

    def close(self, aborted: str = "") -> None:
        """Complete every file that is open. Safe to repeat."""
        try:
            if self._old is not None:
                self._join(aborted)
        finally:
            self._new.close(aborted)

    def _join(self, aborted: str = "") -> None:
        assert self._old is not None
        old, self._old = self._old, None
        for port in self._ports.values():
            port.before = port.before if port.behind else port.bytes
            port.behind = True
        before = {role: port.before for role, port in self._ports.items()}
        self._new.write_event(Event(self._due_ns, "joint", "", {"bytes_before": before}))
        old.close(aborted)

    def _put(self, writer: Writer, role: str, t_ns: int, data: bytes) -> None:
        if data:
            writer.write_serial(role, t_ns, data)
            self._ports[role].last = data[-1]
            self._ports[role].bytes += len(data)

    def _due(self, t_ns: int) -> bool:
        r = self._rotation
        return (
            (r.after_ns is not None and t_ns - self._began_ns >= r.after_ns)
            or (r.file_bytes is not None and _size(self.path) >= r.file_bytes)
            or sum(p.bytes for p in self._ports.values()) - self._began_bytes >= self._bytes_max
        )

    def _open(self, t_ns: int) -> Writer:
        number = len(self.paths) + 1
        path = self._path
        if self._rotation.wanted or number > 1:
            path = path.with_name(f"{path.stem}-{number:04d}{path.suffix}")
        note = f"{self._provenance.notes} Part {number} of the session {self._session}."
        writer = Writer(
            path,
            replace(self._provenance, notes=note),
            roles=list(self._ports),
            edge_channels=(),
            edge_resolution_ns=0.0,
        )
        self.paths.append(path)
        self._began_ns = t_ns
        self._began_bytes = sum(port.bytes for port in self._ports.values())
        data: dict[str, Any] = {"session": self._session, "number": number}
        data["previous"] = self.paths[-2].name if number > 1 else ""
        writer.write_event(Event(t_ns, "part", "", data))
        for event in self._remembered.values():
            writer.write_event(replace(event, t_ns_bench=t_ns))
        return writer


def _size(path: Path) -> int:
    # A file that somebody removed while it is written has no size any more.
    return path.stat().st_size if path.exists() else 0


def _joint(last: int, data: bytes, waited_ns: int) -> int | None:
    """Where in ``data``, which follows the byte ``last``, a new file may begin; None: not here."""
    # A frame has a 00 of its own on both ends: between two of them nothing is cut.
    before = bytes([last]) if last >= 0 else b""
    at = (before + data).find(b"\0\0")
    if at < 0 and waited_ns > WAIT_NS:
        at = (before + data).find(b"\n")
    if at >= 0:
        return at + 1 - len(before)
    return 0 if waited_ns > 2 * WAIT_NS else None


def plain_name(path: Path) -> Path:
    """``path`` as the name of a recording: it ends in .mcap.

    Raises:
        RecordingError: it ends in something else.
    """
    if path.suffix == "":
        return path.with_name(path.name + ".mcap")
    if path.suffix != ".mcap":
        raise RecordingError(
            f"{path}: a log is kept as an MCAP file", f"-o {path.with_suffix('.mcap')}"
        )
    return path
