# SPDX-License-Identifier: Apache-2.0
"""Hands that turn a simulated unit: their kinematics, and what the chip's C code makes of them."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.errors import RigError
from hil.motion.imu_model import IDEAL, UNCALIBRATED, ChipErrors, draw_errors
from hil.simulator.hands import UP, Hands, turning
from hil.units import _turner
from tests.unit.native import USUAL, shared_library

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "firmware" / "drivers" / "lsm6dsox" / "model"
SHIM = ROOT / "tests" / "unit" / "c" / "hands_shim.c"
G_MPS2 = 9.80665
Floats = NDArray[np.float64]

TURNS = [
    ("+z", "+x"),
    ("+x", "-x"),
    ("+z", "-z"),
    ("-y", "+y"),
    ("+x", (1.0, 1.0, 1.0)),
    ((1.0, 2.0, -3.0), (0.0, -1.0, 5.0)),
    ((1.0, 0.0, 0.0), (1.0, 0.002, 0.0)),
]


def unit(direction: str | tuple[float, float, float]) -> Floats:
    vector = np.array(UP[direction] if isinstance(direction, str) else direction)
    return vector / np.linalg.norm(vector)


# Kinematics ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("begin", "end"), TURNS)
def test_the_rate_integrates_to_the_new_direction(begin, end) -> None:
    """d up/dt = -w x up, integrated from the rates alone."""
    seconds = 1.5
    pieces = list(turning(unit(begin), unit(end), seconds))
    assert sum(duration for duration, _, _ in pieces) == pytest.approx(seconds)
    up, rate_before = unit(begin), np.zeros(3)
    for duration, direction, rate in pieces:
        # The chip goes linearly from rate to rate.
        for k in range(50):
            w = rate_before + (k + 0.5) / 50 * (rate - rate_before)
            middle = up - np.cross(w, up) * duration / 100
            up = up - np.cross(w, middle) * duration / 50
        # Trapezoids of a smooth rate over 40 pieces: 2e-3 of the angle, turned back at the end.
        np.testing.assert_allclose(up, direction, atol=5e-3)
        np.testing.assert_allclose(np.linalg.norm(direction), 1.0, atol=1e-12)
        rate_before = rate
    np.testing.assert_allclose(up, unit(end), atol=1e-4)


@pytest.mark.parametrize(("begin", "end"), TURNS)
def test_it_is_at_rest_at_both_ends(begin, end) -> None:
    pieces = list(turning(unit(begin), unit(end), 1.0))
    rates = np.array([np.linalg.norm(rate) for _, _, rate in pieces])
    assert rates[-1] == 0.0
    assert rates[0] < 0.02 * rates.max()
    assert np.argmax(rates) == len(rates) // 2 - 1
    # The mean of a quintic's rate is 8/15 of its largest.
    angle = np.arccos(np.clip(unit(begin) @ unit(end), -1, 1))
    assert rates.max() == pytest.approx(15 / 8 * angle, rel=1e-6)
    np.testing.assert_allclose(pieces[-1][1], unit(end), atol=1e-9)


def test_rate_and_gravity_agree_in_sign() -> None:
    """By hand: +z up, to be +x up. The unit's x axis rises, so it turns about its -y."""
    for _, direction, rate in list(turning(UP["+z"], UP["+x"], 1.0))[:-1]:
        assert rate[1] < 0.0
        assert rate[0] == rate[2] == 0.0
        assert direction[0] > 0.0


def test_a_turn_to_where_it_is_already_is_none() -> None:
    assert list(turning(UP["+y"], 3.0 * UP["+y"], 1.0)) == []


# The pipe and the chip ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    found = shared_library(
        tmp_path_factory.mktemp("hands") / "hands.so",
        [MODEL / "hands.c", SHIM],
        [MODEL],
        (*USUAL, "-D_GNU_SOURCE"),
    )
    found.shim_hands_open.restype = ctypes.c_void_p
    found.shim_hands_at.restype = ctypes.c_char_p
    return found


