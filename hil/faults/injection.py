# SPDX-License-Identifier: Apache-2.0
"""What is done to a run on purpose: the kinds of fault, and how one is written.

On a command line as ``KIND[:STREAM][=VALUE][@FROM..TO][#SEED]``, for example ``drop=1e-4`` or
``late-edges:follower.pulse=2e-5@5..20``; in a scenario as a section::

    [[inject]]
    kind = "drop"
    stream = "follower"
    value = 1e-4
    from_s = 5.0
    to_s = 20.0
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from hil.errors import ScenarioError, printable, shorten

ROLES: Final = ("leader", "follower")
PINS: Final = ("pulse", "radio_end", "imu_int1")
COUNT_MAX: Final = 1000
SECONDS_MAX: Final = 3600.0
MAX_INJECTIONS: Final = 64
SYNTAX: Final = "KIND[:STREAM][=VALUE][@FROM..TO][#SEED], e.g. drop=1e-4@5..20"
_PATTERN: Final = re.compile(
    r"(?P<kind>[a-z-]+)(:(?P<stream>[a-z0-9_.]+))?(=(?P<value>[^@#]+))?"
    r"(@(?P<from>[^.#]*(?:\.\d+)?)(?P<to>\.\..*?)?)?(#(?P<seed>\d{1,9}))?"
)


@dataclass(frozen=True)
class Kind:
    """One kind of fault.

    Attributes:
        meaning: what happens, with ``{value}`` and ``{where}`` in it.
        unit: of the value: ``share``, ``s`` or ``count``; empty without a value.
        default: the value when none is given.
        at: it happens at one instant, so that FROM is needed and TO means nothing.
        stream: whose; empty for every stream, when none is given.
        pins: a stream may also be one pin, e.g. ``follower.pulse``.
        span: it needs FROM and TO.
        whole: no stream can be chosen.
        sources: where it can be done, of ``sim``, ``bench`` and ``replay``.
    """

    meaning: str
    unit: str = ""
    default: float = 0.0
    at: bool = False
    stream: str = ""
    pins: bool = False
    span: bool = False
    whole: bool = False
    sources: tuple[str, ...] = ("sim", "bench", "replay")


KINDS: Final[Mapping[str, Kind]] = {
    "drop": Kind("{value} of the bytes {where} is lost", "share", 1e-4),
    "duplicate": Kind("{value} of the bytes {where} comes twice", "share", 1e-4),
    "reorder": Kind("{value} of the bytes {where} changes places with the next", "share", 1e-4),
    "corrupt": Kind("{value} of the bytes {where} has a bit turned over", "share", 1e-4),
    "late": Kind("the bytes {where} come {value} late", "s", 0.5),
    "missing-edges": Kind("{value} of the edges {where} is not seen", "share", 0.01, pins=True),
    "late-edges": Kind("the edges {where} are seen {value} late", "s", 2e-5, pins=True),
    "analyser-drop": Kind(
        "the analyser loses {value} of samples, and all that follows is early by as much",
        *("s", 1e-3),
        at=True,
        whole=True,
    ),
    "clock-jump": Kind("the bench's clock jumps by {value} {where}", "s", 0.1, at=True),
    "swap": Kind("the two boards are taken for each other", whole=True),
    "absent": Kind("the follower is not there", stream="follower", whole=True),
    "reboot": Kind(
        "the power {where} fails for {value}, and its stream begins anew",
        *("s", 0.5),
        at=True,
        stream="follower",
    ),
    "storm": Kind(
        "the radio link is broken {value}",
        *("count", 10.0),
        span=True,
        whole=True,
        sources=("sim", "bench"),
    ),
    "flash": Kind(
        "{value} of the stored calibration {where} turned over",
        *("count", 8.0),
        sources=("sim",),
    ),
}


@dataclass(frozen=True)
class Injection:
    """One fault of a run.

    Attributes:
        kind: of :data:`KINDS`.
        value: in the unit of the kind.
        stream: a role, or a pin such as ``follower.pulse``; empty for all.
        from_s, to_s: of the run; the default is all of it.
        seed: of what is drawn, on top of the scenario's.
    """

    kind: str
    value: float = 0.0
    stream: str = ""
    from_s: float = 0.0
    to_s: float = math.inf
    seed: int = 0

    def covers(self, name: str) -> bool:
        """Whether the stream or pin called ``name`` is meant."""
        return not self.stream or name == self.stream or name.startswith(self.stream + ".")

    @property
    def from_ns(self) -> int:
        return round(self.from_s * 1e9)

    @property
    def to_ns(self) -> float:
        return self.to_s * 1e9

    def to_mapping(self) -> dict[str, Any]:
        """As a scenario or a recording's provenance holds it; inverse of :func:`from_mapping`."""
        kind = KINDS[self.kind]
        wanted = {
            "kind": self.kind,
            "value": self.value if kind.unit else None,
            "stream": self.stream or None,
            "from_s": self.from_s if self.from_s or kind.at or kind.span else None,
            "to_s": self.to_s if math.isfinite(self.to_s) else None,
            "seed": self.seed or None,
        }
        return {key: value for key, value in wanted.items() if value is not None}

    def sentence(self) -> str:
        """What happens, in plain words."""
        kind = KINDS[self.kind]
        where = f"of the {self.stream.replace('.', ' ').replace('_', ' ')}" if self.stream else ""
        said = kind.meaning.format(value=_said(self.value, self.kind), where=where)
        when = ""
        if kind.at:
            when = f", at {self.from_s:g} s"
        elif self.from_s or math.isfinite(self.to_s):
            to = f"{self.to_s:g} s" if math.isfinite(self.to_s) else "the end"
            when = f", from {self.from_s:g} s to {to}"
        return " ".join(said.split()) + when


