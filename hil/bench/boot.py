# SPDX-License-Identifier: Apache-2.0
"""The boards start anew: what was said before belongs to no run, and each must say who it is.

A HELLO is of this start when its uptime fits between the reset and its arrival. Firmware that ran
on has been up for longer than that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from hil.bench.hello import check_hello
from hil.bench.listen import HELLO_LIMIT_S, fields
from hil.bench.port import Chunk, SerialPort
from hil.build import Manifest
from hil.errors import RigError
from hil.wire.codec import decode
from hil.wire.messages import ROLES

POLL_S: Final = 0.02
DRAIN_S: Final = 0.15
KEPT_B: Final = 1 << 20
"""How much of what came is looked through for a HELLO."""
UPTIME_SLACK_MS: Final = 2
"""One for the grid of uptime, one for the crystals."""


@dataclass(frozen=True)
class Boot:
    """One board's start.

    Attributes:
        hello: the fields of its HELLO, raw.
        chunks: what it said from that HELLO on.
        dropped_bytes: what had come before it.
    """

    hello: Mapping[str, Any]
    chunks: list[Chunk]
    dropped_bytes: int

    @property
    def t_ns_host(self) -> int:
        """When HELLO had come, host's monotonic clock."""
        return self.chunks[0].t_ns_host


def restart(
    ports: Mapping[str, SerialPort], reset: Callable[[], None], limit_s: float = HELLO_LIMIT_S
) -> tuple[int, dict[str, Boot]]:
    """Reset the boards and hear the HELLO of each.

    Returns:
        When the reset was given, ns on the host's monotonic clock, and role -> its start.

    Raises:
        RigError: the reset failed, a port was lost, or a board says nothing or goes on as before.
    """
    stale_bytes = {role: drain(port) for role, port in ports.items()}
    reset_ns_host = time.monotonic_ns()
    reset()
    deadline_s = time.monotonic() + limit_s
    heard: dict[str, list[Chunk]] = {role: [] for role in ports}
    found: dict[str, tuple[dict[str, Any], int]] = {}
    while len(found) < len(ports):
        for role, port in ports.items():
            heard[role] += port.read(POLL_S)
            if role not in found and (first := first_hello(heard[role], reset_ns_host)):
                found[role] = first
        if time.monotonic() > deadline_s and len(found) < len(ports):
            raise _silent(ports, heard, found, limit_s)
    return reset_ns_host, {
        role: Boot(hello, behind(heard[role], start), stale_bytes[role] + start)
        for role, (hello, start) in found.items()
    }


def drain(port: SerialPort) -> int:
    """Throw away what a debugger had kept from while nobody listened; returns how much.

    It could hold the HELLO of a start just before this one.
    """
    count, deadline_s = 0, time.monotonic() + DRAIN_S
    while (left_s := deadline_s - time.monotonic()) > 0:
        count += len(port.read_bytes(left_s))
    return count


def first_hello(chunks: list[Chunk], reset_ns_host: int) -> tuple[dict[str, Any], int] | None:
    """The fields of the first HELLO of firmware that was started after the reset, raw, and where
    its frame begins; None when there is none yet."""
    stream = b"".join(chunk.data for chunk in chunks)[:KEPT_B]
    for hello in decode(stream).messages["hello"]:
        # Its frame begins with the 00 before the offset.
        start = max(int(hello["offset"]) - 1, 0)
        since_ms = (behind(chunks, start)[0].t_ns_host - reset_ns_host) / 1e6
        if int(hello["uptime_ms"]) <= since_ms + UPTIME_SLACK_MS:
            return fields(hello), start
    return None


def behind(chunks: list[Chunk], start: int) -> list[Chunk]:
    """What the chunks hold from byte ``start`` on."""
    position = 0
    for n, chunk in enumerate(chunks):
        end = position + len(chunk.data)
        if start < end:
            return [Chunk(chunk.t_ns_host, chunk.data[start - position :]), *chunks[n + 1 :]]
        position = end
    return []


def check(
    boots: Mapping[str, Boot], manifests: Mapping[str, Manifest], device_ids: Mapping[str, int]
) -> None:
    """Hold what the boards say of themselves against what was flashed.

    Raises:
        RigError: a sentence for each field that differs.
    """
    found = {
        role: check_hello(b.hello, manifests[role], device_ids[role]) for role, b in boots.items()
    }
    if not any(found.values()):
        return
    chips = {role: int(boot.hello["device_id"]) for role, boot in boots.items()}
    exchanged = any(
        chips[role] == device_ids[other] for role in chips for other in device_ids if other != role
    ) or any(int(boot.hello["role"]) != ROLES[role] for role, boot in boots.items())
    raise RigError(
        "\n".join(f"{role}: {line}" for role, lines in found.items() for line in lines),
        "a serial port answers for the wrong board: see 'probe' and 'vcom' of both boards in the "
        "bench file; hil bench init --force writes it anew\nhil doctor shows who answers where"
        if exchanged
        else "write both boards anew: hil bench flash --always\n"
        "does the board start another image, or was a build changed by hand?",
    )


def _silent(
    ports: Mapping[str, SerialPort],
    heard: Mapping[str, list[Chunk]],
    found: Mapping[str, object],
    limit_s: float,
) -> RigError:
    lines = []
    for role, port in ports.items():
        if role in found:
            continue
        count = sum(len(chunk.data) for chunk in heard[role])
        old = decode(b"".join(c.data for c in heard[role])[:KEPT_B]).messages["hello"].size
        lines.append(
            f"the {role} goes on at {port.path} as if there had been no reset"
            if old
            else f"the {role} did not say HELLO at {port.path} within {limit_s:g} s of its reset "
            f"({count} bytes came)"
        )
    return RigError(
        "\n".join(lines),
        "a DK has two ports: try vcom = 0 and vcom = 2 in the bench file\n"
        "does the port belong to another board? hil doctor shows who answers where\n"
        "hil bench flash --always, then hil doctor",
    )
