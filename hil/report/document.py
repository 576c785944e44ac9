# SPDX-License-Identifier: Apache-2.0
"""Judged recordings -> the report document, plain data that ``report.json`` holds.

The document is the only truth: page, JUnit file and terminal view are computed from it and from
nothing else. Its form is fixed by ``report.schema.json`` beside this file.
"""

from __future__ import annotations

import hashlib
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.budget import BY_ID
from hil.faults import in_words
from hil.library import SOURCE_LABELS
from hil.measure import Measurement, Verdict
from hil.recording import Recording
from hil.report import rig
from hil.report.decimate import min_max
from hil.report.knowledge import CANNOT_TELL, SUMMARY
from hil.report.plain import plain, text
from hil.series import Series

SCHEMA_ID: Final = "urn:hil:report:1"
SCHEMA_VERSION: Final = "1.2"
MAX_POINTS: Final = 6000
"""Points kept of one trace: more than twice the pixels that a wide screen has for it."""

Document = dict[str, Any]


@dataclass(frozen=True)
class Result:
    """One judged recording.

    Attributes:
        recording: what ran.
        measurements: what the checks found in it.
        series: what to draw.
        live: judged in the run that recorded it; otherwise it was replayed from a file.
        rig_failure: what went wrong with the rig, if something did.
    """

    recording: Recording
    measurements: Sequence[Measurement]
    series: Sequence[Series] = ()
    live: bool = False
    rig_failure: str = ""


@dataclass(frozen=True)
class NotRun:
    """A run that left no recording.

    Attributes:
        name: of the scenario.
        source: ``sim`` or ``bench``.
        reason: why, in one sentence, and what would make it run.
        rig_failed: the run was started and the rig failed; otherwise it was never started.
    """

    name: str
    source: str
    reason: str
    rig_failed: bool = False


Judged = (
    Result
    | NotRun
    | tuple[Recording, Sequence[Measurement]]
    | tuple[Recording, Sequence[Measurement], Sequence[Series]]
)


def build(results: Iterable[Judged], *, generated_utc: str | None = None) -> Document:
    """The report document.

    Args:
        results: one item per run: a :class:`Result`, a :class:`NotRun`, or for short a tuple
            (recording, measurements) or (recording, measurements, series).
        generated_utc: ISO 8601 time of generation; default: now.
    """
    taken: set[str] = set()
    recordings = []
    for item in results:
        result = Result(*item) if isinstance(item, tuple) else item
        entry = _not_run(result) if isinstance(result, NotRun) else _recording(result)
        recordings.append({"id": _unique(slug(entry["name"]), taken), **entry})
    return {
        "$schema": SCHEMA_ID,
        "schema_version": SCHEMA_VERSION,
        "generated_utc": generated_utc or datetime.now(UTC).isoformat(timespec="seconds"),
        "tool": {
            "name": "hil",
            "version": rig.package_version("hil"),
            "python": platform.python_version(),
        },
        "rig": rig.describe(),
        "verdict": worst(_counted_verdict(r) for r in recordings).value,
        "outcome": gravest_outcome(_counted_outcome(r) for r in recordings),
        "budget": _budget(recordings),
        "recordings": recordings,
    }


def passed(document: Mapping[str, Any]) -> bool:
    """True when every run was judged and none of its checks has a bad verdict."""
    entries = document["recordings"]
    return bool(entries) and all(r["outcome"] == "pass" for r in entries)


def sound(document: Mapping[str, Any]) -> bool:
    """True when the runs turned out as they should.

    Runs pass; runs made to fail fail in the checks named for it. A run that was not run live
    counts for neither, but a report needs at least one that was judged.
    """
    return bool(document["outcome"] == "pass")


EXIT_CODES: Final[Mapping[str, int]] = {
    "pass": 0,
    "product_failure": 1,
    "inconclusive": 1,
    "rig_failure": 10,
    "not_run_live": 11,
}
"""Outcome -> exit code of the command that found it; 2 is wrong use, as in every Unix tool."""


def gravest_outcome(outcomes: Iterable[str]) -> str:
    """The outcome of several runs; ``not_run_live`` only when nothing else was found."""
    found = set(outcomes)
    order = ("product_failure", "rig_failure", "inconclusive", "pass")
    return next((o for o in order if o in found), "not_run_live")


def slug(name: str) -> str:
    """``name`` as it stands in a link: letters, digits, dots, dashes and underscores."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-") or "unnamed"


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The gravest verdict; ``unset`` only when nothing else was found."""
    found = set(verdicts)
    order = (Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.MARGINAL, Verdict.PASS)
    return next((v for v in order if v in found), Verdict.UNSET)


