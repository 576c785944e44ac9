# SPDX-License-Identifier: Apache-2.0
"""Waiting for a node to say who it is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from hil.wire.codec import decode
from hil.wire.messages import BY_NAME

HELLO_LIMIT_S: Final = 5.0
"""HELLO comes at boot and every two seconds."""

KEPT_B: Final = 1 << 20


def hear_hello(
    read: Callable[[float], bytes], limit_s: float = HELLO_LIMIT_S
) -> dict[str, Any] | None:
    """The first whole HELLO on a serial line.

    Args:
        read: gives what has come, at the latest after as many seconds as it is told.

    Returns:
        Its fields, raw; None when none came in time.
    """
    deadline_s = time.monotonic() + limit_s
    stream = bytearray()
    while (left_s := deadline_s - time.monotonic()) > 0:
        fresh = read(min(left_s, 0.25))
        if not fresh:
            continue
        stream += fresh
        del stream[:-KEPT_B]
        found = decode(bytes(stream)).messages["hello"]
        if found.size:
            return {f.name: found[0][f.name].item() for f in BY_NAME["hello"].fields}
    return None
