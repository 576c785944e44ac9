# SPDX-License-Identifier: Apache-2.0
"""The analyser of a bench, ready to capture the channels that the bench file names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from hil.bench.errors import InventoryError

if TYPE_CHECKING:
    from hil.bench.analyser.capture import Analyser as RunningAnalyser
    from hil.bench.inventory import Analyser, Inventory

MARGIN_S = 120.0
"""Longer than a run a capture is never meant to last: flash is done, reset and HELLO are quick."""

SUFFIXES = {"sigrok": ".sr", "saleae": ".sal"}
"""Kind -> file name's end of a capture that is kept."""


def analyser_of(bench: Inventory, duration_s: float) -> RunningAnalyser | None:
    """The analyser, found but not yet capturing; None when the bench has none.

    Raises:
        RigError: it is not there, or has not a channel that the bench file names.
    """
    wanted = bench.analyser
    if wanted is None:
        return None
    if wanted.kind == "saleae":
        from hil.bench.analyser.saleae import SaleaeAnalyser  # noqa: PLC0415 (an extra)

        inputs = {str(signal): _input(bench, name) for name, signal in wanted.channels.items()}
        return SaleaeAnalyser(inputs, wanted.samplerate_hz)
    from hil.bench.analyser.find import find_sigrok  # noqa: PLC0415 (start-up time)
    from hil.bench.analyser.sigrok import SigrokAnalyser  # noqa: PLC0415

    driver, conn = split_driver(wanted)
    wires = {str(signal): name for name, signal in wanted.channels.items()}
    return SigrokAnalyser(
        find_sigrok(driver, conn=conn), wires, wanted.samplerate_hz, limit_s=duration_s + MARGIN_S
    )


def split_driver(wanted: Analyser) -> tuple[str, str]:
    """The driver for a scan and where its device is connected: ``fx2lafw:conn=1.7``."""
    name, *options = wanted.driver.split(":")
    conn = "".join(o.removeprefix("conn=") for o in options if o.startswith("conn="))
    return ":".join([name, *(o for o in options if not o.startswith("conn="))]), conn


def _input(bench: Inventory, name: str) -> int:
    match = re.fullmatch(r"[A-Za-z ]*([0-9]{1,2})", name)
    if match is None:
        raise InventoryError(
            f"{bench.path}: analyser.channels.{name}: a Saleae input is a number",
            'name it after its number, for instance D0 = "leader.pulse"',
        )
    return int(match[1])