def _budget(entries: Sequence[Mapping[str, Any]]) -> list[Document]:
    """The lines of the error budget that the measurements cite, in order of first mention."""
    cited = dict.fromkeys(m["budget"] for entry in entries for m in entry["measurements"])
    return [
        {
            "id": BY_ID[name].id,
            "quantity": BY_ID[name].quantity,
            "unit": BY_ID[name].unit,
            "arithmetic": BY_ID[name].arithmetic,
        }
        for name in cited
        if name in BY_ID
    ]


def _recording(result: Result) -> Document:
    recording = result.recording
    provenance, integrity = recording.provenance, recording.integrity
    scenario = plain(provenance.scenario, "scenario")
    expect_fail = [str(name) for name in scenario.get("expect_fail") or ()]
    measurements = _measurements(result.measurements, expect_fail)
    verdict = worst(Verdict(m["verdict"]) for m in measurements)
    outcome, reason = _outcome(result, verdict)
    return {
        "name": text(recording.name),
        "description": str(scenario.get("description", "")),
        "source": provenance.source,
        "source_label": SOURCE_LABELS[provenance.source],
        "source_summary": SUMMARY[provenance.source],
        "cannot_tell": list(CANNOT_TELL[provenance.source]),
        "judged": "live" if result.live else "replay",
        "verdict": verdict.value,
        "outcome": outcome,
        "outcome_reason": reason,
        "injected": text(in_words(provenance.scenario)),
        "expect_fail": expect_fail,
        "as_expected": _as_expected(measurements, expect_fail) if expect_fail else None,
        "integrity": {
            "complete": integrity.complete,
            "problems": [text(p) for p in integrity.problems],
            "lost_blocks": int(integrity.lost_blocks),
            "blocks": int(integrity.blocks),
        },
        "contents": _contents(recording),
        "file": _file(recording.path),
        "attachments": _attachments(recording.path),
        "provenance": {
            "created_utc": text(provenance.created_utc),
            "scenario": scenario,
            "images": plain(provenance.manifests, "manifests"),
            "devices": _devices(recording),
            "schema_hash": text(provenance.schema_hash),
            "tools": plain(provenance.tools, "tools"),
            "host": plain(provenance.host, "host"),
            "notes": plain(provenance.notes, "notes"),
        },
        "measurements": measurements,
        "series": [_series(s) for s in result.series],
    }


def _not_run(run: NotRun) -> Document:
    return {
        "name": text(run.name),
        "description": "",
        "source": run.source,
        "source_label": SOURCE_LABELS[run.source],
        "source_summary": SUMMARY[run.source],
        "cannot_tell": [],
        "judged": "live",
        "verdict": Verdict.UNSET.value,
        "outcome": "rig_failure" if run.rig_failed else "not_run_live",
        "outcome_reason": text(run.reason),
        "injected": "",
        "expect_fail": [],
        "as_expected": None,
        "integrity": None,
        "contents": None,
        "file": None,
        "attachments": [],
        "provenance": None,
        "measurements": [],
        "series": [],
    }


def _measurements(measurements: Sequence[Measurement], expect_fail: Sequence[str]) -> list[Any]:
    """As JSON, each with an ``id`` of its own.

    A check may be judged in several tests: the same result counts once, a differing one is kept
    beside the first, so that a repetition never hides a failure.
    """
    taken: set[str] = set()
    kept: list[Any] = []
    seen: list[Any] = []
    for m in measurements:
        entry = plain(m.to_json(), m.name)
        entry["expected_fail"] = m.name in expect_fail
        if entry in seen:
            continue
        seen.append(entry)
        kept.append({"id": _unique(slug(m.name), taken), **entry})
    return kept


def _outcome(result: Result, verdict: Verdict) -> tuple[str, str]:  # noqa: PLR0911 (a case each)
    """Whose failure it is. A broken rig is named first: it may well be why a check failed."""
    integrity = result.recording.integrity
    injected = in_words(result.recording.provenance.scenario)
    if result.rig_failure:
        return "rig_failure", text(result.rig_failure)
    if not integrity.complete or integrity.lost_blocks:
        return "rig_failure", "The recording is not whole: " + text(
            "; ".join(integrity.problems) or f"{integrity.lost_blocks} blocks are missing"
        )
    match verdict:
        case Verdict.FAIL:
            return "product_failure", "A check found a value outside its limits" + (
                f"; {text(injected)}." if injected else "."
            )
        case Verdict.INCONCLUSIVE:
            return "inconclusive", "A value lies too close to its limit for its uncertainty."
        case Verdict.UNSET:
            return "inconclusive", "Nothing could be measured."
        case _ if injected:
            return "inconclusive", f"No check noticed that {text(injected)}."
        case Verdict.PASS | Verdict.MARGINAL:
            return "pass", ""


