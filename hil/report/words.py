# SPDX-License-Identifier: Apache-2.0
"""The words that every view uses for verdicts, outcomes and groups of checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

VERDICTS: Final[Mapping[str, str]] = {
    "pass": "Pass",
    "marginal": "Marginal",
    "fail": "Fail",
    "inconclusive": "Inconclusive",
    "unset": "Not measured",
}

SYMBOLS: Final[Mapping[str, str]] = {
    "pass": "✓",
    "marginal": "▲",
    "fail": "✗",
    "inconclusive": "?",
    "unset": "–",
}
"""A sign for each verdict, so that colour is never the only carrier."""

OUTCOMES: Final[Mapping[str, str]] = {
    "pass": "Pass",
    "product_failure": "Product failure",
    "rig_failure": "Rig failure",
    "inconclusive": "Inconclusive",
    "not_run_live": "Not run live",
}

_GROUPS: Final[Mapping[str, str]] = {
    "sync": "Time sync",
    "pairs": "Pairs of captures",
    "pulse": "Pulses",
    "pulses": "Pulses",
    "link": "Radio link",
    "node": "Nodes",
    "imu": "IMU",
    "fifo": "IMU FIFO",
    "wire": "Serial stream",
    "serial": "Serial stream",
    "cal": "Calibration",
    "ekf": "Estimator",
    "recording": "Recording",
    "soak": "Long run",
}


def group_title(name: str) -> str:
    """Heading for the checks whose dotted name starts like ``name``'s."""
    prefix = name.split(".", 1)[0]
    return _GROUPS.get(prefix, prefix.replace("_", " ").capitalize())


def groups(measurements: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[Mapping[str, Any]]]]:
    """Measurements under their headings, both in the order of first appearance."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for m in measurements:
        found.setdefault(group_title(m["name"]), []).append(m)
    return list(found.items())


def run_verdict(entry: Mapping[str, Any]) -> str:
    """The verdict that colours a run: neither a rig failure nor injected faults show as a pass."""
    hidden = entry["outcome"] == "rig_failure" or entry.get("injected")
    if hidden and entry["verdict"] != "fail":
        return "inconclusive"
    return str(entry["verdict"])


def run_title(entry: Mapping[str, Any]) -> str:
    """Verdict or outcome of a run in words, with the note that a failure was ordered."""
    if entry["outcome"] in ("rig_failure", "not_run_live"):
        return OUTCOMES[entry["outcome"]]
    title = VERDICTS[run_verdict(entry)]
    if entry.get("injected"):
        title += ", faults injected"
    if entry["expect_fail"]:
        return title + (", as it is made to" if entry["as_expected"] else ", but made to fail")
    return title


def count(n: int, one: str, many: str = "") -> str:
    """``1 check``, ``3 checks``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def headline(document: Mapping[str, Any]) -> tuple[str, str]:
    """(verdict that colours it, one sentence) for the whole report."""
    entries = document["recordings"]
    if not entries:
        return "unset", "Nothing was judged."
    if len(entries) == 1:
        return run_verdict(entries[0]), _sentence(entries[0])
    judged = [r for r in entries if r["outcome"] != "not_run_live"]
    rig = [r for r in judged if r["outcome"] == "rig_failure"]
    missed = [r for r in judged if r["expect_fail"] and not r["as_expected"] and r not in rig]
    ordered = [r for r in judged if r["as_expected"] and r not in rig]
    rest = [r for r in judged if not r["expect_fail"] and r not in rig]
    bad = [r for r in rest if r["verdict"] == "fail"]
    unclear = [r for r in rest if r["outcome"] == "inconclusive"]
    good = [r for r in rest if r["outcome"] == "pass"]
    parts = []
    if bad:
        parts.append(f"{_of(len(bad), len(judged))} {_s(bad, 'fails', 'fail')}")
    if missed:
        parts.append(f"{count(len(missed), 'run')} made to fail did not fail as named")
    if rig:
        parts.append(f"the rig failed in {count(len(rig), 'run')}")
    if unclear:
        parts.append(f"{count(len(unclear), 'run')} {_s(unclear, 'is', 'are')} inconclusive")
    if good:
        all_good = len(good) == len(judged)
        subject = ("all " if all_good and len(good) > 1 else "") + count(len(good), "run")
        parts.append(f"{subject} {_s(good, 'passes', 'pass')}")
    if ordered:
        parts.append(
            f"{count(len(ordered), 'run')} {_s(ordered, 'fails', 'fail')}, "
            f"as {_s(ordered, 'it is', 'they are')} made to"
        )
    idle = len(entries) - len(judged)
    if idle:
        parts.append(f"{count(idle, 'run')} {_s(range(idle), 'was', 'were')} not run live")
    sentence = "; ".join(parts) + "."
    colour = (
        "fail"
        if bad
        or missed
        or any(r["verdict"] == "fail" for r in rig)
        or (ordered and len(ordered) == len(judged))
        else "inconclusive"
        if rig or unclear
        else "pass"
        if good
        else "unset"
    )
    return colour, sentence[0].upper() + sentence[1:]


def _sentence(entry: Mapping[str, Any]) -> str:
    name = entry["name"]
    if entry["outcome"] == "rig_failure":
        return f"{name}: the rig failed."
    if entry["outcome"] == "not_run_live":
        return f"{name} was not run live."
    if entry["expect_fail"]:
        return (
            f"{name} fails, as it is made to."
            if entry["as_expected"]
            else (f"{name} is made to fail, but did not fail as named.")
        )
    if entry["outcome"] == "inconclusive":
        return f"{name} is inconclusive."
    return f"{name} {'passes' if entry['outcome'] == 'pass' else 'fails'}."


def _of(n: int, total: int) -> str:
    return f"{n} of {total} runs" if total > 1 else "the run"


def _s(items: Any, one: str, many: str) -> str:
    return one if len(items) == 1 else many
