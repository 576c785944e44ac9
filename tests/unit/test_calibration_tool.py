# SPDX-License-Identifier: Apache-2.0
"""The guided calibration against a unit made in Python, in that unit's own time.

Truth is the chip model's: its scale, bias and rate are known exactly.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from hil import cli
from hil.calibration import record as records
from hil.calibration.record import Record
from hil.calibration.tool import command, guide
from hil.calibration.tool.screen import Screen
from hil.calibration.tool.unit import Unit
from hil.errors import HilError, RigError
from hil.simulator.hands import UP
from hil.wire.codec import encode
from tests.unit.fake_unit import DEVICE_ID, G_MPS2, FakeUnit, Values, Wrong

MG = 1e-3 * G_MPS2
PLAN = guide.Plan(rest_s=5.0)

pytestmark = pytest.mark.filterwarnings("error")


@dataclass
class Run:
    """One ``hil calibrate``: who is there, what the screen shows, where records go."""

    unit: FakeUnit
    folder: Path
    plan: guide.Plan = PLAN
    yes: bool = True
    terminal: bool = False
    role: str = "leader"
    screen: io.StringIO = field(default_factory=io.StringIO)
    helper: Callable[[Any], None] | None = None

    def __call__(self, **options: Any) -> str:
        console = Console(file=self.screen, force_terminal=self.terminal, width=80, no_color=True)
        command.calibrate(
            self.unit,
            self.role,
            self.plan,
            Screen(console, self.yes),
            helper=self.helper or (lambda face: self.unit.turn(UP[face])),
            folder=self.folder,
            now_s=self.unit.now_s,
            **options,
        )
        return self.shown

    @property
    def shown(self) -> str:
        return self.screen.getvalue()

    @property
    def saved(self) -> list[Record]:
        """All records on disk; that each is readable is part of every test that looks."""
        return [records.load(path) for path in sorted(self.folder.glob("*"))]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return Run(FakeUnit(), tmp_path / "records")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record of the fake unit, as a run leaves it."""
    run = Run(FakeUnit(), tmp_path_factory.mktemp("good"))
    run()
    return next(run.folder.glob("*.json"))


def old_record() -> Values:
    """What was stored before."""
    return {
        "device_id": DEVICE_ID,
        "created_unix_s": 1_700_000_000,
        "temperature_cdegc": 2500,
        "accel_bias_mps2": [0.125, 0.25, -0.5],
        "accel_matrix": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "gyro_bias_radps": [0.0, 0.0, 0.0],
    }


# The whole way -------------------------------------------------------------------------------


@pytest.mark.parametrize(("role", "seed"), [("leader", 1), ("leader", 5), ("follower", 2)])
def test_a_guided_run_finds_the_chip_and_stores_it(tmp_path: Path, role: str, seed: int) -> None:
    run = Run(FakeUnit(role, seed=seed), tmp_path, role=role)
    shown = run()
    (saved,) = run.saved
    stored, chip = run.unit.stored, run.unit.errors
    assert stored is not None
    scale = 1.0 / np.array(stored["accel_matrix"])[[0, 4, 8]]
    np.testing.assert_allclose(scale, np.diag(chip.accel_matrix), atol=1e-3)
    np.testing.assert_allclose(stored["accel_bias_mps2"], chip.accel_bias_mps2, atol=MG)
    np.testing.assert_allclose(
        stored["gyro_bias_radps"], chip.gyro_bias_radps, atol=np.radians(0.02)
    )
    # The raw chip is outside of all three, or nothing would be shown by being inside.
    assert np.abs(np.diag(chip.accel_matrix) - 1.0).max() > 1e-3
    assert np.abs(chip.accel_bias_mps2).max() > MG
    assert np.abs(chip.gyro_bias_radps).max() > np.radians(0.02)
    assert stored["temperature_cdegc"] == 2650
    assert (saved.device_id, saved.role) == ("0123456789abcdef", role)
    assert [pose.face for pose in saved.poses] == ["+x", "-x", "+y", "-y", "+z", "-z"]
    np.testing.assert_allclose(
        stored["accel_matrix"], saved.calibration.accel_matrix.ravel(), rtol=1e-7, atol=1e-9
    )
    assert run.unit.heard == ["cal_read", "raw_on", "raw_off", "cal_record", "reboot"]
    assert (run.unit.raw, run.unit.boots) == (False, 2)
    assert "calibration: defaults (record absent)" in shown
    assert "boot check: applied" in shown
    assert str(tmp_path / saved.path.name) in shown


