# SPDX-License-Identifier: Apache-2.0
"""A bench drawn as text: which pin goes to which channel, which pin goes to which pin."""

from __future__ import annotations

from typing import Final

from hil.bench.inventory import Analyser, Inventory, Signal
from hil.bench.pins import PINS
from hil.wire.messages import ROLES

WANTED: Final = ("radio_end", "pulse", "imu_int1")
"""What an analyser should see of each board."""

_ASCII: Final = str.maketrans(
    {**dict.fromkeys("┌┐└┘├┤┬┴┼", "+"), "─": "-", "│": "|", "▶": ">", "◀": "<", "–": "-", "·": "-"}
)
_LABEL: Final = 18
_MIDDLE: Final = 15
_GAP: Final = "─" * 6


def draw(inventory: Inventory, *, ascii_only: bool = False) -> list[str]:
    """The drawing, line by line, 78 columns at most.

    Args:
        ascii_only: without line-drawing characters, for a terminal that has none.
    """
    lines = [f"bench {inventory.path}", ""]
    for role in ROLES:
        board = inventory.boards[role]
        chip = "" if board.device_id is None else f" · chip {board.device_id:016x}"
        lines.append(f"  {role:<9} probe {board.probe} · VCOM interface {board.vcom}{chip}")
    analyser = inventory.analyser
    lines.append(f"  {'analyser':<9} {_describe(analyser) if analyser else 'none'}")
    if inventory.runner:
        lines.append(f"  {'runner':<9} {inventory.runner}")
    if inventory.place:
        lines.append(f"  {'place':<9} {inventory.place.name} (labgrid)")
    lines += ["", *_analyser(analyser)] if analyser else []
    lines += ["", *_wires(inventory)] if inventory.wires else []
    lines += ["", *advice(inventory)]
    return [line.translate(_ASCII) if ascii_only else line for line in lines]


def advice(inventory: Inventory) -> list[str]:
    """What the wiring cannot show, one sentence each; or that nothing is missing."""
    seen = set(inventory.analyser.channels.values()) if inventory.analyser else set()
    wired = {(wire.start.role, wire.end.role) for wire in inventory.wires}
    found = []
    if inventory.analyser:
        missing = [
            str(signal)
            for role in ROLES
            for signal in (Signal(role, name) for name in WANTED)
            if signal not in seen
        ]
        if missing:
            found.append(f"not on the analyser: {', '.join(missing)}; checks of them stay unset")
    elif len(wired) < len(ROLES):
        found.append(
            "no analyser, and not both pulse wires (P1.03 to the other board's P1.04): "
            "the time sync cannot be checked from outside"
        )
    return found or ["every signal that the checks use is wired"]


def _describe(analyser: Analyser) -> str:
    rate = analyser.samplerate_hz
    text = f"{rate / 1e6:g} MHz" if rate >= 1_000_000 else f"{rate / 1e3:g} kHz"
    return " · ".join(part for part in (analyser.kind, analyser.driver, text) if part)


def _analyser(analyser: Analyser) -> list[str]:
    channel = {signal: name for name, signal in analyser.channels.items()}
    leader, follower = ROLES
    rows = []
    for name, pin in PINS.items():
        left, right = (channel.get(Signal(role, name), "") for role in (leader, follower))
        label = f"{pin.pin}  {name}"
        if left or right:
            rows.append(
                _row(label if left else "", left, right, f"{name}  {pin.pin}" if right else "")
            )
    rows.append(_row("GND", "GND", "GND", "GND"))
    side, middle = "─" * (_LABEL + 2), "─" * (_MIDDLE + 2)
    space = " " * len(_GAP)
    board = _LABEL + 4
    return [
        f"  {leader:^{board}}{space}{'analyser':^{_MIDDLE + 4}}{space}{follower:^{board}}",
        f"  ┌{side}┐{space}┌{middle}┐{space}┌{side}┐",
        *rows,
        f"  └{side}┘{space}└{middle}┘{space}└{side}┘",
    ]


def _row(left: str, left_channel: str, right_channel: str, right: str) -> str:
    blank = " " * len(_GAP)
    half = _MIDDLE // 2
    return (
        f"  │ {left:<{_LABEL}} {'├' + _GAP + '┤' if left else '│' + blank + '│'} "
        f"{left_channel:<{half}} {right_channel:>{_MIDDLE - half - 1}} "
        f"{'├' + _GAP + '┤' if right else '│' + blank + '│'} {right:>{_LABEL}} │"
    )


def _wires(inventory: Inventory) -> list[str]:
    lines = []
    for wire in inventory.wires:
        start = f"{wire.start.pin.pin}  {wire.start.signal}"
        end = f"{wire.end.pin.pin}  {wire.end.signal}"
        lines.append(f"  {wire.start.role:<8}  {start:<16} {'─' * 12}▶ {end:<16}  {wire.end.role}")
    return [*lines, f"  {'leader':<8}  {'GND':<16} {'─' * 13} {'GND':<16}  follower"]
