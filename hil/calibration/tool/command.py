# SPDX-License-Identifier: Apache-2.0
"""What ``hil calibrate`` does, apart from its options."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from hil.atomic import write_whole
from hil.calibration import kconfig
from hil.calibration.record import Record, check_device, load
from hil.calibration.tool import guide
from hil.calibration.tool.screen import Screen, result_tables
from hil.calibration.tool.unit import Port, Unit
from hil.errors import HilError

EITHER: Final = (
    "its store holds the old calibration or the new one, whole; hil calibrate --dry-run says which"
)
STORED: Final = "the unit holds the new calibration, not yet confirmed by a reset"


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
    now_s: Callable[[], float] = time.monotonic,
) -> None:
    """Calibrate the unit at ``port``, or write a record that there is, and confirm it.

    Args:
        source: a record to take instead of measuring.
        to_defaults: a Kconfig fragment to write instead of writing to the unit.
        folder: where a new record is kept.
        dry_run: measure and show; write nothing anywhere.
        now_s: clock of the unit's time limits.

    Raises:
        HilError: as :mod:`hil.calibration.tool.guide`; or there is nobody to ask.
    """
    if not dry_run:
        screen.must_ask()
    given = None if source is None else load(source)
    unit = Unit(port, role, now_s)
    left = guide.KEPT
    try:
        unit.connect()
        screen.say(guide.describe(unit))
        record = _show(unit, given, screen) or guide.measure(unit, plan, screen, helper)
        if dry_run:
            screen.say("dry run: nothing was written")
            return
        if not screen.confirm(_question(unit, to_defaults)):
            screen.say(f"nothing was written; {guide.KEPT}")
            return
        if given is None:
            guide.save(record, folder, screen)
        if to_defaults is not None:
            write_defaults(record, to_defaults, screen)
            return
        left = EITHER
        guide.store(unit, record, screen)
        left = STORED
        guide.confirm(unit, record, screen)
    except KeyboardInterrupt:
        # The terminal has put ^C at the end of whatever line there was.
        screen.say(f"\ninterrupted: {left}", "yellow")
        raise


def write_defaults(record: Record, path: Path, screen: Screen, *, dry_run: bool = False) -> None:
    """Write a record as a Kconfig fragment, whole or not at all; with ``dry_run`` show it.

    Raises:
        HilError: the disk says no.
    """
    text = kconfig.fragment(record.calibration, record.path.name)
    if dry_run:
        screen.say(text.rstrip())
        screen.say("dry run: nothing was written")
        return
    try:
        write_whole(path, text.encode("ascii"))
    except OSError as error:
        raise HilError(
            f"{path} could not be written: {error.strerror or error}",
            "give a file in a folder that you may write to, with room on its disk",
        ) from error
    screen.say(f"defaults: {path}\nbuild with -- -DEXTRA_CONF_FILE={path.absolute()}")


def _show(unit: Unit, record: Record | None, screen: Screen) -> Record | None:
    """Show a record that there is, if it is this unit's."""
    if record is not None:
        check_device(record, unit.device_id)
        poses = list(record.poses)
        before = guide.magnitudes_until_now(unit, poses)
        screen.show(result_tables(record.calibration, poses, before))
    return record


def _question(unit: Unit, to_defaults: Path | None) -> str:
    if to_defaults is not None:
        return f"Write this calibration to {to_defaults}?"
    return f"Write this calibration to the {unit.role} {unit.device_id}?"
