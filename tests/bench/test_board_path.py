# SPDX-License-Identifier: Apache-2.0
"""``pytest --board`` on today's firmware without hardware. Needs a Zephyr workspace.

The firmware runs on the simulated bench first; the virtual boards then say and do the same, so
that the whole path meets the present protocol and the whole suite.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from hil import checks, run, scenario
from hil.backends.sim import SimBackend
from hil.build import BabbleSim, Manifest, build_images, find_babblesim, find_workspace
from hil.errors import BuildError
from hil.measure import Verdict
from hil.recording import Recording
from hil.wire.messages import ROLES
from tests.bench.virtual.live import LiveWorld
from tests.bench.virtual.play import ROOT
from tests.bench.virtual.world import World

DURATION_S = 10.0

pytestmark = pytest.mark.timeout(3600)


PLAN = dataclasses.replace(
    scenario.load(ROOT / "fixtures/scenarios/clean-7ms5.toml"), duration_s=DURATION_S + 3.0
)


@pytest.fixture(scope="module")
def babblesim() -> BabbleSim:
    try:
        return find_babblesim(find_workspace())
    except BuildError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def images(babblesim: BabbleSim) -> Mapping[str, Manifest]:
    return build_images(PLAN.kconfig, "sim")


@pytest.fixture(scope="module")
def today(images: Mapping[str, Manifest], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A run of the firmware as it is now."""
    output = tmp_path_factory.mktemp("sim") / "today.mcap"
    return SimBackend(images=images).run(PLAN, output, lambda share, what: None)


def test_todays_firmware_passes_the_whole_suite_on_the_virtual_bench(
    today: Recording, tmp_path: Path
) -> None:
    with World(tmp_path / "w", today) as world:
        world.bench_file()
        status, said = world.run(*world.suite(DURATION_S, "--hil-report", "out"))
        assert status == 0, said
    assert " passed" in said
    report = json.dumps(json.loads((world.project / "out/report.json").read_text()))
    assert "pulses seen by the analyser on both nodes" in report
    assert "rising edges of INT1 on the analyser" in report


def test_commands_reach_boards_that_run(
    babblesim: BabbleSim,
    images: Mapping[str, Manifest],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The simulated nodes live behind the serial ports: they obey, and the checks see it."""
    long = dataclasses.replace(PLAN, duration_s=120.0)
    with LiveWorld(tmp_path / "w", babblesim, images, long) as world:
        world.install(monkeypatch)
        more = "[[link_drops]]\nat_s = 5.0\nhold_ms = 100\n"
        more += "[nodes.follower]\nimu = { odr_hz = 833 }\n"
        options = run.BenchOptions(world.bench_file(analyser=False), world.images())
        recording = run.live(
            "bench",
            world.scenario(10.0, more),
            None,
            tmp_path / "recording.mcap",
            lambda share, what: None,
            bench=options,
        )
    captures = recording.decoded("leader").messages["sync_capture"]
    assert len(set(captures["generation"].tolist())) == 2
    stats = recording.decoded("follower").messages["fifo_stats"]
    assert stats["odr_hz"][-1] == pytest.approx(833, rel=1e-3)
    found = {m.name: m for m in checks.evaluate(recording)}
    # What a simulation that falls behind real time cannot spoil.
    told = ["sync.reconnects", "sync.pairs_wrong", "link.frames_lost", "link.noise_bytes"]
    told += ["imu.follower_at_leader.samples_lost", "imu.follower_at_leader.samples_altered"]
    for role in ROLES:
        told += [f"node.{role}.hello_errors", f"node.{role}.restarts", f"imu.{role}.restarts"]
    assert {name: found[name].verdict for name in told} == dict.fromkeys(told, Verdict.PASS)
