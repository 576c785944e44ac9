# SPDX-License-Identifier: Apache-2.0
"""Reaching one unit over its serial line, on the bench or simulated, for tools that talk to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from hil.bench.port import SerialPort
from hil.errors import RigError
from hil.motion.imu_model import chip_errors

if TYPE_CHECKING:
    from hil.build import BabbleSim, Manifest
    from hil.simulator.hands import Hands

HAND_TILT_DEG: Final = 1.5
"""How far off a face lies when simulated hands have laid the unit down."""
DESK_FOLDER: Final = Path("build/desk")


@dataclass(frozen=True)
class Reached:
    """A unit that can be talked to.

    Attributes:
        port: its open serial line.
        helper: turns the unit when a face ("+x") or another position (None) is asked for; None
            where a person does that.
        note: what a person should know about it; empty for a real one.
    """

    port: SerialPort
    helper: Callable[[str | None], None] | None = None
    note: str = ""


@contextmanager
def at_port(path: str) -> Iterator[Reached]:
    """The unit at a serial port.

    Raises:
        RigError: no such port, not permitted, or in use.
    """
    with SerialPort(path) as port:
        yield Reached(port)


@contextmanager
def on_bench(role: str, bench_file: Path) -> Iterator[Reached]:
    """The unit that the bench file says is ``role``; found again when it is unplugged.

    The bench is held meanwhile: nobody resets or flashes a unit that is being talked to.

    Raises:
        HilError: no bench file, a mistake in it, the bench is in use, or the board is not there.
    """
    from hil.bench import inventory, lock, ports  # noqa: PLC0415

    bench = inventory.load(bench_file)
    with lock.hold(bench.path), ports.open_board(bench.boards[role]) as port:
        yield Reached(port)


@contextmanager
def simulated(
    image: Manifest, babblesim: BabbleSim, *, seed: int, speed: float, flash: Path | None = None
) -> Iterator[Reached]:
    """An image running on the simulated board, held by simulated hands.

    Args:
        seed: which chip it has.
        speed: at most so many times as fast as real time; 0 for as fast as it goes.
        flash: file of its flash; by default one below ``build/desk``, kept from run to run.

    Raises:
        RigError: it died.
    """
    from hil.simulator.desk import Desk  # noqa: PLC0415 (needs the build extra)

    if flash is None:
        flash = (DESK_FOLDER / f"{image.role}-{seed}.flash").absolute()
        flash.parent.mkdir(parents=True, exist_ok=True)
    errors = chip_errors(seed, image.role, "uncalibrated")
    with (
        Desk(babblesim, image.file("exe"), errors, seed=seed, speed=speed, flash=flash) as desk,
        SerialPort(desk.port) as port,
    ):
        note = f"simulated unit: real firmware on a simulated board, chip number {seed}"
        try:
            yield Reached(port, _turner(desk.hands, seed), note)
        except RigError:
            # A unit that died explains the silence of its line.
            desk.check()
            raise


def _turner(hands: Hands, seed: int) -> Callable[[str | None], None]:
    from hil.simulator.hands import UP  # noqa: PLC0415

    rng = np.random.default_rng(seed)
    # Four corners that are as far apart as can be, the opposite ones, then the twelve edges.
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
    edges = [np.roll((0, a, b), k) for k in range(3) for a in (1, -1) for b in (1, -1)]
    free = cycle(up / np.linalg.norm(up) for up in [*corners, *-corners, *edges])

    def turn(face: str | None) -> None:
        up = next(free) if face is None else UP[face]
        tilt = np.radians(HAND_TILT_DEG) * rng.standard_normal(3)
        hands.turn(up + np.cross(tilt, up))

    return turn
