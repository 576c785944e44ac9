# SPDX-License-Identifier: Apache-2.0
"""A figure as a file, whole or not at all; the name's ending says which kind."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from hil.atomic import write_whole
from hil.exchange.table import ExchangeError
from hil.plot import page, picture
from hil.plot.figure import Figure

ENDINGS: Final = (".png", ".svg", ".html")


def check_ending(path: Path) -> None:
    """
    Raises:
        ExchangeError: the name's ending is none of :data:`ENDINGS`.
    """
    if path.suffix.lower() not in ENDINGS:
        raise ExchangeError(
            f"{path}: its name does not say what to write",
            f"let it end in {', '.join(ENDINGS)}",
        )


def write(figure: Figure, path: Path) -> None:
    """Write the figure.

    Raises:
        ExchangeError: an unknown ending, a library that is missing, or it cannot be written.
    """
    check_ending(path)
    match path.suffix.lower():
        case ".png":
            data = picture.png(figure)
        case ".svg":
            data = picture.svg(figure).encode("utf-8")
        case _:
            data = page.html(figure).encode("utf-8")
    try:
        write_whole(path, data)
    except OSError as error:
        raise ExchangeError(
            f"{path}: cannot be written: {error.strerror or error}",
            "name a file that you may write to: hil plot RECORDING -o FILE.svg",
        ) from error
