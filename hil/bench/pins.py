# SPDX-License-Identifier: Apache-2.0
"""The pin map of ``boards/README.md`` as data: which signal is on which pin of a node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Pin:
    """One signal of a node.

    Attributes:
        signal: its name in the bench file and in a recording's edges.
        pin: port and number on the chip.
        header: print on the DK (PCA10056).
        is_output: the node drives it; an input can be listened to as well.
    """

    signal: str
    pin: str
    header: str
    is_output: bool


PINS: Final[Mapping[str, Pin]] = {
    pin.signal: pin
    for pin in (
        Pin("radio_end", "P1.02", "D1", True),
        Pin("pulse", "P1.03", "D2", True),
        Pin("pulse_in", "P1.04", "D3", False),
        Pin("imu_int1", "P1.05", "D4", False),
    )
}
"""Signal -> pin, those that a wire of the bench may end at."""


def find(name: str) -> Pin | None:
    """The pin called ``name``: a signal (``pulse``), a pin (``P1.03``) or a print (``D2``)."""
    for pin in PINS.values():
        if name.lower() in (pin.signal, pin.pin.lower(), pin.header.lower()):
            return pin
    return None