def _as_expected(measurements: Sequence[Any], expect_fail: Sequence[str]) -> bool:
    failed = {m["name"] for m in measurements if m["verdict"] == Verdict.FAIL}
    return failed.issuperset(expect_fail)


def _counted_verdict(entry: Mapping[str, Any]) -> Verdict:
    """What a run adds to the verdict of the whole: a failure that was ordered counts as a pass."""
    if not entry["expect_fail"]:
        unnoticed = entry["injected"] and Verdict(entry["verdict"]) is not Verdict.FAIL
        return Verdict.INCONCLUSIVE if unnoticed else Verdict(entry["verdict"])
    return Verdict.PASS if entry["as_expected"] else Verdict.FAIL


def _counted_outcome(entry: Mapping[str, Any]) -> str:
    if entry["expect_fail"] and entry["outcome"] != "rig_failure":
        return "pass" if entry["as_expected"] else "product_failure"
    return str(entry["outcome"])


def _contents(recording: Recording) -> Document:
    last = [0]
    for stream in recording.serial.values():
        last += [int(stream.block_t_ns_bench[-1])] if stream.block_t_ns_bench.size else []
    last += [int(recording.edges.t_ns_bench[-1])] if recording.edges.t_ns_bench.size else []
    last += [int(e.t_ns_bench) for e in recording.events]
    events: dict[str, int] = {}
    for event in recording.events:
        events[text(event.kind)] = events.get(text(event.kind), 0) + 1
    return {
        "duration_s": max(last) / 1e9,
        "serial_bytes": {role: int(s.data.size) for role, s in sorted(recording.serial.items())},
        "edges": int(recording.edges.t_ns_bench.size),
        "events": events,
    }


def _devices(recording: Recording) -> Document:
    """Who spoke: from the last HELLO of each node, as it came over the wire."""
    devices = {}
    for role in sorted(recording.serial):
        hello = recording.decoded(role).messages.get("hello")
        if hello is None or not hello.size:
            continue
        last = hello[-1]
        devices[role] = {
            "device_id": f"{int(last['device_id']):016x}",
            "build_id": f"{int(last['build_id']):016x}",
            "schema_hash": f"{int(last['schema_hash']):016x}",
        }
    return devices


def _file(path: Path | None) -> Document | None:
    if path is None or not path.is_file():
        return None
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {"name": text(path.name), "sha256": digest, "size_bytes": path.stat().st_size}


def _attachments(path: Path | None) -> list[Document]:
    """The recording and the README that says where it came from, each with its hash."""
    if path is None:
        return []
    found = []
    for kind, file in (("recording", path), ("readme", path.parent / "README.md")):
        described = _file(file)
        if described is not None:
            place = text(file.as_posix())
            found.append(
                {"kind": kind, "path": place, **{k: described[k] for k in ("size_bytes", "sha256")}}
            )
    return found


def _series(series: Series) -> Document:
    x, y = series.x, series.y
    if series.kind != "histogram":
        x, y = min_max(x, y, MAX_POINTS)
    return {
        "name": text(series.name),
        "title": text(series.title),
        "kind": series.kind,
        "x_label": text(series.x_label),
        "x_unit": text(series.x_unit),
        "clock": text(series.clock),
        "y_label": text(series.y_label or series.title),
        "y_unit": text(series.y_unit),
        "y_clock": text(series.y_clock),
        "x_log": series.x_log,
        "y_log": series.y_log,
        "plot": text(series.plot),
        "plot_title": text(series.plot_title),
        "check": text(series.check),
        "caption": text(series.caption),
        "limits": [
            {"value": float(line.value), "label": text(line.label), "side": line.side}
            for line in series.limits
        ],
        "samples": int(series.y.size),
        "statistics": _statistics(series),
        "x": _numbers(x),
        "y": _numbers(y),
    }


def _statistics(series: Series) -> Document | None:
    """Of all samples, not of those kept for drawing."""
    finite = series.y[np.isfinite(series.y)]
    if series.kind == "histogram" or not finite.size:
        return None
    low, middle, high = np.percentile(finite, (1, 50, 99))
    return {
        "minimum": float(finite.min()),
        "p01": float(low),
        "median": float(middle),
        "p99": float(high),
        "maximum": float(finite.max()),
        "standard_deviation": float(finite.std()),
    }


def _numbers(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float | None]:
    """Nine significant digits, whole numbers as such; a gap is null."""

    def short(v: float) -> float | int | None:
        if not np.isfinite(v):
            return None
        rounded = float(f"{v:.9g}")
        return int(rounded) if rounded.is_integer() and abs(rounded) < 2**53 else rounded

    return [short(v) for v in values.tolist()]


def _unique(wanted: str, taken: set[str]) -> str:
    name, n = wanted, 1
    while name in taken:
        n += 1
        name = f"{wanted}-{n}"
    taken.add(name)
    return name
