# SPDX-License-Identifier: Apache-2.0
"""The report document: what it says of good, bad, broken and missing runs."""

from __future__ import annotations

import copy
import hashlib
import json
import math
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from hil.measure import Limits, Measurement
from hil.recording import Integrity, Recording
from hil.report import NotRun, Result, build, passed, sound
from hil.report.document import MAX_POINTS
from hil.series import Series

Make = Callable[..., Any]

SCHEMA = json.loads((files("hil.report") / "report.schema.json").read_text(encoding="utf-8"))


def validate(document: dict[str, Any]) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    # What a reader of the file sees, not what is in memory.
    jsonschema.validate(json.loads(json.dumps(document, allow_nan=False)), SCHEMA)


def one(value: float | None, **more: Any) -> Measurement:
    return Measurement("a.b", value, "ns", Limits(high=150.0), "T1", "how", **more)


def test_good_runs_and_an_ordered_failure_are_sound(four_runs: list[Result]) -> None:
    document = build(four_runs)
    validate(document)
    assert [r["verdict"] for r in document["recordings"]] == ["pass", "marginal", "pass", "fail"]
    assert [r["outcome"] for r in document["recordings"]] == ["pass"] * 3 + ["product_failure"]
    assert (document["verdict"], document["outcome"]) == ("marginal", "pass")
    assert sound(document)
    assert not passed(document)
    assert passed(build(four_runs[:3]))
    faulty = document["recordings"][3]
    assert faulty["as_expected"] is True
    assert [m["name"] for m in faulty["measurements"] if m["expected_fail"]] == [
        "sync.error_p99_ns",
        "sync.error_max_ns",
    ]


def test_a_run_made_to_fail_that_passes_is_a_failure(recording: Make, measurements: Make) -> None:
    run = recording(expect_fail=("sync.error_p99_ns",))
    document = build([(run, measurements(92.4))])
    assert document["recordings"][0]["as_expected"] is False
    assert (document["verdict"], document["outcome"]) == ("fail", "product_failure")
    assert not sound(document)


def test_a_named_check_that_was_not_measured_did_not_fail(recording: Make) -> None:
    document = build([(recording(expect_fail=("sync.gone",)), [one(999.0)])])
    assert not sound(document)


@pytest.mark.parametrize(
    ("value", "uncertainty", "outcome"),
    [
        (100.0, 0.0, "pass"),
        (200.0, 0.0, "product_failure"),
        (149.0, 5.0, "inconclusive"),
        (None, 0.0, "inconclusive"),
        (math.nan, 0.0, "product_failure"),
        (math.inf, 0.0, "product_failure"),
    ],
)
def test_outcome_follows_from_the_worst_check(
    recording: Make, value: float | None, uncertainty: float, outcome: str
) -> None:
    document = build([(recording(), [one(value, uncertainty=uncertainty)])])
    validate(document)
    assert document["recordings"][0]["outcome"] == outcome
    assert passed(document) is sound(document) is (outcome == "pass")


def test_a_cut_recording_is_a_failure_of_the_rig(recording: Make, measurements: Make) -> None:
    cut = recording(integrity=Integrity(False, ("the file ends in a block",), 3, 9))
    document = build([(cut, measurements())])
    validate(document)
    entry = document["recordings"][0]
    assert entry["outcome"] == document["outcome"] == "rig_failure"
    assert "the file ends in a block" in entry["outcome_reason"]
    assert entry["verdict"] == "pass"
    assert not sound(document)


def test_an_ordered_failure_does_not_excuse_a_broken_rig(recording: Make) -> None:
    run = recording(expect_fail=("a.b",))
    document = build([Result(run, [one(999.0)], rig_failure="leader died")])
    assert document["outcome"] == "rig_failure"
    assert not sound(document)


def test_a_run_that_was_not_run_live_is_said_and_does_not_pass(
    recording: Make, measurements: Make
) -> None:
    missing = NotRun("wander", "sim", "no workspace")
    alone = build([missing])
    validate(alone)
    assert alone["outcome"] == "not_run_live"
    assert not sound(alone)
    both = build([missing, (recording(), measurements())])
    assert sound(both)
    assert not passed(both)
    assert build([NotRun("x", "bench", "port lost", rig_failed=True)])["outcome"] == "rig_failure"


def test_nothing_judged_is_not_a_pass() -> None:
    document = build([])
    validate(document)
    assert not sound(document)
    assert not passed(document)


def test_a_repetition_never_hides_a_failure(recording: Make) -> None:
    document = build([(recording(), [one(999.0), one(100.0), one(100.0)])])
    kept = document["recordings"][0]["measurements"]
    assert [(m["id"], m["verdict"]) for m in kept] == [("a.b", "fail"), ("a.b-2", "pass")]
    assert document["verdict"] == "fail"