def _said(value: float, kind: str) -> str:
    match KINDS[kind].unit:
        case "share":
            return f"a share of {value:.3g}"
        case "s":
            return f"{value:g} s" if abs(value) >= 1e-3 else f"{value * 1e6:g} us"
        case "count" if kind == "flash":
            return f"{value:g} bits"
        case "count":
            return f"{value:g} times"
        case _:
            return ""


def parse(text: str) -> Injection:
    """Read ``KIND[:STREAM][=VALUE][@FROM..TO][#SEED]``.

    Raises:
        ScenarioError: it is none; the message says what is wrong with it.
    """
    where = f"--inject {shorten(text)}"
    found = _PATTERN.fullmatch(text)
    if found is None:
        raise ScenarioError(printable(f"{where}: cannot be read"), "write " + SYNTAX)
    data: dict[str, Any] = {"kind": found["kind"]}
    for key, group in (("value", "value"), ("from_s", "from"), ("to_s", "to")):
        raw = (found[group] or "").removeprefix("..") if group == "to" else found[group]
        if raw:
            try:
                data[key] = float(raw)
            except ValueError:
                raise ScenarioError(
                    printable(f"{where}: {raw!r} is no number"), "write " + SYNTAX
                ) from None
    if found["stream"]:
        data["stream"] = found["stream"]
    if found["seed"]:
        data["seed"] = int(found["seed"])
    return from_mapping(data, where)


def from_mapping(data: Any, where: str) -> Injection:
    """Build one from plain data.

    Raises:
        ScenarioError: an unknown kind, key or stream, or a value out of range.
    """
    where = printable(where)
    if not isinstance(data, Mapping):
        raise ScenarioError(f"{where}: a table is needed")
    number = (int, float)
    types: dict[str, Any] = {
        **{"kind": str, "stream": str, "seed": int},
        **dict.fromkeys(("value", "from_s", "to_s"), number),
    }
    for key, value in data.items():
        if key not in types:
            raise ScenarioError(
                printable(f"{where}: unknown key '{shorten(str(key))}'"),
                "known keys: " + ", ".join(sorted(types)),
            )
        wrong = isinstance(value, bool) or not isinstance(value, types[key])
        if wrong or (isinstance(value, int | float) and not math.isfinite(value)):
            raise ScenarioError(f"{where}: '{key}' is not of the type it needs")
    name = data.get("kind", "")
    if name not in KINDS:
        raise ScenarioError(
            printable(f"{where}: no fault is called '{shorten(str(name))}'"),
            "faults: " + ", ".join(KINDS),
        )
    kind = KINDS[name]
    if "value" in data and not kind.unit:
        raise ScenarioError(f"{where}: '{name}' has no value")
    found = Injection(
        name,
        float(data.get("value", kind.default)),
        data.get("stream", kind.stream),
        float(data.get("from_s", 0.0)),
        float(data.get("to_s", math.inf)),
        int(data.get("seed", 0)),
    )
    _check(found, kind, data, where)
    return found


