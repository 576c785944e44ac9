# SPDX-License-Identifier: Apache-2.0
"""The report document as JUnit XML, as CI servers read it.

One suite per run, one case per measurement. ``inconclusive`` is a failure, because nothing was
shown; what was not measured is skipped; a failure that the scenario orders is skipped as an
expected one, and its absence is a failure; a broken rig is an error.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

from hil.report import text as texts
from hil.report import words
from hil.report.plain import text as clean


def render(document: Mapping[str, Any]) -> str:
    """The XML text for a document made by :func:`hil.report.document.build`."""
    root = ET.Element("testsuites", name="hil")
    suites = [_suite(root, entry, document) for entry in document["recordings"]]
    for key in ("tests", "failures", "errors", "skipped"):
        root.set(key, str(sum(int(suite.get(key, "0")) for suite in suites)))
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _suite(root: ET.Element, entry: Mapping[str, Any], document: Mapping[str, Any]) -> ET.Element:
    when = _text(document["generated_utc"])
    suite = ET.SubElement(root, "testsuite", name=_text(entry["id"]), timestamp=when)
    git = document["rig"]["git"]
    properties = {
        "rig.commit": git["commit"],
        "rig.state": git["state"],
        "source": entry["source_label"],
        "judged": entry["judged"],
        "verdict": entry["verdict"],
        "outcome": entry["outcome"],
        "injected": entry.get("injected", ""),
        "expect_fail": ", ".join(entry["expect_fail"]),
    }
    for file in entry["attachments"]:
        properties[f"attachment.{file['kind']}"] = file["path"]
        properties[f"attachment.{file['kind']}.sha256"] = file["sha256"]
    if entry["provenance"]:
        properties["created_utc"] = entry["provenance"]["created_utc"]
        properties["schema_hash"] = entry["provenance"]["schema_hash"]
        for role, image in entry["provenance"]["images"].items():
            properties[f"build_id.{role}"] = str(image.get("build_id", ""))
        for role, device in entry["provenance"]["devices"].items():
            properties[f"device_id.{role}"] = device["device_id"]
    _properties(suite, properties)
    if entry["outcome"] == "rig_failure":
        case = ET.SubElement(suite, "testcase", classname=_text(entry["id"]), name="rig")
        ET.SubElement(case, "error", message=_text(entry["outcome_reason"]), type="RigFailure")
    if entry["outcome"] == "not_run_live":
        case = ET.SubElement(suite, "testcase", classname=_text(entry["id"]), name="run")
        ET.SubElement(case, "skipped", message=_text("not run live: " + entry["outcome_reason"]))
    if entry.get("injected") and entry["outcome"] == "inconclusive":
        case = ET.SubElement(suite, "testcase", classname=_text(entry["id"]), name="injected")
        ET.SubElement(case, "failure", message=_text(entry["outcome_reason"]), type="unnoticed")
    for measurement in entry["measurements"]:
        _case(suite, entry, measurement)
    missing = set(entry["expect_fail"]) - {m["name"] for m in entry["measurements"]}
    for name in sorted(missing):
        case = ET.SubElement(suite, "testcase", classname=_text(entry["id"]), name=_text(name))
        ET.SubElement(case, "failure", message="made to fail, but not measured", type="missed")
    cases = suite.findall("testcase")
    suite.set("tests", str(len(cases)))
    for key, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(key, str(sum(case.find(tag) is not None for case in cases)))
    return suite


def _case(suite: ET.Element, entry: Mapping[str, Any], measurement: Mapping[str, Any]) -> None:
    case = ET.SubElement(
        suite, "testcase", classname=_text(entry["id"]), name=_text(measurement["id"])
    )
    _properties(
        case,
        {
            **{key: measurement[key] for key in ("value", "unit", "uncertainty", "verdict")},
            "limit.low": measurement["limits"]["low"],
            "limit.high": measurement["limits"]["high"],
            "limit.marginal": measurement["limits"]["marginal"],
            "budget": measurement["budget"],
            "clock": measurement["clock"],
            "how": measurement["how"],
        },
    )
    shown = texts.quantity(measurement)
    sentence = f"{shown.measured}, limit {shown.allowed}, error budget {measurement['budget']}"
    verdict = measurement["verdict"]
    if measurement["expected_fail"] and verdict == "fail":
        _result(case, "skipped", f"fails, as it is made to: {sentence}", "expected", measurement)
    elif measurement["expected_fail"]:
        message = f"made to fail, but found {words.VERDICTS[verdict].lower()}: {sentence}"
        _result(case, "failure", message, "missed", measurement)
    elif verdict == "unset":
        _result(case, "skipped", f"not measured: {measurement['how']}", "unset", measurement)
    elif verdict in ("fail", "inconclusive") and entry["expect_fail"]:
        message = f"{verdict} in a run made to fail: {sentence}"
        _result(case, "skipped", message, "expected", measurement)
    elif verdict in ("fail", "inconclusive"):
        _result(case, "failure", f"{verdict}: {sentence}", verdict, measurement)


def _result(
    case: ET.Element, tag: str, message: str, kind: str, measurement: Mapping[str, Any]
) -> None:
    result = ET.SubElement(case, tag, message=_text(message), type=kind)
    result.text = _text(measurement["how"])


def _properties(parent: ET.Element, values: Mapping[str, Any]) -> None:
    holder = ET.SubElement(parent, "properties")
    for name, value in values.items():
        if value not in (None, ""):
            ET.SubElement(holder, "property", name=_text(name), value=_text(str(value)))


def _text(value: str) -> str:
    return clean(value)
