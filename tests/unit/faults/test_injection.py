# SPDX-License-Identifier: Apache-2.0
"""How faults are written, what they do to bytes and edges, and that they never stay hidden."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from hil import commands, report, scenario
from hil.backends.replay import ReplayBackend
from hil.errors import ScenarioError
from hil.faults import KINDS, Injection, in_words, nodes, parse_all, refuse_unless_possible
from hil.faults.apply import InjectedWriter, inject, writer
from hil.faults.injection import from_mapping
from hil.faults.injector import Injector
from hil.measure import Limits, Measurement
from hil.recording import EDGE_CHANNELS, Recording, Writer, load
from hil.report import junit, words
from hil.simulator import arguments
from hil.synthesis import Plan, save, synthesise

DATA = bytes(range(256)) * 40


def one(text: str) -> Injection:
    (found,) = parse_all([text])
    return found


def arrived(text: str, cuts: list[int], seed: int = 7) -> bytes:
    """What is left of DATA, read in pieces that end at ``cuts``."""
    through = Injector(parse_all(text.split()), seed, EDGE_CHANNELS)
    ends = [0, *cuts, len(DATA)]
    return b"".join(
        data
        for start, end in pairwise(ends)
        for _, _, data in through.serial("leader", start * 1000, DATA[start:end])
    )


def test_every_part_of_the_text_is_read() -> None:
    assert one("drop:follower=1e-3@5..20#9") == Injection("drop", 1e-3, "follower", 5.0, 20.0, 9)
    assert one("drop") == Injection("drop", 1e-4)
    assert one("late@2.5") == Injection("late", 0.5, "", 2.5)
    assert one("late-edges:follower.pulse=1e-6@..3").to_s == 3.0
    assert one("clock-jump=-0.25@5").value == -0.25
    assert one("absent").stream == "follower"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "cannot be read"),
        ("gremlins", "no fault is called 'gremlins'"),
        ("drop=many", "'many' is no number"),
        ("drop=1.5", "not a share"),
        ("drop=nan", "not of the type"),
        ("drop=inf", "not of the type"),
        ("drop@9..3", "ends at 3 s"),
        ("drop:moon=0.1", "no stream 'moon'"),
        ("drop:leader.pulse", "no stream 'leader.pulse'"),
        ("swap=2", "has no value"),
        ("swap:leader", "no stream 'leader'"),
        ("clock-jump=0.1", "at one instant"),
        ("clock-jump=0.1@5..6", "at one instant"),
        ("storm=3", "a beginning and an end"),
        ("storm=2.5@1..2", "a number from 1"),
        ("late=-1", "not seconds"),
        ("drop\x1b[31m", "cannot be read"),
    ],
)
def test_what_is_no_fault_is_refused_on_one_line(text: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_all([text])
    assert says in caught.value.message
    assert caught.value.message.isprintable()


@pytest.mark.parametrize("kind", KINDS)
def test_a_scenario_keeps_what_was_written(kind: str) -> None:
    tail = {True: "@5", False: ""}[KINDS[kind].at] or ("@5..9" if KINDS[kind].span else "")
    found = one(kind + tail)
    assert from_mapping(found.to_mapping(), "test") == found
    plan = scenario.from_mapping({"name": "a", "inject": [found.to_mapping()]}, "test")
    assert plan.inject == (found,)
    assert scenario.from_mapping(scenario.to_mapping(plan), "again") == plan
    assert "{" not in found.sentence()
    assert one("clock-jump=1@0").to_mapping() == {"kind": "clock-jump", "value": 1.0, "from_s": 0.0}


@pytest.mark.parametrize("item", [7, {"kind": "drop", "volume": 3}, {"kind": "drop", "value": "x"}])
def test_a_scenario_with_no_fault_is_refused(item: object) -> None:
    with pytest.raises(ScenarioError, match="test: \\[\\[inject\\]\\]"):
        scenario.from_mapping({"name": "a", "inject": [item]}, "test")


@pytest.mark.parametrize("kind", ["drop", "duplicate", "corrupt"])
def test_bytes_do_not_depend_on_how_reads_are_cut(kind: str) -> None:
    text = f"{kind}=0.02"
    assert arrived(text, []) == arrived(text, [1, 2, 500, 501, 4000]) != DATA
    assert arrived(text, []) != arrived(text, [], seed=8) != DATA
    assert arrived(text, []) != arrived(text + "#1", [])


def test_each_kind_does_to_bytes_what_it_says() -> None:
    n = len(DATA)
    dropped, doubled = len(arrived("drop=0.1", [])), len(arrived("duplicate=0.1", []))
    # Five deviations of a binomial.
    five = 5 * math.sqrt(n * 0.1 * 0.9)
    assert abs(n - dropped - 0.1 * n) < five
    assert abs(doubled - n - 0.1 * n) < five
    assert arrived("drop=1", []) == b""
    corrupted = np.frombuffer(arrived("corrupt=0.1", []), np.uint8)
    changed = np.bitwise_count(corrupted ^ np.frombuffer(DATA, np.uint8))
    assert set(changed.tolist()) == {0, 1}
    assert abs(int(changed.sum()) - 0.1 * n) < five
    swapped = arrived("reorder=0.01", [])
    assert sorted(swapped) == sorted(DATA)
    assert swapped != DATA
    assert arrived("drop=1@0..0.000512", [512, 1024]) == DATA[512:]
    assert arrived("drop:follower=1", []) == DATA


def test_late_bytes_keep_their_order() -> None:
    through = Injector(parse_all(["late=0.5@1..2"]), 1, EDGE_CHANNELS)
    found = [
        at
        for t in (0, 1_000_000_000, 2_100_000_000, 3_000_000_000)
        for _, at, _ in through.serial("leader", t, b"x")
    ]
    assert found == [0, 1_500_000_000, 2_100_000_000, 3_000_000_000]
    through = Injector(parse_all(["late=0.5@1..2"]), 1, EDGE_CHANNELS)
    found = [
        at for t in (1_900_000_000, 2_100_000_000) for _, at, _ in through.serial("leader", t, b"x")
    ]
    assert found == [2_400_000_000, 2_400_000_000]


def test_a_reboot_is_silence_and_then_the_beginning() -> None:
    through = Injector(parse_all(["reboot:leader=2@3"]), 1, EDGE_CHANNELS)
    said = [r for s in range(10) for r in through.serial("leader", s * 10**9, bytes([s]))]
    assert [(t // 10**9, data[0]) for _, t, data in said] == [
        *((0, 0), (1, 1), (2, 2)),
        *((5, 0), (6, 1), (7, 2), (8, 3), (9, 4)),
    ]
    assert [*through.serial("follower", 9 * 10**9, b"f")] == [("follower", 9 * 10**9, b"f")]


def test_edges_by_hand() -> None:
    pulse, other = EDGE_CHANNELS.index("leader.pulse"), EDGE_CHANNELS.index("follower.pulse")
    t = np.array([1, 2, 3, 4]) * 10**9
    channel, level = np.array([pulse, other, pulse, other]), np.array([1, 1, 0, 0])

    def seen(text: str) -> list[tuple[float, int]]:
        through = Injector(parse_all([text]), 1, EDGE_CHANNELS)
        at, of, _ = through.edges(t, channel, level)
        return [(x / 1e9, int(c)) for x, c in zip(at.tolist(), of, strict=True)]

    clean = [(1, pulse), (2, other), (3, pulse), (4, other)]
    assert seen("missing-edges=0") == clean
    assert seen("missing-edges:leader=1@2") == [(1, pulse), (2, other), (4, other)]
    assert seen("late-edges:follower.pulse=0.5") == [
        (1, pulse),
        (2.5, other),
        (3, pulse),
        (4.5, other),
    ]
    assert seen("analyser-drop=0.5@1.8") == [(1, pulse), (2.5, pulse), (3.5, other)]
    assert seen("clock-jump=-0.5@2.5") == [(1, pulse), (2, other), (2.5, pulse), (3.5, other)]
    assert seen("swap") == [(1, other), (2, pulse), (3, other), (4, pulse)]
    assert seen("absent") == [(1, pulse), (3, pulse)]


def test_a_live_run_and_its_replay_are_given_the_same_faults(tmp_path: Path) -> None:
    """Written through the writer of a live run, and put into the clean recording afterwards."""
    clean = synthesise(Plan(duration_s=3.0))
    faults = parse_all(["drop=1e-3", "late-edges:follower.pulse=1e-5", "clock-jump=0.1@2"])
    named = {**clean.provenance.scenario, "inject": [f.to_mapping() for f in faults]}
    path = tmp_path / "live.mcap"
    with writer(path, replace(clean.provenance, scenario=named)) as live:
        assert isinstance(live, InjectedWriter)
        for role, stream in clean.serial.items():
            ends = [*stream.block_offset[1:].tolist(), int(stream.data.size)]
            for a, b, t in zip(stream.block_offset, ends, stream.block_t_ns_bench, strict=True):
                live.write_serial(role, int(t), stream.data[a:b].tobytes())
        e = clean.edges
        index = np.array([EDGE_CHANNELS.index(name) for name in e.channels])
        live.write_edges(e.t_ns_bench, index[e.channel], e.level)
    written, replayed = load(path), inject(clean, faults)
    for role in ("leader", "follower"):
        assert written.serial[role].data.tobytes() == replayed.serial[role].data.tobytes()
        assert written.serial[role].data.size < clean.serial[role].data.size
    for name in clean.edges.channels:
        assert np.array_equal(written.edges.select(name)[0], replayed.edges.select(name)[0])
    assert written.integrity.complete
    assert [e.data["kind"] for e in written.events] == ["drop", "late-edges", "clock-jump"]
    assert written.events[0].data["changed"]["bytes"] > 0
    assert written.provenance.injected == replayed.provenance.injected
    assert type(writer(tmp_path / "clean.mcap", clean.provenance)) is Writer


def test_only_a_live_run_can_have_a_storm(tmp_path: Path) -> None:
    save(synthesise(Plan(duration_s=2.0)), tmp_path / "a.mcap")
    with pytest.raises(ScenarioError, match="recording made earlier"):
        ReplayBackend(tmp_path / "a.mcap", inject=parse_all(["storm@1..2"])).run(
            None, None, lambda *_: None
        )
    with pytest.raises(ScenarioError, match="into boards"):
        refuse_unless_possible(parse_all(["flash"]), "bench")


def test_a_storm_is_commands_that_nobody_asked_for() -> None:
    plan = scenario.from_mapping(
        {
            "name": "a",
            "link_drops": [{"at_s": 7}],
            "inject": [{"kind": "storm", "value": 4, "from_s": 5, "to_s": 9}],
        },
        "test",
    )
    found = [(c.at_s, c.injected) for c in commands.planned(plan, "leader")]
    assert found == [(5, True), (6, True), (7, False), (7, True), (8, True)]
    assert commands.planned(plan, "follower") == []


def test_an_absent_follower_is_not_started() -> None:
    plan = scenario.Scenario("a", inject=parse_all(["absent"]))
    assert arguments.started(plan) == ("leader",)
    assert arguments.started(scenario.Scenario("a")) == ("leader", "follower")


def test_bits_are_turned_where_something_is_written(tmp_path: Path) -> None:
    flash = tmp_path / "flash"
    flash.write_bytes(b"\xff" * 500 + bytes(8) + b"\xff" * 500)
    assert nodes.turn_bits(flash, 5, (1, 2)) == 5
    content = flash.read_bytes()
    assert sum(byte.bit_count() for byte in content[500:508]) == 5
    assert content[:500] + content[508:] == b"\xff" * 1000


# --- never taken for a clean run ---------------------------------------------------------------


GOOD = Measurement("link.noise_bytes", 0.0, "1", Limits(None, 0.0), "L2", "counted in the stream")


@pytest.fixture(scope="module")
def injected() -> Recording:
    return inject(synthesise(Plan(duration_s=2.0)), parse_all(["drop=0"]))


def test_every_view_says_so(injected: Recording) -> None:
    assert injected.name.endswith(" + drop")
    document = report.build([report.Result(injected, [GOOD])])
    (entry,) = document["recordings"]
    assert entry["injected"] == "faults were injected: a share of 0 of the bytes is lost"
    assert (entry["outcome"], document["outcome"]) == ("inconclusive", "inconclusive")
    assert document["verdict"] == "inconclusive"
    assert "No check noticed that faults were injected" in entry["outcome_reason"]
    assert words.run_title(entry) == "Inconclusive, faults injected"
    assert words.run_verdict(entry) == "inconclusive"
    assert entry["injected"] in report.html.render(document)
    xml = junit.render(document)
    assert b"unnoticed" in xml if isinstance(xml, bytes) else "unnoticed" in xml


def test_a_clean_run_says_nothing_of_faults() -> None:
    document = report.build([report.Result(synthesise(Plan(duration_s=2.0)), [GOOD])])
    (entry,) = document["recordings"]
    assert (entry["injected"], entry["outcome"]) == ("", "pass")
    assert "faults were injected" not in report.html.render(document)


def test_a_provenance_that_lies_about_its_faults_is_no_clean_run() -> None:
    clean = synthesise(Plan(duration_s=2.0))
    for lie in ([{"kind": "\x1b"}], [3], "drop", {"a": 1}):
        about = replace(clean.provenance, scenario={**clean.provenance.scenario, "inject": lie})
        assert about.injected
        assert in_words(about.scenario).startswith("faults were injected")
        assert in_words(about.scenario).isprintable()
