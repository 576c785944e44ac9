# SPDX-License-Identifier: Apache-2.0
"""The bench as a source of recordings: what it refuses, what it keeps, what it leaves unset."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hil import checks, run
from hil.bench.analyser.sr_file import open_sr
from hil.errors import BuildError, RigError
from hil.faults import parse_all
from hil.measure import Measurement, Verdict
from hil.recording import Recording, load
from hil.wire.codec import decode
from tests.bench.virtual.world import SERIALS, WIRED, World


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    with World(tmp_path / "w") as bench:
        bench.install(monkeypatch)
        yield bench


def silent(share: float, what: str) -> None:
    pass


def record(
    world: World, duration_s: float, bench_file: Path, images: Path | None = None, text: str = ""
) -> Recording:
    scenario = world.scenario(duration_s, text)
    options = run.BenchOptions(bench_file, images or world.images())
    output = world.project / "run/recording.mcap"
    return run.live("bench", scenario, None, output, silent, bench=options)


def judged(recording: Recording) -> dict[str, Measurement]:
    return {m.name: m for m in checks.evaluate(recording)}


def test_ports_of_exchanged_boards_are_refused_by_what_hello_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with World(tmp_path / "w", exchanged=True) as world:
        world.install(monkeypatch)
        with pytest.raises(RigError, match="it says that it is the follower") as caught:
            record(world, 2.0, world.bench_file(analyser=False))
    assert "leader: it runs on chip 5555666677778888; the probe sees 1111222233334444" in str(
        caught.value
    )
    assert "vcom" in caught.value.mend
    assert "hil bench init --force" in caught.value.mend
    kept = load(world.project / "run/recording.mcap")
    assert not kept.integrity.complete
    assert "it says that it is the follower" in " ".join(kept.integrity.problems)


def test_boards_that_the_bench_file_takes_for_each_other_are_refused(world: World) -> None:
    """Probes, and so the ports and the images, are named crosswise."""
    bench_file = world.bench_file(analyser=False)
    text = bench_file.read_text()
    leader, follower = SERIALS.values()
    text = text.replace(leader, "X").replace(follower, leader).replace("X", follower)
    bench_file.write_text(text)
    with pytest.raises(RigError, match="leader: it says that it is the follower"):
        record(world, 2.0, bench_file)
    kept = load(world.project / "run/recording.mcap")
    assert not kept.integrity.complete


def test_swapped_boards_that_nothing_refused_are_caught_by_the_checks(world: World) -> None:
    """The fault ``swap`` comes after the rig's own look at who is who."""
    options = run.BenchOptions(world.bench_file(analyser=False), world.images())
    output = world.project / "run/recording.mcap"
    recording = run.live(
        *("bench", world.scenario(4.0), None, output, silent),
        bench=options,
        inject=parse_all(["swap"]),
    )
    assert recording.provenance.injected
    found = judged(recording)
    for name in ("node.leader.hello_errors", "node.follower.hello_errors"):
        assert found[name].verdict is Verdict.FAIL


def test_firmware_of_another_build_is_refused(world: World) -> None:
    stale = world.images(build_id="00000000deadbeef")
    with pytest.raises(RigError, match="flashed was 00000000deadbeef") as caught:
        record(world, 2.0, world.bench_file(analyser=False), stale)
    assert "hil bench flash --always" in caught.value.mend


def test_images_that_the_scenario_does_not_want(world: World) -> None:
    with pytest.raises(BuildError, match="wants the leader built with"):
        record(world, 1.0, world.bench_file(), text="[firmware.leader]\nBV_CONN_INTERVAL = 24\n")
    assert all("program" not in probe.log for probe in world.probes.values())
    with pytest.raises(BuildError, match="no image of the leader"):
        record(world, 1.0, world.bench_file(), world.project)


