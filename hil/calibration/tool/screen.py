# SPDX-License-Identifier: Apache-2.0
"""What the person at the terminal sees of a calibration, and is asked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.prompt import Confirm
from rich.table import Table

from hil.calibration.poses import FloatArray, Pose, Reading
from hil.calibration.solve import Calibration
from hil.errors import HilError


class Bar(Protocol):
    """A line that changes while something is under way."""

    def show(self, share: float, text: str) -> None: ...


class Screen:
    """Plain lines for what stays, one live line for what is under way."""

    def __init__(self, console: Console, assume_yes: bool = False) -> None:
        self.console = console
        self._assume_yes = assume_yes

    def say(self, text: str, style: str = "") -> None:
        self.console.print(text, style=style, highlight=False)

    @contextmanager
    def live(self, title: str) -> Iterator[Bar]:
        """A progress bar that is gone afterwards; without a terminal, nothing."""
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=16),
            TextColumn("{task.percentage:>3.0f}%"),
            TextColumn("{task.fields[what]}", markup=False),
        )
        with Progress(
            *columns, console=self.console, transient=True, disable=not self.console.is_terminal
        ) as progress:
            task = progress.add_task(title, total=1.0, what="")

            class Shown:
                def show(self, share: float, text: str) -> None:
                    progress.update(task, completed=share, what=text)

            yield Shown()

    def confirm(self, question: str) -> bool:
        """Ask; No is the default.

        Raises:
            HilError: there is nobody to ask.
        """
        if self._assume_yes:
            return True
        if not self.console.is_terminal:
            raise HilError(
                "there is no terminal to ask on", "add --yes to go on without a question"
            )
        return Confirm.ask(question, console=self.console, default=False)


def reading_text(reading: Reading, hint: str = "") -> str:
    """One line about what the unit is doing now: short enough for 80 columns."""
    x, y, z = reading.accel_mps2 / 9.80665
    return f"{x:+.2f} {y:+.2f} {z:+.2f} g  {hint or reading.why or reading.state}"


def result_tables(
    calibration: Calibration, poses: list[Pose], before: FloatArray | None
) -> list[Table]:
    """The figures to look at before anything is written."""
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
    means = np.array([pose.mean for pose in poses])
    raw = np.linalg.norm(means, axis=1) / calibration.gravity_mps2
    corrected = np.linalg.norm(calibration.accel(means), axis=1) / calibration.gravity_mps2
    for i, pose in enumerate(poses):
        old = [f"{before[i] / calibration.gravity_mps2:.4f}"] if before is not None else []
        name = f"{pose.face} up" if pose.face else f"free {i + 1}"
        table.add_row(name, f"{raw[i]:.4f}", *old, f"{corrected[i]:.4f}")
    return table
