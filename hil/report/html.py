# SPDX-License-Identifier: Apache-2.0
"""The report document as one self-contained page: no network, no other file.

Every string passes through the template engine's escaping, the chart data through
:func:`island`, and a content security policy lets only the page's own scripts run, so that a
recording cannot put anything into the page.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final

from markupsafe import Markup

from hil.report import budget, margin, still, words
from hil.report import text as texts
from hil.report.charts import charts
from hil.report.page import asset, policy, template

_GAUGE_WIDTH: Final = 120.0
_GAUGE_EDGE: Final = 6.0


def render(document: Mapping[str, Any]) -> str:
    """The page for a document made by :func:`hil.report.document.build`.

    Raises:
        ValueError: series that share a plot do not fit each other.
    """
    runs = [_run(entry, document["budget"]) for entry in document["recordings"]]
    verdict, sentence = words.headline(document)
    styles = asset("uplot/uPlot.min.css") + asset("report.css")
    early, late = asset("theme.js"), asset("uplot/uPlot.iife.min.js") + "\n" + asset("report.js")
    page: str = _template().render(
        document=document,
        runs=runs,
        headline=sentence,
        verdict=verdict,
        failures=[
            {"run": run, **row} for run in runs for row in run["rows"] if row["verdict"] == "fail"
        ],
        budget=budget.of_all(document["budget"], runs),
        quantities={line["id"]: line["quantity"] for line in document["budget"]},
        unknowns=_unknowns(document["recordings"]),
        league=document.get("league", []),
        styles=Markup(styles),  # noqa: S704 (our own assets)
        early_script=Markup(early),  # noqa: S704
        late_script=Markup(late),  # noqa: S704
        policy=policy(styles, (early, late)),
        chart_data=island(
            {
                c["anchor"]: c["data"]
                for run in runs
                for c in run["charts"]
                if not c["empty"] and not c["still"]
            }
        ),
        made=texts.moment(document["generated_utc"]),
        words=words,
        percent=margin.percent,
        count=words.count,
    )
    return page


def island(value: Any) -> Markup:
    """``value`` as JSON that is safe inside a ``<script>`` element, whatever strings it holds."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)  # noqa: S704 (the three characters that end a script are gone)


