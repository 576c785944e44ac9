# SPDX-License-Identifier: Apache-2.0
"""Lines ``time_us,raw_adc`` -> samples on one clock.

``time_us`` is the ESP32's clock of microseconds, 32 bits wide: it wraps every 71.6 min. The first
line, which may be half a line, and any more than :data:`STEP_MAX_US` away from the one before are
believed only when the next line follows on them: a lost digit then costs a line, while a pause or
a restart is seen as what it is.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError
from hil.recording import Recording

ROLE: Final = "stringpot"
"""Name of its stream in a recording."""
PERIOD_US: Final = 1000
WRAP_US: Final = 1 << 32
STEP_MAX_US: Final = 1_000_000
PAUSE_MAX_US: Final = 60_000_000
"""A longer step forward is a restart: the clock began anew at who knows what time."""
RAW_MAX: Final = 1 << 24
LINE_MAX: Final = 64
BYTES_MAX: Final = 1 << 29
PIECE: Final = 1 << 20


class StringPotError(HilError):
    """What a string pot sent, or a file about it, cannot be used."""


@dataclass(frozen=True, eq=False)
class Samples:
    """n samples.

    Attributes:
        t_us: int64[n], the ESP32's clock without its wraps; increasing within a run.
        raw: int64[n], as the converter gave it.
        run: int64[n], counts restarts; the times of different runs have nothing in common.
        lost: samples that the times say are missing.
        bad_lines: lines that are no sample.
    """

    t_us: NDArray[np.int64]
    raw: NDArray[np.int64]
    run: NDArray[np.int64]
    lost: int
    bad_lines: int

    def __len__(self) -> int:
        return len(self.t_us)

    @property
    def restarts(self) -> int:
        return int(self.run[-1]) if len(self) else 0


@dataclass
class Reader:
    """Takes lines as they come.

    Attributes:
        lost, bad_lines, restarts: so far.
    """

    lost: int = 0
    bad_lines: int = 0
    restarts: int = 0
    _last: int | None = None
    _now: int = 0
    _doubted: tuple[int, int] | None = None
    _t_us: array[int] = field(default_factory=lambda: array("q"))
    _raw: array[int] = field(default_factory=lambda: array("q"))
    _run: array[int] = field(default_factory=lambda: array("q"))

    def line(self, line: bytes) -> None:
        """Take one line, with or without its line end; headings are passed over."""
        text = line.strip()
        if not text or text.startswith((b"#", b"time_us")):
            return
        time, comma, raw = text.partition(b",")
        # isdigit of bytes takes ASCII digits alone.
        if not (comma and time.isdigit() and raw.isdigit() and len(text) <= LINE_MAX):
            self.bad_lines += 1
            return
        t, x = int(time), int(raw)
        if t >= WRAP_US or x > RAW_MAX:
            self.bad_lines += 1
        else:
            self._sample(t, x)

    def samples(self) -> Samples:
        """What has come so far."""
        t_us, raw, run = (np.array(c, np.int64) for c in (self._t_us, self._raw, self._run))
        return Samples(t_us, raw, run, self.lost, self.bad_lines)

    def take(self) -> Samples:
        """As :meth:`samples`, and forget them: what is counted while it comes in stays small."""
        found = self.samples()
        for column in (self._t_us, self._raw, self._run):
            del column[:]
        return found

    def _sample(self, t: int, x: int) -> None:
        if self._last is not None and 0 < (step := (t - self._last) % WRAP_US) <= STEP_MAX_US:
            self.bad_lines += self._doubted is not None
            self._doubted = None
            self._keep(t, x, self._now + step)
            return
        doubted, self._doubted = self._doubted, (t, x)
        if doubted is None:
            return
        if not 0 < (step := (t - doubted[0]) % WRAP_US) <= STEP_MAX_US:
            self.bad_lines += 1
            return
        # Two lines agree: it is the beginning, or the clock that jumped, or samples are missing.
        self._doubted = None
        begin = doubted[0]
        if self._last is not None:
            pause = (doubted[0] - self._last) % WRAP_US
            if 0 < pause <= PAUSE_MAX_US:
                begin = self._now + pause
            else:
                self.restarts += 1
                self._last = None
        self._keep(*doubted, begin)
        self._keep(t, x, begin + step)

    def _keep(self, t: int, x: int, now: int) -> None:
        if self._last is not None:
            self.lost += max(round((now - self._now) / PERIOD_US) - 1, 0)
        self._last, self._now = t, now
        self._t_us.append(now)
        self._raw.append(x)
        self._run.append(self.restarts)


def parse(lines: Iterable[bytes]) -> Samples:
    """The samples in these lines."""
    reader = Reader()
    for line in lines:
        reader.line(line)
    return reader.samples()


def of_recording(recording: Recording, role: str = ROLE) -> Samples:
    """The samples in the stream ``role`` of a recording.

    Raises:
        StringPotError: it has no such stream.
    """
    if role not in recording.roles:
        have = ", ".join(recording.roles) or "none"
        raise StringPotError(
            f"{recording.name}: no stream of '{role}', only {have}",
            "log one: hil stringpot log --port /dev/ttyUSB0",
        )
    data = recording.serial[role].data
    pieces = (data[at : at + PIECE].tobytes() for at in range(0, len(data), PIECE))
    return parse(_lines(pieces))


def of_csv(path: Path) -> Samples:
    """The samples in a text file of such lines, as any terminal program writes it.

    Raises:
        StringPotError: no such file, too large, or most of it is something else.
    """
    try:
        if path.stat().st_size > BYTES_MAX:
            raise StringPotError(f"{path}: larger than {BYTES_MAX >> 20} MiB", "cut it to the set")
        with path.open("rb") as stream:
            found = parse(_lines(iter(lambda: stream.read(PIECE), b"")))
    except OSError as error:
        raise StringPotError(f"{path}: {error.strerror}", "name a CSV file or a recording") from (
            error
        )
    if found.bad_lines > len(found):
        raise StringPotError(
            f"{path}: {found.bad_lines} lines are not time_us,raw_adc, and {len(found)} are",
            "name the raw log of a string pot",
        )
    return found


def _lines(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Lines of a stream; one without an end within a piece is cut, and so is no sample."""
    rest = b""
    for piece in pieces:
        *ended, rest = (rest + piece).split(b"\n")
        yield from ended
        rest = rest[:PIECE]
    yield rest