def test_ids_are_links_and_unique(recording: Make) -> None:
    document = build([(recording(name), []) for name in ("a b/ç", "a b?ç", "–", "a-b-2")])
    ids = [r["id"] for r in document["recordings"]]
    assert ids == ["a-b", "a-b-2", "unnamed", "a-b-2-2"]
    validate(document)


def test_measurements_reach_the_document_with_all_they_say(recording: Make) -> None:
    m = Measurement(
        "a.b",
        1.0,
        "ns",
        Limits(0.0, 2.0, 0.5),
        "T1",
        "how",
        uncertainty=0.1,
        clock="leader",
        details={"n": np.int64(3), "x": np.array([1.0, np.nan]), "p": Path("a"), "k": {"z": b"\1"}},
    )
    (entry,) = build([(recording(), [m])])["recordings"][0]["measurements"]
    assert entry == {
        "id": "a.b",
        **m.to_json(),
        "details": {"n": 3, "x": [1.0, "nan"], "p": "a", "k": {"z": "01"}},
        "expected_fail": False,
    }


def test_details_without_a_json_form_are_named(recording: Make) -> None:
    m = one(1.0, details={"deep": [object()]})
    with pytest.raises(TypeError, match=r"a\.b\.details\.deep\[0\] is a object"):
        build([(recording(), [m])])


def test_cited_lines_of_the_error_budget_are_in_the_document(recording: Make) -> None:
    document = build([(recording(), [one(1.0)])])
    assert [line["id"] for line in document["budget"]] == ["T1"]
    assert document["budget"][0]["arithmetic"]


def test_provenance_says_who_spoke_and_from_which_file(recording: Make, tmp_path: Path) -> None:
    path = tmp_path / "clean-7ms5" / "recording.mcap"
    path.parent.mkdir()
    path.write_bytes(b"bytes")
    entry = build([(recording(path=path), [])])["recordings"][0]
    assert entry["name"] == "clean-7ms5"
    assert entry["file"] == {
        "name": "recording.mcap",
        "sha256": hashlib.sha256(b"bytes").hexdigest(),
        "size_bytes": 5,
    }
    devices = entry["provenance"]["devices"]
    assert devices["leader"]["device_id"] == "a1b2c3d4e5f60000"
    assert devices["follower"]["device_id"] == "a1b2c3d4e5f60001"
    assert devices["leader"]["build_id"] == entry["provenance"]["images"]["leader"]["build_id"]
    assert entry["contents"]["duration_s"] == 60.0
    assert entry["source_label"] == "simulated radio, real firmware"
    assert any("RX" in s or "END" in s for s in entry["cannot_tell"])


def test_long_series_are_thinned_and_their_numbers_are_of_all_samples(recording: Make) -> None:
    t = np.arange(480_000) * 7.5e-3
    y = np.sin(t)
    y[1234] = 50.0
    y[99_999] = np.nan
    s = Series("s", "S", "s", "ns", t, y)
    entry = build([(recording(), [], [s])])["recordings"][0]["series"][0]
    assert len(entry["x"]) == len(entry["y"]) <= MAX_POINTS
    assert entry["samples"] == 480_000
    assert entry["statistics"]["maximum"] == 50.0
    assert 50 in entry["y"]
    assert None in entry["y"]


def test_the_same_input_gives_the_same_document(four_runs: list[Result]) -> None:
    stamp = "2026-11-22T08:30:00+00:00"
    first = json.dumps(build(four_runs, generated_utc=stamp))
    assert first == json.dumps(build(four_runs, generated_utc=stamp))


def test_the_schema_refuses_wrong_documents(recording: Make) -> None:
    short = Series("s", "S", "s", "ns", np.arange(3.0), np.arange(3.0))
    good = build([(recording(), [one(1.0)], [short])])
    validate(good)
    for change in (
        lambda d: d.pop("verdict"),
        lambda d: d.update(verdict="fine"),
        lambda d: d.update(surprise=1),
        lambda d: d["recordings"][0].update(source="dream"),
        lambda d: d["recordings"][0]["measurements"][0].update(value="many"),
        lambda d: d["recordings"][0]["measurements"][0]["limits"].pop("high"),
        lambda d: d["recordings"][0]["series"][0].update(kind="pie"),
    ):
        bad = copy.deepcopy(good)
        change(bad)
        with pytest.raises(jsonschema.ValidationError):
            validate(bad)


def test_recordings_are_only_read(recording: Make, measurements: Make) -> None:
    run: Recording = recording()
    before = run.provenance.to_mapping()
    build([(run, measurements())])
    assert run.provenance.to_mapping() == before
