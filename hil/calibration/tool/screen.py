# SPDX-License-Identifier: Apache-2.0
"""What the person at the terminal sees of a calibration, and is asked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.prompt import Confirm
from rich.table import Table
from rich.text import Text

from hil.calibration.poses import FloatArray, Pose, Reading
from hil.calibration.solve import Calibration
from hil.core.calib import STANDARD_GRAVITY_MPS2
from hil.errors import HilError

MARGIN = "     "
BAR_WIDTH = 24


class Bar(Protocol):
    """What changes while something is under way: how far, what is read, and one line of words."""

    def show(self, share: float, reading: str, words: str, wrong: bool = False) -> None: ...


class Screen:
    """Plain lines for what stays, two live lines for what is under way."""

    def __init__(self, console: Console, assume_yes: bool = False) -> None:
        self.console = console
        self._assume_yes = assume_yes

    def say(self, text: str, style: str = "") -> None:
        """One line. It is not broken, so that a path can be copied from it."""
        self.console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

    def tell(self, text: str) -> None:
        """A paragraph, as wide as the terminal."""
        self.console.print(text, markup=False, highlight=False)

    def step(self, label: str, text: str) -> None:
        """What the person is to do next."""
        self.console.print(Text.assemble((label, "bold"), "  ", text), highlight=False)

    def show(self, tables: list[Table]) -> None:
        for table in tables:
            self.console.print(table)

    @contextmanager
    def live(self) -> Iterator[Bar]:
        """Two lines that are gone afterwards; without a terminal, a line for each mistake."""
        if not self.console.is_terminal:
            yield _Lines(self)
            return
        with Live(console=self.console, transient=True, refresh_per_second=10) as live:
            yield _Shown(live)

    def must_ask(self) -> None:
        """See to it that a question can be asked, before hours of work hang on it.

        Raises:
            HilError: there is nobody to ask.
        """
        if not (self._assume_yes or self.console.is_terminal):
            raise HilError(
                "there is no terminal to ask on before writing",
                "add --yes to write without a question\nor --dry-run to write nothing",
            )

    def confirm(self, question: str) -> bool:
        """Ask; No is the default, and the answer of a terminal that has gone.

        Raises:
            HilError: as :meth:`must_ask`.
        """
        self.must_ask()
        if self._assume_yes:
            return True
        try:
            return Confirm.ask(escape(question), console=self.console, default=False)
        except EOFError:
            self.console.print()
            return False


class _Shown:
    def __init__(self, live: Live) -> None:
        self._live = live

    def show(self, share: float, reading: str, words: str, wrong: bool = False) -> None:
        row = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=1.0, completed=share, width=BAR_WIDTH)
        row.add_row(MARGIN[:-1], bar, f"{share:4.0%}", reading)
        style = "yellow" if wrong else ""
        below = Text(MARGIN + words, style, no_wrap=True, overflow="ellipsis")
        self._live.update(Group(row, below))


class _Lines:
    def __init__(self, screen: Screen) -> None:
        self._screen = screen
        self._said = ""

    def show(self, share: float, reading: str, words: str, wrong: bool = False) -> None:
        if wrong and words != self._said:
            self._screen.say(MARGIN + words)
        self._said = words if wrong else ""


def reading_text(reading: Reading) -> str:
    """What the accelerometer says now: the axis that points up says +1 g."""
    x, y, z = reading.accel_mps2 / STANDARD_GRAVITY_MPS2
    return f"x {x:+.2f}  y {y:+.2f}  z {z:+.2f} g"


def result_tables(
    calibration: Calibration, poses: list[Pose], before: FloatArray | None = None
) -> list[Table]:
    """The figures to look at before anything is written.

    Args:
        before: (n,) m/s^2, magnitudes of the poses by the calibration in force; None for raw.
    """
    return [_figures(calibration), _magnitudes(calibration, poses, before)]


def _figures(calibration: Calibration) -> Table:
    mg = calibration.gravity_mps2 * 1e-3
    scale = np.diagonal(np.linalg.inv(calibration.accel_matrix))
    table = Table(title="Calibration", title_justify="left")
    for heading in ("axis", "bias, mg", "scale error, %", "gyro bias, dps"):
        table.add_column(heading, justify="left" if heading == "axis" else "right")
    for i, axis in enumerate("xyz"):
        bias, sigma = calibration.accel_bias_mps2[i] / mg, calibration.accel_bias_sigma_mps2[i] / mg
        gyro = np.degrees(calibration.gyro_bias_radps[i])
        gyro_sigma = np.degrees(calibration.gyro_bias_sigma_radps[i])
        table.add_row(
            axis,
            f"{bias:+.2f} ± {sigma:.2f}",
            f"{100 * (scale[i] - 1):+.3f} ± {100 * calibration.accel_matrix_sigma[i, i]:.3f}",
            f"{gyro:+.3f} ± {gyro_sigma:.3f}",
        )
    return table


def _magnitudes(calibration: Calibration, poses: list[Pose], before: FloatArray | None) -> Table:
    table = Table(title="Magnitude at rest", title_justify="left")
    table.add_column("pose")
    for heading in ("raw, g", *(["until now, g"] if before is not None else []), "corrected, g"):
        table.add_column(heading, justify="right")
    means = np.array([pose.mean for pose in poses]).reshape(-1, 3)
    raw = np.linalg.norm(means, axis=1) / calibration.gravity_mps2
    corrected = np.linalg.norm(calibration.accel(means), axis=1) / calibration.gravity_mps2
    for i, pose in enumerate(poses):
        old = [f"{before[i] / calibration.gravity_mps2:.4f}"] if before is not None else []
        name = f"{pose.face} up" if pose.face else f"free {i + 1}"
        table.add_row(name, f"{raw[i]:.4f}", *old, f"{corrected[i]:.4f}")
    return table