def test_a_coarse_analyser_leaves_the_edges_inconclusive(world: World) -> None:
    bench_file = world.bench_file(samplerate_hz=200_000)
    # The simulated sensor's interrupt is shorter than a sample.
    kept = [line for line in bench_file.read_text().splitlines() if "imu_int1" not in line]
    bench_file.write_text("\n".join(kept))
    recording = record(world, 5.5, bench_file)
    assert recording.edges.resolution_ns == 5000.0
    found = judged(recording)
    # Limit 1000 ns, uncertainty 5000 ns: neither sound nor faulty.
    assert found["sync.edge_error_max_ns"].verdict is Verdict.INCONCLUSIVE
    assert found["sync.model_vs_refit_p99_ns"].verdict is Verdict.PASS


def test_without_an_analyser_what_needs_edges_is_unset_and_says_why(world: World) -> None:
    bench_file = world.bench_file(analyser=False)
    drop = "[[link_drops]]\nat_s = 2.5\nhold_ms = 30\n[motion]\nlift = 'bench'\n"
    drop += "[nodes.follower]\ndrift_ppm = 20.0\nimu = { odr_hz = 833, temperature_degc = 40.0 }\n"
    recording = record(world, 4.8, bench_file, text=drop)
    assert recording.integrity.complete
    found = judged(recording)
    for name in ("sync.edge_error_p99_ns", "sync.edge_error_max_ns", "sync.edges_alone"):
        assert found[name].verdict is Verdict.UNSET
        assert "no analyser channel watched the pulse pins" in found[name].how
    assert "no analyser channel watched INT1" in found["imu.leader.int1_error_p99_us"].how
    assert found["sync.pulses_missing"].verdict is Verdict.PASS
    # Commands went to their boards and nowhere else, the settings as soon as it had booted.
    heard = {role: decode(bytes(data)).messages for role, data in world.heard.items()}
    assert heard["leader"]["link_drop"]["hold_ms"].tolist() == [30]
    assert heard["follower"]["imu_setup"]["odr_hz"].tolist() == [833]
    assert heard["follower"]["link_drop"].size == heard["leader"]["imu_setup"].size == 0
    at = {event.kind: event for event in recording.events}
    assert 2.5e9 <= at["disconnect"].t_ns_bench < 2.6e9
    assert at["imu_setup"].node == "follower"
    assert at["imu_setup"].t_ns_bench < 0.5e9
    # What no board can do is not claimed.
    assert at["not_applied"].data["parts"] == [
        *("the crystals", "the motion 'bench'", "the sensor's clock, noise and temperature")
    ]
    assert recording.provenance.scenario["motion"] == {}
    assert "Only a simulation can do" in recording.provenance.notes
    # Nothing that was said before the reset is in the recording.
    hello = recording.decoded("leader").messages["hello"]
    assert hello["uptime_ms"][0] == 0
    assert np.all(np.diff(hello["uptime_ms"].astype(np.int64)) > 0)


def test_wires_that_are_swapped_make_the_capture_unbelievable(world: World) -> None:
    bench_file = world.bench_file()
    text = bench_file.read_text()
    text = text.replace('D0 = "leader.radio_end"', 'D0 = "leader.pulse"')
    text = text.replace('D1 = "leader.pulse"', 'D1 = "leader.radio_end"')
    bench_file.write_text(text)
    with pytest.raises(RigError, match="not to be believed") as caught:
        record(world, 3.0, bench_file)
    assert "leader.pulse has no pulses of 0.5 ms; they are on leader.radio_end" in str(caught.value)
    assert "swap the wires of leader.pulse and leader.radio_end" in caught.value.mend
    kept = load(world.project / "run/recording.mcap")
    assert not kept.integrity.complete
    assert next(e.data["findings"] for e in kept.events if e.kind == "analyser")
    # What the analyser saw is kept, to look into it.
    capture = open_sr(world.project / "run/analyser.sr")
    assert capture.channels["leader.pulse"] == WIRED.index("leader.radio_end")