class Chip:
    """The chip's end of the pipe."""

    def __init__(self, library: ctypes.CDLL, pipe: Path, start: Floats | None = None) -> None:
        self._library = library
        row = np.array([0.0, 0.0, G_MPS2, 0.0, 0.0, 0.0]) if start is None else start
        problem = ctypes.create_string_buffer(128)
        self.handle = library.shim_hands_open(
            os.fsencode(pipe), ctypes.c_void_p(row.ctypes.data), problem
        )
        self.problem = problem.value.decode()

    def at(self, t_s: float) -> Floats:
        row = np.full(6, np.nan)
        bad = self._at(t_s, row)
        assert bad is None, bad
        return row

    def bad_line(self, t_s: float) -> str | None:
        bad: bytes | None = self._at(t_s, np.zeros(6))
        return None if bad is None else bad.decode()

    def close(self) -> None:
        self._library.hands_close(ctypes.c_void_p(self.handle))

    def _at(self, t_s: float, row: Floats) -> bytes | None:
        found: bytes | None = self._library.shim_hands_at(
            ctypes.c_void_p(self.handle), ctypes.c_double(t_s), ctypes.c_void_p(row.ctypes.data)
        )
        return found


def chip_of(population: str) -> ChipErrors:
    spread = {"ideal": IDEAL, "uncalibrated": UNCALIBRATED}[population]
    return draw_errors(np.random.default_rng(4), spread)


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    return tmp_path / "hands"


@pytest.fixture
def hands(pipe: Path) -> Iterator[Hands]:
    made = Hands(pipe, chip_of("ideal"))
    yield made
    made.close()


def follow(chip: Chip, begin_s: float, end_s: float) -> tuple[Floats, Floats]:
    """At 1 kHz: times, and what is felt."""
    t = np.arange(begin_s, end_s, 1e-3)
    return t, np.array([chip.at(float(x)) for x in t])


def test_a_turn_reaches_the_chip_whole(library: ctypes.CDLL, pipe: Path, hands: Hands) -> None:
    chip = Chip(library, pipe)
    assert chip.at(0.0)[:3].tolist() == [0.0, 0.0, G_MPS2]
    hands.turn(UP["-y"], 0.8)
    t, felt = follow(chip, 0.01, 1.2)
    np.testing.assert_allclose(felt[-1], [0, -G_MPS2, 0, 0, 0, 0], atol=1e-6)
    # It begins at once, takes its time, and then stays.
    moving = t[np.linalg.norm(felt[:, 3:], axis=1) > 1e-6]
    assert moving[0] == pytest.approx(0.01, abs=0.01)
    assert moving[-1] == pytest.approx(0.81, abs=0.01)
    # What is felt is gravity alone, but for the chords of 40 straight pieces.
    assert np.abs(np.linalg.norm(felt[:, :3], axis=1) / G_MPS2 - 1.0).max() < 1e-3
    # And the rate is that of gravity, everywhere on the way.
    up = felt[:, :3] / G_MPS2
    slope = np.gradient(up, 1e-3, axis=0)
    np.testing.assert_allclose(slope, -np.cross(felt[:, 3:], up), atol=0.25)
    np.testing.assert_allclose(
        np.cumsum(slope, axis=0)[-1] * 1e-3,
        np.cumsum(-np.cross(felt[:, 3:], up), axis=0)[-1] * 1e-3,
        atol=0.01,
    )
    chip.close()


def test_the_chips_errors_are_in_what_it_feels(library: ctypes.CDLL, pipe: Path) -> None:
    errors = chip_of("uncalibrated")
    hands, chip = Hands(pipe, errors), Chip(library, pipe)
    hands.turn(UP["+x"], 0.1)
    follow(chip, 0.0, 0.2)
    felt = chip.at(0.3)
    np.testing.assert_allclose(
        felt[:3], errors.accel_matrix[:, 0] * G_MPS2 + errors.accel_bias_mps2, rtol=1e-7
    )
    np.testing.assert_allclose(felt[3:], errors.gyro_bias_radps, rtol=1e-7)
    hands.spin(np.array([0.0, 0.0, 2.0]))
    follow(chip, 0.3, 0.32)
    expected = 2.0 * errors.gyro_matrix[:, 2] + errors.gyro_bias_radps
    np.testing.assert_allclose(chip.at(0.33)[3:], expected, rtol=1e-7)
    chip.close()
    hands.close()


def test_a_turn_to_where_it_is_already_ends_a_spin(
    library: ctypes.CDLL, pipe: Path, hands: Hands
) -> None:
    chip = Chip(library, pipe)
    hands.spin(np.array([0.0, 0.0, 2.0]))
    assert follow(chip, 0.0, 0.02)[1][-1, 5] == 2.0
    hands.turn(UP["+z"])
    assert follow(chip, 0.02, 0.04)[1][-1, 5] == 0.0
    chip.close()


