# SPDX-License-Identifier: Apache-2.0
"""The real simulator with the real firmware, for a few seconds. Needs a Zephyr workspace."""

from __future__ import annotations

import dataclasses
import os
import pwd
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from hil import scenario
from hil.backends.sim import SimBackend
from hil.build import Manifest, build, build_images, find_babblesim, find_workspace
from hil.errors import BuildError
from hil.recording import Recording
from hil.recording.clock import ClockModel

ROOT = Path(__file__).parents[2]
SCENARIO = dataclasses.replace(
    scenario.load(ROOT / "fixtures" / "scenarios" / "clean-7ms5.toml"), duration_s=4.0
)

pytestmark = pytest.mark.timeout(3600)


def silent(share: float, what: str) -> None:
    """Nobody watches."""


@pytest.fixture(scope="module")
def images() -> Mapping[str, Manifest]:
    try:
        find_babblesim(find_workspace())
    except BuildError as error:
        pytest.skip(str(error))
    return build_images(SCENARIO.kconfig, "sim")


@pytest.fixture(scope="module")
def run(images: Mapping[str, Manifest], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    output = tmp_path_factory.mktemp("live") / "first.mcap"
    return SimBackend(images=images).run(SCENARIO, output, silent)


def test_images_carry_their_build_id(run: Recording, images: Mapping[str, Manifest]) -> None:
    for role, image in images.items():
        hello = run.decoded(role).messages["hello"]
        assert set(hello["build_id"].tolist()) == {int(image.build_id, 16)}
        assert image.warnings == ()


def test_an_unchanged_image_is_not_built_again(images: Mapping[str, Manifest]) -> None:
    start_s = time.monotonic()
    assert build("leader", "sim").unchanged
    assert time.monotonic() - start_s < 3


def test_no_byte_is_lost(run: Recording) -> None:
    assert run.integrity.complete
    for role in run.roles:
        stats = run.decoded(role).stats
        assert stats.frames > 300
        assert (stats.crc_errors, stats.lost, stats.noise_bytes) == (0, 0, 0)


def test_bytes_take_the_time_of_the_line(run: Recording) -> None:
    """At 1 Mbaud a byte with its start and stop bit takes 10 us of the node's own time."""
    for role in run.roles:
        stream = run.serial[role]
        clock = ClockModel.from_mapping(run.provenance.scenario["nodes"][role])
        local_us = np.rint(clock.local_us(stream.block_t_ns_bench * 1e-3))
        sizes = np.diff(np.append(stream.block_offset, len(stream.data)))
        elapsed_us = np.diff(local_us)
        assert np.all(elapsed_us >= 10 * sizes[1:] - 1)
        assert np.any(elapsed_us <= 10 * sizes[1:] + 1)


def test_pulses_of_the_leader_come_when_the_firmware_says(run: Recording) -> None:
    """Firmware time, crystal model and pin log agree: the whole chain of clocks is right."""
    pulses = run.decoded("leader").messages["pulse"]
    t_ns, level = run.edges.select("leader.pulse")
    rising_us = run.truth["leader"].local_us(t_ns[level == 1] * 1e-3)
    compare_us = pulses["compare_ticks_node"] / 16.0
    # The timer starts at a fixed moment after boot; the pin log is floored to 1 us.
    offset_us = rising_us[: len(compare_us)] - compare_us[: len(rising_us)]
    assert len(offset_us) > 30
    assert np.ptp(offset_us) <= 1.01


def test_the_same_scenario_gives_the_same_bytes(
    run: Recording, images: Mapping[str, Manifest], tmp_path: Path
) -> None:
    again = SimBackend(images=images).run(SCENARIO, tmp_path / "again.mcap", silent)
    for role in run.roles:
        assert bytes(again.serial[role].data) == bytes(run.serial[role].data)
    assert np.array_equal(again.edges.t_ns_bench, run.edges.t_ns_bench)


RUN = """
import sys
from pathlib import Path
from hil import scenario
from hil.backends.sim import SimBackend
plan = scenario.load(Path(sys.argv[1]))
SimBackend().run(plan, Path(sys.argv[2]), lambda share, what: print(what, flush=True))
"""


@pytest.mark.usefixtures("images")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_nothing_is_left_of_a_killed_run(tmp_path: Path, number: signal.Signals) -> None:
    plan = ROOT / "fixtures" / "scenarios" / "clean-7ms5.toml"
    user = pwd.getpwuid(os.geteuid()).pw_name
    with subprocess.Popen(
        [sys.executable, "-c", RUN, plan, tmp_path / "killed.mcap"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as owner:
        assert owner.stdout is not None
        mark = f"hil-{owner.pid}-"
        for line in owner.stdout:
            if line.startswith("simulated") and not line.startswith("simulated 0.0"):
                break
        assert traces(mark, user)
        owner.send_signal(number)
        owner.wait(30)
    deadline_s = time.monotonic() + 15
    while left := traces(mark, user):
        assert time.monotonic() < deadline_s, f"left behind: {left}"
        time.sleep(0.1)


def traces(mark: str, user: str) -> list[str]:
    """Processes, shared folders and temporary folders of a simulation."""
    found = [str(path) for path in Path(f"/tmp/bs_{user}").glob(f"{mark}*")]
    found += [str(path) for path in Path(tempfile.gettempdir()).glob(f"{mark}*")]
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            text = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if f"-s={mark}" in text:
            found.append(text)
    return found
