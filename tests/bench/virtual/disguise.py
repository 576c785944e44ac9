# SPDX-License-Identifier: Apache-2.0
"""HELLO of a simulated node, as a DK with the chip of a virtual bench would say it."""

from __future__ import annotations

import re

from hil.wire.codec import decode, encode
from hil.wire.messages import BY_NAME, TARGETS, schema_hash

HELLO = BY_NAME["hello"]
MAYBE = re.compile(rb"\x00[^\x00]" + re.escape(bytes([HELLO.id])))
"""Delimiter, a COBS code, the type."""


class Disguise:
    """Takes a node's bytes in order, and gives them with each HELLO replaced; all else stays."""

    def __init__(self, device_id: int) -> None:
        self._device_id = device_id
        self._held = b""

    def feed(self, data: bytes) -> bytes:
        """What may be passed on: up to the last delimiter, which may begin a frame."""
        stream = self._held + data
        cut = max(stream.rfind(0), 0)
        whole, self._held = stream[: cut + 1], stream[cut:]
        if not MAYBE.search(whole):
            return whole[:-1]
        passed, at = b"", 0
        for hello in decode(whole).messages[HELLO.name]:
            start = int(hello["offset"]) - 1
            fields = {f.name: hello[f.name].item() for f in HELLO.fields}
            fields |= {"target": TARGETS["nrf52840dk"], "device_id": self._device_id}
            fields |= {"schema_hash": schema_hash()}
            passed += whole[at:start] + encode(HELLO.name, fields, int(hello["seq"]))
            at = whole.index(0, start + 1) + 1
        return (passed + whole[at:])[:-1]
