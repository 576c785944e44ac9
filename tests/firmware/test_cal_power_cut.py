# SPDX-License-Identifier: Apache-2.0
"""The power fails at every operation on the flash that saving a calibration takes.

Whatever had come through, the node starts again with the old record or with the new one, whole.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil import build
from hil.bench.port import SerialPort
from hil.build import BabbleSim, Manifest
from hil.calibration.tool.unit import Unit
from hil.motion.imu_model import IDEAL, draw_errors
from hil.simulator.desk import Desk
from hil.wire.codec import encode
from hil.wire.messages import CAL_ORIGINS

SAVES_MAX = 400
"""Enough to come around all sectors of the store."""
CUT_LIMIT_S = 20.0


@dataclass(frozen=True)
class Bench:
    """What the desks of this file have in common."""

    babblesim: BabbleSim
    executable: Path
    folder: Path

    @contextmanager
    def desk(self, flash: Path, *options: str) -> Iterator[tuple[Desk, Unit, SerialPort]]:
        still = draw_errors(np.random.default_rng(0), IDEAL)
        with (
            Desk(self.babblesim, self.executable, still, flash=flash, options=options) as desk,
            SerialPort(desk.port) as port,
        ):
            unit = Unit(port, "follower")
            unit.connect()
            yield desk, unit, port


def record(number: int, device_id: int) -> dict[str, Any]:
    """A record that no other number gives."""
    return {
        "device_id": device_id,
        "created_unix_s": 1_700_000_000 + number,
        "temperature_cdegc": 2500,
        "accel_bias_mps2": [float(np.float32(0.001 * number)), -0.25, 0.125],
        "accel_matrix": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "gyro_bias_radps": [0.0, float(np.float32(1e-4 * number)), 0.0],
    }


@pytest.fixture(scope="module")
def bench(images: Mapping[str, Manifest], tmp_path_factory: pytest.TempPathFactory) -> Bench:
    babblesim = build.find_babblesim(build.find_workspace(None))
    # The follower does not scan: less for the simulation to do.
    return Bench(babblesim, images["follower"].file("exe"), tmp_path_factory.mktemp("flash"))


def operations(log: Path) -> list[str]:
    """``write`` or ``erase`` for each operation on the flash so far."""
    return [line.split(",")[2] for line in log.read_text(encoding="ascii").splitlines()]


@dataclass(frozen=True)
class Save:
    """A save to be cut: the flash before it, what is in it, what is saved, what that takes."""

    flash: Path
    old: int
    new: int
    operations: list[str]


@pytest.fixture(scope="module")
def saves(bench: Bench) -> dict[str, Save]:
    """The second save of all, and the one that comes around to the first sector."""
    flash, log = bench.folder / "worn.bin", bench.folder / "worn.log"
    found: dict[str, Save] = {}
    with bench.desk(flash, f"-hil_flash_log={log}") as (_, unit, _):
        device_id = int(unit.hello["device_id"])
        unit.write_record(record(1, device_id))
        for number in range(2, SAVES_MAX):
            before = bench.folder / f"before-{number}.bin"
            shutil.copy(flash, before)
            begun = len(operations(log))
            unit.write_record(record(number, device_id))
            done = operations(log)[begun:]
            if number == 2:
                found["plain"] = Save(before, 1, 2, done)
            elif "erase" in done:
                found["around"] = Save(before, number - 1, number, done)
                return found
            else:
                before.unlink()
    pytest.fail(f"{SAVES_MAX} saves never erased a sector: the store has not come around")


@pytest.mark.parametrize("which", ["plain", "around"])
def test_a_cut_leaves_the_old_or_the_new_record(
    bench: Bench, saves: dict[str, Save], which: str
) -> None:
    save = saves[which]
    assert ("erase" in save.operations) == (which == "around")
    count = len(save.operations)
    assert count >= 20
    starting = operations_of_start(bench, save)
    cuts = [(n, how) for n in range(1, count + 1) for how in ("before", "torn")]
    cuts.append((count, "after"))
    # The cores are two, and a desk mostly waits for its processes to start.
    with ThreadPoolExecutor(2) as pool:
        left = list(pool.map(lambda cut: cut_at(bench, save, starting, *cut), cuts))
    assert set(left) == {save.old, save.new}, list(zip(cuts, left, strict=True))
    assert left[0] == save.old
    assert left[-1] == save.new


def operations_of_start(bench: Bench, save: Save) -> int:
    """What starting does to the flash: from there on the operations of a save are counted."""
    flash = bench.folder / f"start-{save.new}.bin"
    shutil.copy(save.flash, flash)
    log = flash.with_suffix(".log")
    with bench.desk(flash, f"-hil_flash_log={log}"):
        return len(operations(log))


def cut_at(bench: Bench, save: Save, starting: int, number: int, how: str) -> int:
    """Cut the save at its ``number``-th operation; the number of the record that is left."""
    flash = bench.folder / f"cut-{save.new}-{number}-{how}.bin"
    shutil.copy(save.flash, flash)
    with bench.desk(flash, f"-hil_flash_cut={starting + number}:{how}") as (desk, unit, port):
        device_id = int(unit.hello["device_id"])
        port.write(encode("cal_record", record(save.new, device_id), 0))
        assert desk.wait_power_cut(CUT_LIMIT_S), f"not cut at operation {number}, {how}"
    with bench.desk(flash) as (_, unit, _):
        found = unit.read_record()
        assert found is not None, f"no record after a cut {how} operation {number}"
        assert unit.status == {} or unit.status["origin"] == CAL_ORIGINS["stored"]
    left = int(found["created_unix_s"]) - 1_700_000_000
    for name, value in record(left, device_id).items():
        np.testing.assert_array_equal(found[name], np.asarray(value, found[name].dtype))
    flash.unlink()
    return left


def test_without_a_cut_the_new_record_is_there(bench: Bench, saves: dict[str, Save]) -> None:
    """The same desk with nothing made to fail: the cut is what the other tests see."""
    flash = bench.folder / "uncut.bin"
    shutil.copy(saves["plain"].flash, flash)
    with bench.desk(flash) as (_, unit, _):
        unit.write_record(record(7, int(unit.hello["device_id"])))
    with bench.desk(flash) as (_, unit, _):
        found = unit.read_record()
        assert found is not None
        assert int(found["created_unix_s"]) == 1_700_000_007
