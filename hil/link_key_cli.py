# SPDX-License-Identifier: Apache-2.0
"""``hil link-key``."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import typer


class Board(enum.StrEnum):
    SIM = "sim"
    BENCH = "bench"


def link_key(
    *,
    board: Annotated[Board, typer.Option(help="Where the two nodes are.")] = Board.BENCH,
    forget: Annotated[
        bool, typer.Option("--forget", help="Back to the image's key, which everybody knows.")
    ] = False,
    workspace: Annotated[
        Path | None, typer.Option("--workspace", help="Zephyr workspace, for --board sim.")
    ] = None,
) -> None:
    """Give both nodes a random key of their own: no other node can join the link.

    The key goes over both serial lines into the flash of the nodes, and nowhere
    else: it is neither shown nor kept. Run it again for another.

    Example: [bold]hil link-key[/bold]

    Example: [bold]hil link-key --board sim[/bold]
    """
    from contextlib import ExitStack  # noqa: PLC0415 (start-up time of --help)

    from hil import build, link_key, units  # noqa: PLC0415
    from hil.bench import BENCH_FILE  # noqa: PLC0415
    from hil.progress import bar  # noqa: PLC0415
    from hil.wire.messages import ROLES  # noqa: PLC0415

    with ExitStack() as stack, bar("a key for both nodes") as progress:
        nodes = {}
        for n, role in enumerate(ROLES):
            progress(0.3 * n, f"the {role}")
            if board is Board.SIM:
                image = build.build(role, "sim", workspace=workspace)
                babblesim = build.find_babblesim(build.find_workspace(workspace))
                unit = units.simulated(image, babblesim, seed=1, speed=5.0)
            else:
                unit = units.on_bench(role, BENCH_FILE)
            nodes[role] = link_key.Node(stack.enter_context(unit).port, role)
        progress(0.6, "telling both")
        link_key.change(nodes, forget=forget)
        if board is Board.BENCH:
            progress(0.8, "waiting until they are connected by it")
            link_key.wait_connected(nodes)
    which = "the image's key" if forget else "a new key"
    if board is Board.BENCH:
        typer.echo(f"both nodes have {which}, and have proved it to each other")
    else:
        typer.echo(f"both simulated nodes have {which}; each has a radio of its own")
