# SPDX-License-Identifier: Apache-2.0
"""The progress bar of every command that takes its time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def bar(title: str) -> Iterator[Callable[[float, str], None]]:
    """A progress bar on a terminal; elsewhere there is nothing but the result.

    Yields a function of the share that is done and of what is being done.
    """
    from rich.console import Console  # noqa: PLC0415 (start-up time of --help)
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[what]}", style="dim"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as shown:
        task = shown.add_task(title, total=1.0, what="")

        def update(share: float, what: str) -> None:
            shown.update(task, completed=share, what=what)

        yield update
