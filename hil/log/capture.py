# SPDX-License-Identifier: Apache-2.0
"""The log itself: from open ports to recordings, until told to stop."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from hil.bench.port import SerialPort
from hil.errors import RecordingError
from hil.log.meter import NS_PER_S, Meter
from hil.log.parts import Parts, Rotation
from hil.log.source import Source, opened
from hil.recording import Event, Provenance

POLL_S: Final = 0.02
SHOW_NS: Final = 250_000_000
NOTES: Final = (
    "Logged from serial ports by hil log. The bench clock is the host's monotonic clock since the "
    "session began. No image was flashed for it, so there is no build manifest: what the nodes "
    "said of themselves is in the events 'hello'."
)


@dataclass
class Log:
    """A log as it stands.

    Attributes:
        t_ns: since the session began.
        ended: why, or empty while it goes on.
        gaps: role -> seconds without the port, one for each time that it was lost.
        away: roles whose port is lost just now.
    """

    meters: Mapping[str, Meter]
    parts: Parts
    t_ns: int = 0
    ended: str = ""
    gaps: dict[str, list[float]] = field(default_factory=dict)
    away: frozenset[str] = frozenset()


def capture(
    sources: Sequence[Source],
    output: Path,
    rotation: Rotation,
    *,
    stop: Callable[[], str],
    show: Callable[[Log], None],
    duration_s: float | None = None,
    meter: type[Meter] = Meter,
    notes: str = NOTES,
) -> Log:
    """Record what the ports say.

    Args:
        stop: looked at many times a second; a text ends the log, for that reason.
        show: called a few times a second, and at the end.
        meter: what counts a port's bytes.

    Raises:
        RigError: a port is not there, not permitted, or in use.
        RecordingError: the disk is full, or the file exists; what was written stays readable.
    """
    zero_ns = time.monotonic_ns()
    with opened(sources) as ports:
        _make_folder(output.parent)
        now_utc = datetime.now(UTC)
        session = now_utc.strftime("%Y%m%dT%H%M%S.%fZ")
        made = provenance(sources, now_utc, notes)
        parts = Parts(output, made, list(ports), rotation, session=session)
        log = Log({role: meter(role, 0) for role in ports}, parts)
        try:
            with parts:
                _run(log, ports, zero_ns, stop=stop, show=show, duration_s=duration_s)
        except RecordingError as error:
            raise _kept(error, log) from error
    show(log)
    return log


def _run(
    log: Log,
    ports: Mapping[str, SerialPort],
    zero_ns: int,
    *,
    stop: Callable[[], str],
    show: Callable[[Log], None],
    duration_s: float | None,
) -> None:
    shown_ns = 0
    while not log.ended:
        time.sleep(POLL_S)
        log.ended = stop()
        for role, port in ports.items():
            _listen(log, role, port, zero_ns)
        log.t_ns = time.monotonic_ns() - zero_ns
        log.away = frozenset(role for role, port in ports.items() if port.lost_ns is not None)
        log.parts.tick(log.t_ns)
        if not log.ended and duration_s is not None and log.t_ns >= duration_s * NS_PER_S:
            log.ended = f"{duration_s:g} s are over"
        if log.t_ns - shown_ns >= SHOW_NS:
            shown_ns = log.t_ns
            show(log)
    for role, port in ports.items():
        if port.lost_ns is not None:
            _write_gap(log, role, port.lost_ns - zero_ns, log.t_ns)


def _listen(log: Log, role: str, port: SerialPort, zero_ns: int) -> None:
    """Take what has come; gaps are written before the bytes that came behind them."""
    meter = log.meters[role]
    build = None if meter.hello is None else meter.hello["build_id"]
    taken: list[bytes] = []
    t_ns = log.t_ns
    for chunk in port.read(0.0):
        t_ns = chunk.t_ns_host - zero_ns
        if _ended_gaps(log, role, port, zero_ns, t_ns):
            meter.feed(t_ns, b"".join(taken))
            meter.interrupted()
            taken.clear()
        taken.append(chunk.data)
        log.parts.write(role, t_ns, chunk.data)
    if taken:
        meter.feed(t_ns, b"".join(taken))
    if _ended_gaps(log, role, port, zero_ns, time.monotonic_ns() - zero_ns):
        meter.interrupted()
    if meter.hello is not None and meter.hello["build_id"] != build:
        names = ("build_id", "device_id", "schema_hash")
        data = {name: f"{meter.hello[name]:016x}" for name in names}
        log.parts.event(Event(t_ns, "hello", role, data), remember=f"hello {role}")


def _ended_gaps(log: Log, role: str, port: SerialPort, zero_ns: int, until_ns: int) -> bool:
    """Write the gaps that have ended by ``until_ns``; whether there were any."""
    written = log.gaps.setdefault(role, [])
    ended = [g for g in port.gaps[len(written) :] if g.t_back_ns - zero_ns <= until_ns]
    for gap in ended:
        _write_gap(log, role, gap.t_lost_ns - zero_ns, gap.t_back_ns - zero_ns)
    return bool(ended)


def _write_gap(log: Log, role: str, t_lost_ns: int, t_back_ns: int) -> None:
    lasted_s = (t_back_ns - t_lost_ns) / NS_PER_S
    log.gaps.setdefault(role, []).append(lasted_s)
    log.parts.event(Event(t_lost_ns, "gap", role, {"lasted_s": round(lasted_s, 3)}))


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(
            f"{folder}: cannot be made: {error.strerror}", "name another place: -o FILE"
        ) from error


def _kept(error: RecordingError, log: Log) -> RecordingError:
    files = [path for path in log.parts.paths if path.exists() and path.stat().st_size]
    return RecordingError(
        f"{error.message}\nthe log ended {log.t_ns / NS_PER_S:.1f} s after its start; what was "
        f"written until then is readable: {', '.join(map(str, files)) or 'nothing'}",
        error.mend,
    )


def provenance(sources: Sequence[Source], now_utc: datetime, notes: str) -> Provenance:
    """Where a log comes from; no scenario, and no manifest, because none is known."""
    return Provenance(
        source="bench",
        created_utc=now_utc.isoformat(timespec="seconds"),
        tools={
            "hil": importlib.metadata.version("hil"),
            "Python": platform.python_version(),
        },
        host={
            "system": platform.system(),
            "machine": platform.machine(),
            "name": platform.node(),
            "ports": {s.role: {**s.what, "baud": s.baud} for s in sources},
        },
        notes=notes,
    )