def _check(found: Injection, kind: Kind, data: Mapping[str, Any], where: str) -> None:
    limits = {
        "share": (0.0, 1.0, "a share, 0 to 1"),
        "s": (-SECONDS_MAX if found.kind == "clock-jump" else 0.0, SECONDS_MAX, "seconds"),
        "count": (1, COUNT_MAX, f"a number from 1 to {COUNT_MAX}"),
    }
    if kind.unit:
        low, high, what = limits[kind.unit]
        if not low <= found.value <= high or (kind.unit == "count" and found.value % 1):
            raise ScenarioError(f"{where}: {found.value:g} is not {what}")
    if not 0.0 <= found.from_s < found.to_s or not 0 <= found.seed < 1 << 31:
        raise ScenarioError(
            f"{where}: it begins at {found.from_s:g} s and ends at {found.to_s:g} s",
            "FROM must lie before TO, both from 0 on, and a seed from 0 on",
        )
    if kind.at and ("from_s" not in data or "to_s" in data):
        raise ScenarioError(f"{where}: it happens at one instant", f"e.g. {found.kind}@5")
    if kind.span and not {"from_s", "to_s"} <= data.keys():
        raise ScenarioError(f"{where}: it needs a beginning and an end", f"e.g. {found.kind}@5..15")
    own = (kind.stream,) if kind.stream else ()
    streams = own if kind.whole else ROLES
    if kind.pins:
        streams = (*streams, *(f"{role}.{pin}" for role in ROLES for pin in PINS))
    if "stream" in data and found.stream not in streams:
        raise ScenarioError(
            printable(f"{where}: there is no stream '{shorten(found.stream)}' to choose"),
            "streams: " + (", ".join(streams) or "none, it is of the whole run"),
        )


def parse_all(texts: Iterable[str]) -> tuple[Injection, ...]:
    """Several of a command line, in the order of being applied."""
    return limited(tuple(parse(text) for text in texts))


def limited(injections: tuple[Injection, ...]) -> tuple[Injection, ...]:
    """As given; raises ScenarioError for more than a run can bear."""
    if len(injections) > MAX_INJECTIONS:
        raise ScenarioError(f"more than {MAX_INJECTIONS} faults to inject into one run")
    return injections


def of_scenario(scenario: Mapping[str, Any]) -> tuple[Injection, ...]:
    """The injections that a recording's provenance names.

    Raises:
        ScenarioError: what it names is none.
    """
    listed = scenario.get("inject") or ()
    if not isinstance(listed, list | tuple):
        raise ScenarioError("the scenario in the provenance has no list of injected faults")
    return tuple(from_mapping(one, "[[inject]]") for one in listed)


def in_words(scenario: Mapping[str, Any]) -> str:
    """The injected faults of a recording in one sentence; empty when there are none."""
    try:
        listed = [one.sentence() for one in of_scenario(scenario)]
    except ScenarioError as error:
        listed = [f"which, its provenance does not say: {error.message}"]
    return "faults were injected: " + "; ".join(listed) if listed else ""


def refuse_unless_possible(injections: Iterable[Injection], source: str) -> None:
    """See that each can be done to runs of ``source``: sim, bench or replay.

    Raises:
        ScenarioError: one cannot; the message says where it can.
    """
    for one in injections:
        possible = KINDS[one.kind].sources
        if source not in possible:
            raise ScenarioError(
                f"'{one.kind}' is done to the nodes themselves and cannot be injected into "
                + ("a recording made earlier" if source == "replay" else "boards"),
                " or ".join(f"run live with --board={name}" for name in possible),
            )
