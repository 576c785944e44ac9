# SPDX-License-Identifier: Apache-2.0
"""What the firmware says of itself at boot, held against what was flashed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hil.wire.messages import ROLES, TARGETS, schema_hash

if TYPE_CHECKING:
    from hil.build import Manifest


def check_hello(hello: Mapping[str, Any], manifest: Manifest, device_id: int) -> list[str]:
    """What is wrong with a HELLO; empty when it is the firmware and the chip that were meant.

    Args:
        hello: the message's fields, raw; a mapping or a structured record.
        manifest: of the image that was flashed.
        device_id: FICR DEVICEID, as the probe read it.

    Returns:
        One sentence for each field that differs.
    """
    said_role, said_target = int(hello["role"]), int(hello["target"])
    found = []
    if said_role != ROLES[manifest.role]:
        found.append(f"it says that it is {_name(ROLES, said_role)}, not the {manifest.role}")
    if said_target != TARGETS[manifest.target]:
        found.append(
            f"it says that it runs on {_name(TARGETS, said_target)}, not on {manifest.target}"
        )
    if int(hello["build_id"]) != int(manifest.build_id, 16):
        found.append(
            f"it says build {int(hello['build_id']):016x}; "
            f"flashed was {manifest.build_id}: another image runs"
        )
    if int(hello["schema_hash"]) != schema_hash():
        found.append(
            f"it speaks protocol table {int(hello['schema_hash']):016x}; "
            f"this rig knows {schema_hash():016x}: build the firmware again"
        )
    if int(hello["device_id"]) != device_id:
        found.append(
            f"it runs on chip {int(hello['device_id']):016x}; the probe sees {device_id:016x}: "
            "the serial port is the other board's"
        )
    return found


def _name(names: Mapping[str, int], value: int) -> str:
    return next((f"the {name}" for name, number in names.items() if number == value), str(value))