def _run(entry: Mapping[str, Any], lines: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    rows = [_row(entry, m) for m in entry["measurements"]]
    by_id = {row["id"]: row for row in rows}
    contents, integrity = entry["contents"], entry["integrity"]
    drawn = [_figure(c, rows) for c in charts(entry["id"], entry["series"])]
    return {
        "id": entry["id"],
        "entry": entry,
        "verdict": words.run_verdict(entry),
        "title": words.run_title(entry),
        "rows": rows,
        "groups": _groups(entry["measurements"], by_id),
        "tally": _tally(rows),
        "judged": "judged while it ran" if entry["judged"] == "live" else "replayed",
        "duration": texts.duration(contents["duration_s"]) if contents else "–",
        "damaged": bool(integrity and (integrity["problems"] or not integrity["complete"])),
        "budget": budget.of_run(lines, entry["id"], rows),
        "charts": drawn,
        "chart_groups": _under_headings(drawn),
        "facts": _facts(entry),
        "images": _images(entry),
        "scenario": _flat((entry["provenance"] or {}).get("scenario", {})),
        "tools": _flat((entry["provenance"] or {}).get("tools", {})),
        "host": _flat((entry["provenance"] or {}).get("host", {})),
    }


def _groups(
    measurements: Sequence[Mapping[str, Any]], by_id: Mapping[str, dict[str, Any]]
) -> list[dict[str, Any]]:
    """Checks under their headings; a group without anything to look at starts closed."""
    found: list[dict[str, Any]] = []
    for title, members in words.groups(measurements):
        rows = [by_id[m["id"]] for m in members]
        calm = all(row["verdict"] in ("pass", "unset") for row in rows)
        found.append(
            {"title": title, "rows": rows, "tally": _tally(rows), "open": not calm or not found}
        )
    return found


def _figure(chart: Mapping[str, Any], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """A chart with the checks that judge it, of those on the page, their tables and its picture."""
    checks = [row for row in rows if row["name"] in chart["checks"]]
    drawn = chart["still"] and not chart["empty"]
    return {
        **chart,
        "checks": checks,
        "tables": [table for row in checks for table in row["tables"]],
        "picture": still.render(chart["data"], chart["anchor"] + "~title") if drawn else "",
    }


def _under_headings(drawn: Sequence[dict[str, Any]]) -> list[tuple[str, list[dict[str, Any]]]]:
    """Charts under the headings that the checks have, in order of first appearance."""
    found: dict[str, list[dict[str, Any]]] = {}
    for chart in drawn:
        found.setdefault(words.group_title(chart["key"]), []).append(chart)
    return list(found.items())


def _tally(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, int]]:
    """(verdict, how many), without those that do not occur."""
    counted = {v: sum(row["verdict"] == v for row in rows) for v in words.VERDICTS}
    return [(v, n) for v, n in counted.items() if n]


def _row(entry: Mapping[str, Any], measurement: Mapping[str, Any]) -> dict[str, Any]:
    shown = texts.quantity(measurement)
    return {
        "id": measurement["id"],
        "anchor": f"{entry['id']}/{measurement['id']}",
        "name": measurement["name"],
        "verdict": measurement["verdict"],
        "measured": shown.measured,
        "allowed": shown.allowed,
        "budget": measurement["budget"],
        "used": margin.used(measurement),
        "how": _how(measurement),
        "details": _flat({k: v for k, v in measurement["details"].items() if not _is_table(v)}),
        "tables": [_table(name, v) for name, v in measurement["details"].items() if _is_table(v)],
        "expected_fail": measurement["expected_fail"],
        "gauge": _gauge(measurement),
    }


def _how(measurement: Mapping[str, Any]) -> str:
    """How it was measured, as a sentence, with the clock it refers to."""
    how = measurement["how"].strip().rstrip(".")
    sentence = f"{how[:1].upper()}{how[1:]}." if how else ""
    clock = measurement["clock"]
    return f"{sentence} Clock: {clock}." if clock else sentence


def _gauge(measurement: Mapping[str, Any]) -> dict[str, Any] | None:
    """Where the value lies between its limits, as x coordinates of a small drawing."""
    value, unsure = measurement["value"], measurement["uncertainty"]
    low, high = measurement["limits"]["low"], measurement["limits"]["high"]
    numbers = [value, unsure, *(b for b in (low, high) if b is not None)]
    if value is None or any(isinstance(v, str) for v in numbers) or low == high:
        return None
    if low is None:
        low = min(0.0, value)
        ends = (False, True)
    elif high is None:
        high = max(2 * low - value, value) if low <= 0 else max(2 * low, value)
        ends = (True, False)
    else:
        ends = (True, True)
    span = high - low
    if span <= 0:
        return None
    # A limit at one end leaves a fifth of the track beyond it, where a failing value shows.
    left = low - (0.2 * span if ends[0] else 0.0)
    right = high + (0.2 * span if ends[1] else 0.0)

    def at(v: float) -> float:
        share: float = min(max((v - left) / (right - left), 0.0), 1.0)
        return round(_GAUGE_EDGE + share * (_GAUGE_WIDTH - 2 * _GAUGE_EDGE), 1)

    band = min(float(measurement["limits"]["marginal"]), span)
    return {
        "low": at(low),
        "high": at(high),
        "value": at(value),
        "from": at(value - unsure),
        "to": at(value + unsure),
        "limit_low": ends[0],
        "limit_high": ends[1],
        "band_low": at(low + band) if band and ends[0] else None,
        "band_high": at(high - band) if band and ends[1] else None,
        "beyond": "left" if value < left else "right" if value > right else "",
    }


def _facts(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What a person wants to know of a run first; what is not there is left out."""
    provenance, contents = entry["provenance"], entry["contents"]
    if not provenance:
        return []
    scenario = provenance["scenario"]
    facts = [("Length", texts.duration(contents["duration_s"]))]
    simulated = entry["source"] in ("sim", "synthetic")
    nodes = (scenario.get("nodes") or {}) if simulated else {}
    drifts = [
        f"{role} {texts.number(node['drift_ppm'])} ppm"
        + (" with wander" if node.get("wander") else "")
        for role, node in nodes.items()
        if isinstance(node, dict) and isinstance(node.get("drift_ppm"), int | float)
    ]
    if drifts:
        facts.append(("Crystals", ", ".join(drifts)))
    channel = (scenario.get("channel") or {}) if simulated else {}
    if isinstance(channel, dict) and channel.get("kind"):
        attenuation = channel.get("attenuation_db")
        lossy = channel["kind"] != "ideal" and isinstance(attenuation, int | float)
        kind = f"{texts.number(attenuation)} dB attenuation" if lossy else str(channel["kind"])
        facts.append(("Radio channel", kind))
    serial = contents["serial_bytes"]
    if serial:
        facts.append(
            ("Serial streams", ", ".join(f"{r} {texts.size(n)}" for r, n in serial.items()))
        )
    facts.append(("Edges on the analyser", texts.number(contents["edges"])))
    facts.append(("Recorded", texts.moment(provenance["created_utc"])))
    return facts


def _images(entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One table per role: what the manifest says of the image and what the node said of itself."""
    provenance = entry["provenance"] or {"images": {}, "devices": {}}
    roles = [
        *provenance["images"],
        *(r for r in provenance["devices"] if r not in provenance["images"]),
    ]
    return [
        {
            "role": role,
            "rows": _flat(provenance["images"].get(role, {}))
            + [
                (f"hello: {key}", value)
                for key, value in _flat(provenance["devices"].get(role, {}))
            ],
        }
        for role in roles
    ]


def _is_table(value: Any) -> bool:
    """Whether it is a list of flat mappings with the same keys, each a row."""
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(row, Mapping) and list(row) == list(value[0]) for row in value)
        and not any(isinstance(cell, Mapping | list) for row in value for cell in row.values())
    )


def _table(name: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "title": name.replace("_", " ").capitalize(),
        "head": list(rows[0]),
        "rows": [[(texts.scalar(cell), _is_number(cell)) for cell in row.values()] for row in rows],
    }


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _flat(value: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Nested plain data as (dotted key, text)."""
    if isinstance(value, Mapping):
        return [
            pair
            for key, inner in value.items()
            for pair in _flat(inner, f"{prefix}.{key}" if prefix else str(key))
        ]
    if isinstance(value, list):
        if any(isinstance(v, Mapping | list) for v in value):
            return [p for n, v in enumerate(value) for p in _flat(v, f"{prefix}[{n}]")]
        return [(prefix, ", ".join(texts.scalar(v) for v in value) or "none")]
    return [(prefix, texts.scalar(value))]


def _unknowns(entries: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[str]]]:
    found: dict[str, list[str]] = {}
    for entry in entries:
        if entry["cannot_tell"]:
            found.setdefault(entry["source_label"], list(entry["cannot_tell"]))
    return list(found.items())


def _breakable(name: str) -> Markup:
    """A dotted name that may break after dots and underscores, and only there."""
    return Markup("").join(
        Markup("{}<wbr>").format(part) if part[-1] in "._" else part
        for part in re.findall(r"[^._]*[._]|[^._]+", name)
    )


@cache
def _template() -> Any:
    return template("report.html", {"breakable": _breakable})
