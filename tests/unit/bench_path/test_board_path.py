# SPDX-License-Identifier: Apache-2.0
"""``pytest --board`` from an empty bench file to the report, on a bench without hardware."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil import library
from hil.bench import lock
from hil.plugin import EXIT_RIG_FAILURE
from hil.recording import load
from tests.bench.virtual.play import ROOT
from tests.bench.virtual.world import SERIALS, World

SUITE = ROOT / "tests/hil"


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with World(tmp_path / "w") as bench:
        yield bench


def run_folder(world: World) -> Path:
    return world.project / "build/runs/bench/virtual"


def test_the_whole_path_as_a_user_goes_it(world: World) -> None:
    """Also: a second run is told who has the bench, and does not disturb the first."""
    status, said = world.run("hil", "bench", "init", "--leader", SERIALS["leader"])
    assert status == 0, said
    assert "├──────┤ D0           D3 ├──────┤" in said

    _, said = world.run("hil", "doctor", "--json")
    checks = {check["name"]: check for check in json.loads(said)["checks"]}
    of_the_bench = [
        *(f"{what} {role}" for what in ("probe", "port", "chip", "firmware") for role in SERIALS),
        *("bench file", "bench lock", "analyser", "wire leader.pulse", "wire follower.imu_int1"),
    ]
    assert {n: checks[n]["verdict"] for n in of_the_bench} == dict.fromkeys(of_the_bench, "pass")

    first = world.start(*world.suite(6.0, "--hil-report", "out"))
    bench_file = world.project / "boards/bench.toml"
    deadline_s = time.monotonic() + 20
    while lock.owner_of(bench_file) is None and time.monotonic() < deadline_s:
        time.sleep(0.05)
    status, told = world.run(*world.suite(6.0, "-k", "wrap"))
    assert status == EXIT_RIG_FAILURE
    assert f"(pid {first.pid}, " in told
    assert "--lock-wait" in told
    said, _ = first.communicate(timeout=60)
    assert first.returncode == 0, said
    assert " passed" in said

    recording = load(run_folder(world) / library.FILE_NAME)
    assert recording.provenance.source == "bench"
    assert recording.integrity.complete
    flashed = {e.node: e.data for e in recording.events if e.kind == "flash"}
    assert {role: flashed[role]["programmed"] for role in SERIALS} == dict.fromkeys(SERIALS, True)
    for role, probe in world.probes.items():
        assert probe.log.count("program") == 1
        assert probe.log[-1] == "reset system"
        assert recording.provenance.manifests[role]["build_id"] == world.tape.build_ids[role]
    # What is only known in simulation is unset, with its reason; the edges were judged.
    report = json.loads((world.project / "out/report.json").read_text())
    text = json.dumps(report)
    assert "does not know the crystals" in text
    assert re.search(r"pulses seen by the analyser on both nodes.*resolution 125 ns", text)
    # The samples of a sound capture are not kept, and nothing is left of the run.
    assert [p.name for p in run_folder(world).iterdir()] == [library.FILE_NAME]
    assert sorted(p.name for p in bench_file.parent.iterdir()) == ["bench.toml"]


def test_a_faulty_image_fails_as_a_product(tmp_path: Path) -> None:
    with World(tmp_path / "w", "faulty") as world:
        world.bench_file()
        status, said = world.run(*world.suite(5.5, "--hil-report", "out"))
    assert status == 1, said
    assert "FAIL sync.skew_vs_refit_ppb" in said
    assert "FAIL sync.edge_error_p99_ns" in said
    assert (world.project / "out/index.html").exists()


def test_a_cable_that_is_pulled_is_the_rigs_failure_and_nobody_elses(world: World) -> None:
    world.bench_file()

    def kick() -> None:
        world.unplug("follower")
        time.sleep(0.5)
        world.plug("follower")

    program = world.start(*world.suite(3.0))
    mark = world.project / "boards/.bench.toml.unfinished"
    recording = run_folder(world) / library.FILE_NAME
    while not recording.exists() and program.poll() is None:
        time.sleep(0.05)
    timer = threading.Timer(1.0, kick)
    timer.start()
    said, _ = program.communicate(timeout=60)
    timer.join()
    assert program.returncode == EXIT_RIG_FAILURE, said
    assert re.search(r"the follower's serial port was gone for \d\.\d s", said)
    assert " failed" not in said.splitlines()[-1]
    assert " skipped" not in said.splitlines()[-1]
    kept = load(recording)
    assert not kept.integrity.complete
    assert kept.decoded("leader").messages["hello"].size
    assert [event.node for event in kept.events if event.kind == "gap"] == ["follower"]
    assert mark.exists()
    # The next run starts the boards through their pins first, and clears the mark.
    status, said = world.run(*world.suite(1.0, "-k", "wrap"))
    assert "reset pin" in world.probes["leader"].log
    assert status in (0, 1), said
    assert not mark.exists()


@pytest.mark.parametrize(
    ("command", "status"),
    [
        (["pytest", str(SUITE), "--board", "-c", "pytest.ini", "--rootdir", "."], 4),
        (["hil", "bench", "show"], 2),
        (["hil", "doctor"], 10),
        (["hil", "record", str(ROOT / "fixtures/scenarios/clean-7ms5.toml"), "-o", "x"], 10),
    ],
)
def test_without_a_bench_each_command_ends_soon_and_says_what_to_do(
    tmp_path: Path, command: list[str], status: int
) -> None:
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {ROOT}\n")
    program, *rest = command
    more = ["--board", "bench"] if "record" in command else []
    start_s = time.monotonic()
    done = subprocess.run(
        [str(Path(sys.executable).parent / program), *rest, *more],
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if k != "HIL_BOARD"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert time.monotonic() - start_s < 10
    assert done.returncode == status, done.stdout + done.stderr
    assert "hil bench init" in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "x").exists()