def test_two_turns_follow_on_each_other(library: ctypes.CDLL, pipe: Path, hands: Hands) -> None:
    chip = Chip(library, pipe)
    hands.turn(UP["+x"], 0.5)
    hands.turn(UP["-z"], 0.5)
    _, felt = follow(chip, 0.0, 1.3)
    assert felt[500, 0] == pytest.approx(G_MPS2, rel=1e-3)
    np.testing.assert_allclose(felt[-1], [0, 0, -G_MPS2, 0, 0, 0], atol=1e-6)
    chip.close()


def test_a_chip_that_starts_again_is_told_how_it_is_held(
    library: ctypes.CDLL, pipe: Path, hands: Hands
) -> None:
    chip = Chip(library, pipe)
    hands.turn(UP["+y"], 0.2)
    follow(chip, 0.0, 0.4)
    chip.close()
    hands.rest()
    again = Chip(library, pipe)
    follow(again, 0.0, 0.01)
    np.testing.assert_allclose(again.at(0.02), [0, G_MPS2, 0, 0, 0, 0], atol=1e-6)
    again.close()


def test_shaking_ends_where_it_began(library: ctypes.CDLL, pipe: Path, hands: Hands) -> None:
    chip = Chip(library, pipe)
    hands.shake(0.8, 0.5)
    _, felt = follow(chip, 0.0, 1.2)
    assert felt[:, 3].max() == pytest.approx(0.5)
    assert felt[:, 3].min() == pytest.approx(-0.5)
    assert abs(felt[:, 3].sum()) < 0.02 * np.abs(felt[:, 3]).sum()
    np.testing.assert_allclose(felt[-1], [0, 0, G_MPS2, 0, 0, 0], atol=1e-6)
    chip.close()


GOOD = "0,1,2,3,4,5,6"


@pytest.mark.parametrize(
    "line",
    [
        "",
        "turn",
        "0,1,2,3,4,5",
        GOOD + ",7",
        GOOD + " ",
        "-1,1,2,3,4,5,6",
        "nan,1,2,3,4,5,6",
        "1e9,1,2,3,4,5,6",
        "0;1;2;3;4;5;6",
        "0" * 300,
    ],
)
def test_a_bad_line_is_named(library: ctypes.CDLL, pipe: Path, hands: Hands, line: str) -> None:
    chip = Chip(library, pipe)
    with pipe.open("wb", buffering=0) as other:
        other.write(f"{GOOD}\n{line}\n".encode())
    bad = chip.bad_line(0.0)
    assert bad is not None
    assert bad == line[:255]
    chip.close()


def test_a_line_that_comes_in_two_halves_is_one(
    library: ctypes.CDLL, pipe: Path, hands: Hands
) -> None:
    chip = Chip(library, pipe)
    with pipe.open("wb", buffering=0) as other:
        other.write(b"0,1,2,")
        assert chip.at(0.0)[2] == G_MPS2
        other.write(b"3,4,5,6\n")
        assert chip.at(0.1).tolist() == [1, 2, 3, 4, 5, 6]
    chip.close()


def test_no_pipe_is_said(library: ctypes.CDLL, tmp_path: Path) -> None:
    chip = Chip(library, tmp_path / "none")
    assert chip.handle is None
    assert chip.problem == "No such file or directory"


def test_a_pipe_that_nobody_reads_is_an_error_and_not_for_ever(hands: Hands) -> None:
    with pytest.raises(RigError, match="does not read how it is held"):
        hands.shake(1000.0)


# The person of the simulated unit ---------------------------------------------------------------


def test_eighteen_free_positions_are_far_from_each_other_and_from_the_faces() -> None:
    """As many as ``hil calibrate --poses 24`` asks for; 20 degrees are needed."""
    asked: list[Floats] = []

    class Noted(Hands):
        def __init__(self) -> None:
            pass

        def turn(self, up: Floats, seconds: float = 1.0) -> None:
            asked.append(up / np.linalg.norm(up))

    turn = _turner(Noted(), seed=1)
    for face in UP:
        turn(face)
    for _ in range(18):
        turn(None)
    for face, up in zip(UP, asked[:6], strict=True):
        assert np.degrees(np.arccos(UP[face] @ up)) < 8.0
    cosines = np.array(asked) @ np.array(asked).T
    np.fill_diagonal(cosines, 0.0)
    assert np.degrees(np.arccos(cosines.max())) > 20.0
    assert len(asked) == 24
