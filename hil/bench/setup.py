# SPDX-License-Identifier: Apache-2.0
"""A new bench file from what is plugged in."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hil.bench.errors import InventoryError, ProbeMissingError
from hil.bench.inventory import FORMAT, normal_serial, parse
from hil.bench.wiring import WANTED
from hil.wire.messages import ROLES

SAMPLERATE_HZ: Final = 8_000_000
CHANNELS: Final = ("D0", "D1", "D2", "D3", "D4", "D5")

MEND_NONE: Final = (
    "plug both boards in, at the debugger's connector, not at nRF USB, and switch them on\n"
    "another cable: some carry power only\n"
    "in a virtual machine or container: pass the USB devices through"
)


def roles(probes: list[str], leader: str, follower: str) -> tuple[str, str] | None:
    """Who is leader and who is follower.

    Args:
        probes: serial numbers of the connected probes.
        leader: serial number that the user gave, or empty.
        follower: as ``leader``.

    Returns:
        Leader and follower; None when two are there and the user has not said which is which.

    Raises:
        ProbeMissingError: there are not enough, or one that was named is not there.
        InventoryError: there are more than two, or one was named twice.
    """
    leader, follower = (normal_serial(s) if s else "" for s in (leader, follower))
    shown = ", ".join(probes) or "none"
    for role, named in (("leader", leader), ("follower", follower)):
        if named and named not in probes:
            raise ProbeMissingError(
                f"probe {named} (--{role}) is not connected; connected: {shown}", MEND_NONE
            )
    if leader and leader == follower:
        raise InventoryError(
            f"probe {leader} is named for both roles", "each board has a probe of its own"
        )
    if not probes:
        raise ProbeMissingError("no debug probe is connected", MEND_NONE)
    if len(probes) == 1:
        raise ProbeMissingError(
            f"only one debug probe is connected ({shown}); a bench has two boards", MEND_NONE
        )
    if leader and follower:
        return leader, follower
    if len(probes) > 2:
        raise InventoryError(
            f"{len(probes)} debug probes are connected: {shown}",
            "say which two are the bench: hil bench init --leader SERIAL --follower SERIAL\n"
            "the serial number is on the sticker of each board",
        )
    if leader or follower:
        other = next(p for p in probes if p not in (leader, follower))
        return leader or other, follower or other
    return None


def text(
    probes: tuple[str, str],
    vcoms: tuple[int, int] = (0, 0),
    driver: str = "",
    channels: Sequence[str] = CHANNELS,
) -> str:
    """The text of a bench file.

    Args:
        probes: serial numbers, the leader's first.
        vcoms: USB interface numbers of their serial ports.
        driver: sigrok's driver of the analyser; empty when there is none: then the two boards
            time each other through the pulse wires.
        channels: the analyser's names of its channels.
    """
    lines = [
        "# The bench: which probe is which role, which wire goes where. Keys: docs/bench.md",
        "",
        f"format = {FORMAT}",
        "",
        "[boards.leader]",
        f'probe = "{probes[0]}"',
        f"vcom = {vcoms[0]}",
        "",
        "[boards.follower]",
        f'probe = "{probes[1]}"',
        f"vcom = {vcoms[1]}",
    ]
    if not driver:
        return "\n".join(
            (
                *lines,
                "",
                "# Without an analyser each board times the other's pulse.",
                "[[wires]]",
                'from = "leader.pulse"',
                'to = "follower.pulse_in"',
                "",
                "[[wires]]",
                'from = "follower.pulse"',
                'to = "leader.pulse_in"',
                "",
            )
        )
    signals = [f"{role}.{name}" for role in ROLES for name in WANTED]
    return "\n".join(
        (
            *lines,
            "",
            "[analyser]",
            'kind = "sigrok"',
            f'driver = "{driver}"',
            f"samplerate_hz = {SAMPLERATE_HZ:_}",
            "",
            "[analyser.channels]",
            *(f'{name} = "{signal}"' for name, signal in zip(channels, signals, strict=False)),
            "",
        )
    )


def write(path: Path, content: str, *, force: bool = False) -> None:
    """Write a bench file whole or not at all.

    Raises:
        InventoryError: there is one already and ``force`` is not given, or it cannot be written.
    """
    parse(content, path)
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(content, encoding="utf-8")
        if force:
            os.replace(partial, path)
        else:
            # A link, unlike a rename, fails when the name is taken.
            os.link(partial, path)
            partial.unlink()
    except FileExistsError:
        partial.unlink(missing_ok=True)
        raise InventoryError(
            f"there is a bench file already: {path}",
            "look at it: hil bench show\nwrite it anew: hil bench init --force",
        ) from None
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InventoryError(
            f"{path} cannot be written: {error.strerror}", "--file PATH"
        ) from error
