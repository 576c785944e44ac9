# SPDX-License-Identifier: Apache-2.0
"""What ``hil calibrate`` does, apart from its options."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from hil.atomic import write_whole
from hil.calibration import kconfig
from hil.calibration.record import Record, load
from hil.calibration.tool import guide
from hil.calibration.tool.screen import Screen
from hil.calibration.tool.unit import Port, Unit
from hil.errors import HilError


def calibrate(
    port: Port,
    role: str,
    plan: guide.Plan,
    screen: Screen,
    *,
    helper: guide.Helper | None = None,
    source: Path | None = None,
    to_defaults: Path | None = None,
    folder: Path,
    dry_run: bool = False,
) -> None:
    """Calibrate the unit at ``port``, or write a record that there is, and confirm it.

    Args:
        source: a record to take instead of measuring.
        to_defaults: a Kconfig fragment to write instead of writing to the unit.
        folder: where a new record is kept.
        dry_run: measure and show; write nothing anywhere.

    Raises:
        HilError: as :mod:`hil.calibration.tool.guide`.
    """
    unit = Unit(port, role)
    unit.connect()
    screen.say(guide.describe(unit))
    written = False
    try:
        record = load(source) if source else guide.measure(unit, plan, screen, helper)
        if dry_run:
            screen.say("dry run: nothing was written")
            return
        if not screen.confirm(_question(unit, to_defaults)):
            screen.say("nothing was written; the unit keeps the calibration it had")
            return
        if source is None:
            guide.save(record, folder, screen)
        if to_defaults is not None:
            write_defaults(record, to_defaults, screen)
            return
        written = True
        guide.write(unit, record, screen)
    except KeyboardInterrupt:
        state = (
            "its store holds the old record or the new one, whole: hil calibrate --dry-run shows it"
            if written
            else "the unit keeps the calibration it had"
        )
        screen.say(f"interrupted: {state}", "yellow")
        raise


def write_defaults(record: Record, path: Path, screen: Screen) -> None:
    """Write a record as a Kconfig fragment, whole or not at all.

    Raises:
        HilError: the disk says no.
    """
    text = kconfig.fragment(record.calibration, record.path.name)
    try:
        write_whole(path, text.encode("ascii"))
    except OSError as error:
        raise HilError(f"{path} could not be written: {error.strerror or error}") from error
    screen.say(f"defaults: {path}; build with -- -DEXTRA_CONF_FILE={path.absolute()}")


def screen_on(console: Console, assume_yes: bool) -> Screen:
    """The screen that a command shows itself on."""
    return Screen(console, assume_yes)


def _question(unit: Unit, to_defaults: Path | None) -> str:
    if to_defaults is not None:
        return f"Write this calibration to {to_defaults}?"
    return f"Write this calibration to the {unit.role} {unit.device_id}?"
