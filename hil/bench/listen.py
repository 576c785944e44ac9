# SPDX-License-Identifier: Apache-2.0
"""Waiting for a node to say who it is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from hil.wire.live import LiveStream
from hil.wire.messages import BY_NAME

HELLO_LIMIT_S: Final = 5.0
"""HELLO comes at boot and every two seconds."""


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
    stream = LiveStream()
    while (left_s := deadline_s - time.monotonic()) > 0:
        found = stream.feed(read(min(left_s, 0.25))).messages["hello"]
        if found.size:
            return fields(found[0])
    return None


def fields(hello: Any) -> dict[str, Any]:
    """A record of HELLO as plain numbers, by field."""
    return {f.name: hello[f.name].item() for f in BY_NAME["hello"].fields}