def test_ten_positions_find_the_skew_too(tmp_path: Path) -> None:
    corners = iter([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
    run = Run(FakeUnit(), tmp_path, replace(PLAN, poses=10))
    run.helper = lambda face: run.unit.turn(UP[face] if face else next(corners))
    run()
    assert run.unit.stored is not None
    matrix = np.array(run.unit.stored["accel_matrix"]).reshape(3, 3)
    up = np.random.default_rng(0).standard_normal((500, 3))
    true = G_MPS2 * up / np.linalg.norm(up, axis=1, keepdims=True)
    chip = run.unit.errors
    raw = true @ chip.accel_matrix.T + chip.accel_bias_mps2
    found = (raw - np.array(run.unit.stored["accel_bias_mps2"])) @ matrix.T
    assert np.abs(np.linalg.norm(found, axis=1) / G_MPS2 - 1.0).max() < 5e-4
    assert np.abs(np.linalg.norm(raw, axis=1) / G_MPS2 - 1.0).max() > 5e-3


def test_a_stored_calibration_is_named_and_compared(run: Run) -> None:
    run.unit = FakeUnit(stored=old_record())
    shown = run()
    assert "calibration: stored, of 2023-11-14 22:13:20 UTC" in shown  # 1.7e9 s
    assert "until now, g" in shown


# What is not written -------------------------------------------------------------------------


@pytest.mark.parametrize("answer", ["n", "", "gone"])
def test_without_a_yes_nothing_is_written(
    run: Run, monkeypatch: pytest.MonkeyPatch, answer: str
) -> None:
    def ask(*_: object) -> str:
        if answer == "gone":
            raise EOFError
        return answer

    monkeypatch.setattr("builtins.input", ask)
    run.yes, run.terminal = False, True
    shown = run()
    assert "nothing was written; the unit keeps the calibration it had" in shown
    assert run.unit.heard == ["cal_read", "raw_on", "raw_off"]
    assert not run.folder.exists()


def test_a_yes_at_the_terminal_writes(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("builtins.input", lambda *_: "y")
    run.yes, run.terminal = False, True
    assert "Write this calibration to the leader 0123456789abcdef?" in run()
    assert run.unit.stored is not None


@pytest.mark.parametrize("how", ["measured", "from", "to defaults"])
def test_a_dry_run_writes_nothing_anywhere(run: Run, good: Path, tmp_path: Path, how: str) -> None:
    options: dict[str, Any] = {}
    if how == "from":
        options["source"] = good
    if how == "to defaults":
        options["to_defaults"] = tmp_path / "cal.conf"
    run.yes = False  # and asks nothing
    shown = run(dry_run=True, **options)
    assert "dry run: nothing was written" in shown
    assert "scale error" in shown
    assert not set(run.unit.heard) & {"cal_record", "cal_erase", "reboot"}
    assert not run.unit.raw
    assert list(tmp_path.iterdir()) == []


def test_without_a_terminal_it_is_refused_before_any_work(run: Run) -> None:
    run.yes = False
    with pytest.raises(HilError, match="no terminal") as caught:
        run()
    assert "--yes" in caught.value.mend
    assert run.unit.reads == 0


# Records that there are ----------------------------------------------------------------------


def test_a_record_is_written_without_measuring(run: Run, good: Path) -> None:
    shown = run(source=good)
    assert run.unit.heard == ["cal_read", "cal_record", "reboot"]
    assert run.unit.stored is not None
    expected = records.load(good).calibration
    np.testing.assert_array_equal(
        np.array(run.unit.stored["accel_bias_mps2"]), np.float32(expected.accel_bias_mps2)
    )
    assert "written, and read back equal" in shown
    assert not run.folder.exists()


def test_a_unit_that_has_only_just_started_comes_back(run: Run, good: Path) -> None:
    """Its first HELLO is from its boot, and so is the first one after the reset."""
    run.unit = FakeUnit(uptime_s=0.0)
    assert "boot check: applied" in run(source=good)
    assert run.unit.boots == 2


def changed(good: Path, folder: Path, old: str, new: str) -> Path:
    text = good.read_text()
    assert text.count(old) == 1
    path = folder / "changed.json"
    path.write_text(text.replace(old, new))
    return path


def test_another_devices_record_is_refused(run: Run, good: Path, tmp_path: Path) -> None:
    other = changed(good, tmp_path, "0123456789abcdef", "0123456789abcdee")
    for dry_run in (False, True):
        with pytest.raises(HilError, match="of device 0123456789abcdee"):
            run(source=other, dry_run=dry_run)
    assert run.unit.heard == ["cal_read"] * 2
    # Before anything is shown of it, and before the question.
    assert "scale error" not in run.shown


@pytest.mark.parametrize("year", ["1969", "9999"])
def test_a_date_that_does_not_fit_the_wire_is_refused(
    run: Run, good: Path, tmp_path: Path, year: str
) -> None:
    date = records.load(good).created_utc
    with pytest.raises(HilError, match=f"dated {year}"):
        run(source=changed(good, tmp_path, date, year + date[4:]))
    assert run.unit.stored is None


def test_a_missing_record_is_said_before_the_unit_is_waited_for(run: Run, tmp_path: Path) -> None:
    with pytest.raises(HilError, match=r"none\.json could not be read"):
        run(source=tmp_path / "none.json")
    assert run.unit.reads == 0


def millionths(path: Path) -> dict[str, int]:
    rows = [line.split("=") for line in path.read_text().splitlines() if line[0] != "#"]
    return {name: int(value) for name, value in rows}


def test_defaults_instead_of_the_unit(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "new" / "cal.conf"
    shown = run(to_defaults=path)
    assert run.unit.heard == ["cal_read", "raw_on", "raw_off"]
    (saved,) = run.saved
    found = millionths(path)
    expected = saved.calibration
    assert found["CONFIG_BV_CAL_ACCEL_M_YY_PPM"] == round(expected.accel_matrix[1, 1] * 1e6)
    assert found["CONFIG_BV_CAL_GYRO_BIAS_Z_URADPS"] == round(expected.gyro_bias_radps[2] * 1e6)
    assert len(found) == 15
    assert str(path) in shown


def test_defaults_of_a_record_without_a_unit(good: Path, tmp_path: Path) -> None:
    path = tmp_path / "cal.conf"
    arguments = ["calibrate", "--role", "leader", "--from", str(good), "--to-defaults", str(path)]
    result = CliRunner().invoke(cli.app, [*arguments, "--dry-run"])
    assert result.exit_code == 0, result.output
    assert "CONFIG_BV_CAL_ACCEL_M_XX_PPM=" in result.output
    assert not path.exists()
    result = CliRunner().invoke(cli.app, arguments)
    assert result.exit_code == 0, result.output
    bias = records.load(good).calibration.accel_bias_mps2[0]
    assert millionths(path)["CONFIG_BV_CAL_ACCEL_BIAS_X_UMPS2"] == round(bias * 1e6)


def test_a_folder_that_cannot_be_written_leaves_the_unit_alone(run: Run, tmp_path: Path) -> None:
    (tmp_path / "records").write_text("a file")
    with pytest.raises(HilError, match="could not be written"):
        run()
    assert run.unit.stored is None
    with pytest.raises(HilError, match="could not be written"):
        Run(FakeUnit(), tmp_path / "other")(to_defaults=tmp_path / "records" / "cal.conf")


# Ctrl-C --------------------------------------------------------------------------------------


class Interrupted(FakeUnit):
    """Ctrl-C at one call of the port, before or after what it does."""

    def __init__(self, at: int, after: bool = False) -> None:
        super().__init__(stored=old_record(), slice_s=1.25)
        self.calls = 0
        self._at = at
        self._after = after

    def read_bytes(self, timeout_s: float) -> bytes:
        with self._call():
            return super().read_bytes(timeout_s)

    def write(self, data: bytes) -> None:
        with self._call():
            super().write(data)

    def _call(self) -> Any:
        return _Call(self)

    def count(self, after: bool) -> None:
        if after == self._after and self.calls == self._at:
            self.calls += 1
            raise KeyboardInterrupt
        self.calls += after


class _Call:
    def __init__(self, unit: Interrupted) -> None:
        self._unit = unit

    def __enter__(self) -> None:
        self._unit.count(False)

    def __exit__(self, *_: object) -> None:
        self._unit.count(True)


def assert_left_well(run: Run) -> str:
    """Raw off, store and disk whole, sentence true; the sentence."""
    assert not run.unit.raw
    stored = run.unit.stored
    assert stored is not None
    (sentence,) = [line for line in run.shown.splitlines() if line.startswith("interrupted: ")]
    old = stored == old_record()
    saved = run.saved
    assert len(saved) <= 1
    if not old:
        (new,) = saved
        assert stored == guide.as_frame(new)
    if sentence.endswith(guide.KEPT):
        assert old
    elif sentence.endswith(command.STORED):
        assert not old
    else:
        assert sentence.endswith(command.EITHER)
    return sentence.removeprefix("interrupted: ")


@pytest.mark.parametrize("after", [False, True])
def test_ctrl_c_at_any_call_leaves_all_whole(tmp_path: Path, after: bool) -> None:
    whole = Interrupted(-1)
    Run(whole, tmp_path / "whole")()
    assert whole.calls > 25
    seen: Counter[str] = Counter()
    raw_when_hit = 0
    for at in range(whole.calls):
        run = Run(Interrupted(at, after), tmp_path / f"{at}")
        with pytest.raises(KeyboardInterrupt):
            run()
        raw_when_hit += "raw_on" in run.unit.heard
        seen[assert_left_well(run)] += 1
    # It was hit in every stage, and within the raw one.
    assert set(seen) == {guide.KEPT, command.EITHER, command.STORED}
    assert raw_when_hit > 12


def stop(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("where", ["builtins.input", "os.fsync", "os.replace"])
def test_ctrl_c_at_the_question_and_on_the_disk(
    run: Run, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    run.unit = FakeUnit(stored=old_record())
    if where == "builtins.input":
        run.yes, run.terminal = False, True
    monkeypatch.setattr(where, stop)
    with pytest.raises(KeyboardInterrupt):
        run()
    assert assert_left_well(run) == guide.KEPT
    assert run.saved == []


def test_ctrl_c_while_the_person_turns_the_unit(run: Run) -> None:
    run.unit = FakeUnit(stored=old_record())
    run.helper = stop
    with pytest.raises(KeyboardInterrupt):
        run()
    assert assert_left_well(run) == guide.KEPT
    assert run.unit.heard[-2:] == ["raw_on", "raw_off"]


# What goes wrong ------------------------------------------------------------------------------


def fails(run: Run, words: str, kind: type[HilError] = RigError, **options: Any) -> HilError:
    with pytest.raises(kind, match=words) as caught:
        run(**options)
    assert not run.unit.raw
    return caught.value


def test_another_role(run: Run) -> None:
    run.unit = FakeUnit("follower")
    assert "--role follower" in fails(run, "this unit is the follower, not the leader").mend
    assert run.unit.heard == []


def test_firmware_of_another_protocol(run: Run) -> None:
    run.unit = FakeUnit(schema=1)
    assert "hil bench flash" in fails(run, "another version of the protocol").mend


def test_a_silent_port(run: Run) -> None:
    run.unit.wrong.silent = True
    fails(run, "did not say who it is within 6 s")
    assert 6.0 <= run.unit.now_s() - 1000.0 <= 6.5


def test_no_samples(run: Run) -> None:
    run.unit.wrong.samples = False
    assert "boards/README.md" in fails(run, "sends no raw samples").mend
    assert run.unit.heard[-1] == "raw_off"


@pytest.mark.parametrize("what", ["cal_read", "raw_on"])
def test_a_command_that_is_never_answered(run: Run, what: str) -> None:
    run.unit = FakeUnit(stored=old_record(), wrong=Wrong(deaf=frozenset({what})))
    fails(run, f"does not answer the command {what}")


def test_what_is_lost_on_the_line_is_sent_again(run: Run) -> None:
    names = ("cal_read", "raw_on", "raw_off", "cal_record", "reboot")
    run.unit.wrong = Wrong(lost=Counter(dict.fromkeys(names, 1)))
    assert "boot check: applied" in run()
    assert run.unit.boots == 2


def test_a_record_that_the_unit_finds_impossible(run: Run) -> None:
    run.unit = FakeUnit(stored=old_record(), wrong=Wrong(refuse=22))
    fails(run, "refused the calibration as impossible; it keeps the one it had")
    assert run.unit.stored == old_record()
    assert run.unit.heard.count("cal_record") == 1


def test_flash_that_fails(run: Run) -> None:
    run.unit = FakeUnit(stored=old_record(), wrong=Wrong(refuse=5))
    fails(run, "could not store the calibration .its error 5.; its store holds the old one or the")


def test_an_answer_that_never_comes_does_not_say_what_is_stored(run: Run) -> None:
    run.unit.wrong = Wrong(unanswered=frozenset({"cal_record"}))
    fails(run, "its store holds the old calibration or the new one, whole")
    assert run.unit.heard.count("cal_record") == 3


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("accel_bias_mps2", [0.0, 0.0, 1e-7]),
        ("created_unix_s", 5),
        ("gyro_bias_radps", [float("nan")] * 3),
    ],
)
def test_a_store_that_reads_back_otherwise(run: Run, name: str, value: Any) -> None:
    run.unit.wrong = Wrong(stored_as={name: value})
    fails(run, f"stored another {name} than it was sent")
    assert run.unit.boots == 1


def test_a_refusal_from_before_the_question_is_none(run: Run, monkeypatch: Any) -> None:
    """While the person thinks, the line goes on: what waits in it answers nothing.

    The record itself is lost once, so that nothing else comes in that read.
    """
    run.unit.wrong = Wrong(lost=Counter(cal_record=1))

    def think(*_: object) -> str:
        run.unit._fault(34, 22)
        return "y"

    monkeypatch.setattr("builtins.input", think)
    run.yes, run.terminal = False, True
    assert "written, and read back equal" in run()


def test_a_unit_that_does_not_come_back(run: Run) -> None:
    run.unit.wrong = Wrong(comes_back=False)
    fails(run, "did not come back after its reset within 30 s")
    assert run.unit.stored is not None


def test_a_unit_that_is_moved_after_its_reset(run: Run) -> None:
    run.unit.wrong = Wrong(boot_s=1e6)
    assert "lay it down" in fails(run, "found no second of stillness").mend


def test_a_boot_check_that_takes_its_time(run: Run) -> None:
    run.unit.wrong = Wrong(boot_s=20.0)
    assert "boot check: applied" in run()


def test_a_refused_boot_check(run: Run) -> None:
    run.unit.wrong = Wrong(after_reset={"boot_check": 3, "boot_delta_dps": 5.0})
    fails(run, r"boot check: refused, gyroscope 5.000 dps", HilError)


def test_a_warning_of_the_boot_check_is_shown(run: Run) -> None:
    run.unit.wrong = Wrong(after_reset={"boot_check": 2, "boot_delta_dps": 0.7})
    assert "boot check: warned, gyroscope 0.700 dps from the stored bias" in run()


def test_defaults_after_the_reset(run: Run) -> None:
    run.unit.wrong = Wrong(after_reset={"origin": 0, "reason": 2})
    assert "--from" in fails(run, "uses its defaults: the record is corrupt", HilError).mend


@pytest.mark.parametrize(
    "fields",
    [
        {"accel_matrix": [1.0, 0, 0, 0, 1, 0, 0, 0, 1]},
        {"accel_bias_mps2": [0.0] * 3},
        {"accel_bias_mps2": [float("nan")] * 3},
    ],
)
def test_another_calibration_in_force_after_the_reset(run: Run, fields: Values) -> None:
    run.unit.wrong = Wrong(after_reset=fields)
    fails(run, "another calibration is in force than was written", HilError)


def test_a_chip_that_no_sound_unit_has(run: Run) -> None:
    run.unit.errors = replace(run.unit.errors, accel_bias_mps2=np.array([2.5, 0.0, 0.0]))
    run.helper = lambda face: run.unit.turn(UP[face] - (np.array([0.25, 0, 0])))
    fails(run, "x bias is|from gravity|scale is off", HilError)
    assert run.saved == []
    assert run.unit.stored is None


# What the person is told -----------------------------------------------------------------------


def steps(run: Run) -> list[float]:
    """Times at which each face was asked for, in seconds; filled by the run."""
    times: list[float] = []
    turn = run.helper or (lambda face: run.unit.turn(UP[face]))

    def helper(face: Any) -> None:
        times.append(run.unit.now_s())
        turn(face)

    run.helper = helper
    return times


def test_the_wrong_face_is_said_and_can_be_mended(run: Run) -> None:
    def helper(face: Any) -> None:
        run.unit.turn(UP["-z" if face == "+x" else "+y" if face == "-y" else face])
        turned_s = run.unit.now_s() + 6.0

        def later(_: int) -> None:
            if run.unit.now_s() > turned_s:
                run.unit.turn(UP[face])
                run.unit.before_read = lambda _: None

        run.unit.before_read = later if face in ("+x", "-y") else lambda _: None

    run.helper = helper
    shown = run()
    assert "this is -z up, +x was asked: turn it until +x points up" in shown
    assert "this is +y up, -y was asked: turn it over" in shown
    assert shown.count("was asked") == 2
    assert [pose.face for pose in run.saved[0].poses][:1] == ["+x"]
    np.testing.assert_allclose(run.saved[0].poses[0].mean[0], G_MPS2, atol=0.5)


def test_a_tilted_face_is_said(run: Run) -> None:
    def helper(face: Any) -> None:
        run.unit.turn(UP[face] + (np.array([0.2, 0, 0]) if face == "+z" else 0.0))
        turned_s = run.unit.now_s() + 3.0

        def later(_: int) -> None:
            if run.unit.now_s() > turned_s:
                run.unit.turn(UP[face])
                run.unit.before_read = lambda _: None

        run.unit.before_read = later if face == "+z" else lambda _: None

    run.helper = helper
    # atan(0.2) is 11.3 degrees; the chip's own errors add one or two.
    assert "+z is 1" in run()
    assert "off the vertical, at most 8: set it upright" in run.shown


def test_a_knock_within_a_face_begins_it_anew(run: Run) -> None:
    calm = Run(FakeUnit(), run.folder)
    calm_s = steps(calm)
    calm()
    run.helper = lambda face: (run.unit.turn(UP[face]), run.unit.knock_at(1.0))[0]
    knocked_s = steps(run)
    run()
    assert np.all(np.diff(knocked_s) >= 1.05 + 500 / 417)
    assert np.all(np.diff(calm_s) < 2.2)


def test_a_knock_begins_the_rest_anew(run: Run) -> None:
    def helper(face: Any) -> None:
        run.unit.turn(UP[face])
        if face == "-z":
            run.unit.knock_at(5.0)

    run.helper = helper
    shown = run()
    assert "begun anew once" in shown
    assert run.unit.stored is not None
    np.testing.assert_allclose(
        run.unit.stored["gyro_bias_radps"],
        run.unit.errors.gyro_bias_radps,
        atol=np.radians(0.02),
    )
    assert "begun anew" not in Run(FakeUnit(), run.folder)()


def test_the_rest_is_as_long_as_was_asked(run: Run) -> None:
    run.plan = guide.Plan(rest_s=8.0)
    run()
    assert run.saved[0].gyro_samples == round(8.0 * 417)


def test_the_live_lines_show_reading_and_words_in_80_columns() -> None:
    words = "this is -z up, +x was asked: turn it until +x points up"
    out = io.StringIO()
    screen = Screen(Console(file=out, force_terminal=True, width=80, no_color=True))
    with screen.live() as bar:
        bar.show(0.4, "x +0.00  y +0.03  z -1.01 g", words, True)
    shown = out.getvalue()
    assert words in shown
    assert " 40%" in shown
    assert "z -1.01 g" in shown


def test_paths_are_shown_as_they_are(run: Run, tmp_path: Path) -> None:
    """Square brackets are markup to the screen's library, and long lines are broken by it."""
    run.folder = tmp_path / "[bold]" / ("long-" * 20) / "[/nothing]"
    assert f"record: {run.folder}/" in run()


def test_brackets_in_a_question_are_shown(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("builtins.input", lambda *_: "n")
    run.yes, run.terminal = False, True
    console_text = run(to_defaults=Path("[/x]cal.conf"))
    assert "[/x]cal.conf?" in console_text


# Hostile input ----------------------------------------------------------------------------------


def batch(unit: FakeUnit, **fields: Any) -> bytes:
    """A frame of this unit's whose CRC is right and whose content is not."""
    counts = np.full((4, 3), 12345, np.int16)
    return encode("imu_batch", unit.batch(counts, counts) | {"flags": 9} | fields, 0)


@pytest.mark.parametrize(
    "fields",
    [
        {"period_ticks": 0},
        {"period_ticks": 0xFFFFFFFF},
        {"accel_fs_g": 0},
        {"gyro_fs_dps": 0},
        {"accel_fs_g": 255, "gyro_fs_dps": 65535},
        {"temperature_cdegc": 32767},
        {"temperature_cdegc": -32768},
    ],
)
def test_batches_that_no_sensor_makes_are_left_out(run: Run, fields: dict[str, int]) -> None:
    run.unit.wrong.noise = batch(run.unit, **fields)
    run()
    assert run.unit.stored is not None
    np.testing.assert_allclose(
        run.unit.stored["accel_bias_mps2"], run.unit.errors.accel_bias_mps2, atol=MG
    )
    assert run.saved[0].gyro_samples == round(5.0 * 417)
    assert run.saved[0].temperature_degc == pytest.approx(26.5)


def test_batches_of_the_other_node_and_corrected_ones_are_left_out(run: Run) -> None:
    run.unit.wrong.noise = batch(run.unit, source=1) + batch(run.unit, flags=1)
    run()
    assert run.unit.stored is not None
    np.testing.assert_allclose(
        run.unit.stored["accel_bias_mps2"], run.unit.errors.accel_bias_mps2, atol=MG
    )


def test_a_rate_that_one_damaged_frame_states_is_outvoted(run: Run) -> None:
    """One of 64 says 4 kHz, just when the length of the rest is decided."""
    unit = Unit(run.unit, "leader", run.unit.now_s)
    unit.connect()
    with unit.raw():
        for _ in range(10):
            unit.samples()
        run.unit.wrong.samples = False
        run.unit.wrong.noise = batch(run.unit, period_ticks=256 * 4000)
        unit.samples()
        assert unit.rate_hz == pytest.approx(417.0, rel=1e-3)


def test_a_status_full_of_nonsense_is_shown_and_no_traceback(run: Run) -> None:
    nan = float("nan")
    unit = Unit(run.unit, "leader", run.unit.now_s)
    run.unit.stored = run.unit._in_force = old_record() | {
        "created_unix_s": 0xFFFFFFFF,
        "accel_matrix": [nan] * 9,
        "accel_bias_mps2": [nan] * 3,
    }
    run.unit._changed = {"origin": 1, "reason": 77, "boot_check": 200, "boot_delta_dps": nan}
    unit.connect()
    assert "stored, of 2106-02-07" in guide.describe(unit)
    unit.status["origin"] = 1
    with unit.raw():
        poses = guide.take_poses(
            unit,
            PLAN,
            Screen(Console(file=io.StringIO())),
            lambda face: run.unit.turn(UP[face or "+x"]),
        )
    before = guide.magnitudes_until_now(unit, poses)
    assert before is not None
    assert np.isnan(before).all()
    run.unit.stored = None
    assert "record unknown (77)" in guide.describe(unit)


@pytest.mark.parametrize("seed", range(5))
def test_noise_on_the_line_is_a_silent_port(run: Run, seed: int) -> None:
    rng = np.random.default_rng(seed)
    run.unit.wrong.silent = True

    def noise(timeout_s: float) -> bytes:
        run.unit._now_s += 0.2
        return rng.bytes(2000)

    run.unit.read_bytes = noise  # type: ignore[method-assign]
    fails(run, "did not say who it is")


def test_a_run_amid_noise_comes_to_its_end(run: Run) -> None:
    """Bytes between the frames; each frame brings its own 00s."""
    run.unit.wrong.noise = np.random.default_rng(3).bytes(500) + b"\0"
    run()
    assert run.unit.stored is not None
