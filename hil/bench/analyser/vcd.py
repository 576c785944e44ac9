# SPDX-License-Identifier: Apache-2.0
"""Value change dumps (IEEE 1364-2005, section 18), as most analysers and simulators export them.

Read here rather than by a library: what is wanted is one-bit channels, in bounded memory, with
the number of the line that is wrong.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from hil.bench.analyser.capture import CaptureEdges
from hil.bench.analyser.edges import TimedChanges
from hil.bench.analyser.lines import numbered
from hil.errors import RecordingError, printable

LINE_BYTES_MAX = 1 << 16
VARIABLES_MAX = 4096
SCOPES_MAX = 64
NAME_MAX = 256
"""Names are joined with those of all scopes around them: together these bound what that takes."""
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15}

Token = tuple[int, str]
"""Line and word."""


def read_vcd(path: Path, *, samplerate_hz: float) -> CaptureEdges:
    """The one-bit variables of a dump.

    Levels ``x`` and ``z`` are allowed until a variable has its first level.

    Args:
        samplerate_hz: rate that the analyser sampled with; the file's own unit of time is often
            finer and says nothing about it.

    Raises:
        RecordingError: not a dump, cut in its header, no one-bit variable, times that go back or
            do not fit the rate.
    """
    tokens = _tokens(path)
    tick_s, variables = _header(path, tokens)
    changes = TimedChanges(
        str(path), list(variables.values()), samplerate_hz=samplerate_hz, tick_s=tick_s
    )
    index = {code: i for i, code in enumerate(variables)}
    known = [False] * len(index)
    sample = 0
    for line, word in tokens:
        kind = word[0]
        if kind == "#":
            sample = changes.at(_integer(path, line, word[1:]), line)
            continue
        if kind in "01xXzZ":
            value, code = kind, word[1:]
        elif kind in "bBrR":
            value = word[1:] if kind in "bB" else ""
            code = next(tokens, (line, ""))[1]
        elif kind == "$":
            _skip_keyword(path, line, word, tokens)
            continue
        else:
            raise _bad(path, line, f"'{word[:20]}' is no value change")
        channel = index.get(code)
        if channel is None:
            continue
        if value in ("0", "1"):
            known[channel] = True
            changes.put(sample, channel, int(value), line)
        elif known[channel]:
            raise _bad(path, line, f"a level {value[:8]!r}, where 0 or 1 was before")
    return changes.finish()


def _tokens(path: Path) -> Iterator[Token]:
    for number, line in numbered(path, LINE_BYTES_MAX, _bad):
        for word in line.decode("latin-1").split():
            yield number, word


def _header(path: Path, tokens: Iterator[Token]) -> tuple[float, dict[str, str]]:
    """Unit of time in s, and the one-bit variables: code -> name."""
    tick_s = 0.0
    scope: list[str] = []
    named: dict[str, list[str]] = {}
    line = 0
    for line, word in tokens:
        if not word.startswith("$"):
            raise _bad(path, line, f"'{word[:20]}' where the header should be")
        if word == "$enddefinitions":
            _body(path, line, tokens)
            break
        body = _body(path, line, tokens)
        if word == "$timescale":
            tick_s = _timescale(path, line, "".join(body))
        elif word == "$scope":
            scope.append(body[-1] if body else "")
            if len(scope) > SCOPES_MAX or len(scope[-1]) > NAME_MAX:
                what = f"more than {SCOPES_MAX} nested scopes, or a name of over {NAME_MAX} bytes"
                raise _bad(path, line, what)
        elif word == "$upscope":
            del scope[-1:]
        elif word == "$var":
            _declare(path, line, body, scope, named)
    else:
        raise _bad(path, line, "the header does not end: the file is cut, or no dump")
    if tick_s == 0.0:
        raise _bad(path, line, "no $timescale")
    if not named:
        raise _bad(path, line, "no variable of one bit")
    short = [full[-1] for full in named.values()]
    return tick_s, {
        code: full[-1] if short.count(full[-1]) == 1 else ".".join(full)
        for code, full in named.items()
    }


def _declare(
    path: Path, line: int, body: list[str], scope: list[str], named: dict[str, list[str]]
) -> None:
    if len(body) < 4:
        raise _bad(path, line, "a $var without type, size, code and name")
    if len(named) >= VARIABLES_MAX:
        raise _bad(path, line, f"more than {VARIABLES_MAX} variables")
    _, size, code, name = body[:4]
    if len(name) > NAME_MAX:
        raise _bad(path, line, f"a name of over {NAME_MAX} bytes")
    if size == "1":
        named.setdefault(code, [*scope, name])


def _body(path: Path, line: int, tokens: Iterator[Token]) -> list[str]:
    body: list[str] = []
    for _, word in tokens:
        if word == "$end":
            return body
        # Comments may be long; nothing after the first words matters.
        if len(body) < 16:
            body.append(word)
    raise _bad(path, line, "a section without $end: the file is cut, or no dump")


def _skip_keyword(path: Path, line: int, word: str, tokens: Iterator[Token]) -> None:
    if word == "$comment":
        _body(path, line, tokens)
    elif word not in ("$dumpvars", "$dumpall", "$dumpon", "$dumpoff", "$end"):
        raise _bad(path, line, f"'{word[:20]}' among the value changes")


def _timescale(path: Path, line: int, text: str) -> float:
    match = re.fullmatch(r"(1|10|100)([munpf]?s)", text)
    if match is None:
        raise _bad(path, line, f"a $timescale {text[:20]!r}")
    return int(match[1]) * SECONDS[match[2]]


def _integer(path: Path, line: int, text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,20}", text):
        raise _bad(path, line, f"a time '{text[:24]}'")
    return int(text)


def _bad(path: Path, line: int, what: str) -> RecordingError:
    return RecordingError(
        printable(f"{path}: line {line}: {what}"), "export it anew as a value change dump"
    )
