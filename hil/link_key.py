# SPDX-License-Identifier: Apache-2.0
"""A key of their own for both nodes, over their serial lines: see docs/security.md.

The key is made here, goes to both nodes, and is forgotten: it is never printed, logged or written
to a file, and no message holds it. Who wants another makes another.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from hil.calibration.tool.unit import Port
from hil.errors import RigError
from hil.wire.codec import encode
from hil.wire.live import LiveStream
from hil.wire.messages import BY_NAME, FAULT_CODES, LINK_KEY_ORIGINS, ROLES, schema_hash

KEY_SIZE_B: Final = BY_NAME["link_key"].fields[0].count
HEARD_LIMIT_S: Final = 6.0
"""HELLO comes every two seconds, LINK_SECURITY every second."""
ANSWER_LIMIT_S: Final = 3.0
CONNECT_LIMIT_S: Final = 20.0
"""Both nodes look for each other anew, with pauses of up to some seconds between tries."""
TRIES: Final = 3
POLL_S: Final = 0.1

_MEND_SILENT: Final = (
    "is the board powered, and this its port? a DK has two: hil bench show\n"
    "is our firmware on it? hil doctor"
)


class Node:
    """One node at the end of a serial line, as far as its key goes.

    Args:
        now_s: a clock that never goes back; limits of waiting are by it.
    """

    def __init__(self, port: Port, role: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self.role = role
        self._port = port
        self._now_s = now_s
        self._stream = LiveStream()
        self._seq = 0
        self._hello: Mapping[str, Any] = {}
        self._security: Mapping[str, Any] = {}
        self._refusals: list[int] = []

    @property
    def is_secure(self) -> bool:
        """Whether its peer has proved the key, as it said last."""
        return bool(self._security) and bool(self._security["secure"])

    def connect(self) -> None:
        """Wait until it has said who it is and which key is in force.

        Raises:
            RigError: nothing comes, it is the other one, or it speaks another protocol.
        """
        if not self._came(lambda: bool(self._hello), HEARD_LIMIT_S):
            raise RigError(f"the {self.role} did not say who it is", _MEND_SILENT)
        if self._hello["schema_hash"] != schema_hash():
            raise RigError(
                f"the {self.role}'s firmware speaks another version of the protocol",
                f"hil build --role {self.role} --target nrf52840dk\nhil bench flash",
            )
        if self._hello["role"] != ROLES[self.role]:
            raise RigError(
                f"the unit at the {self.role}'s port is not the {self.role}",
                "put the ports in boards/bench.toml right: hil bench show",
            )
        if not self._came(lambda: bool(self._security), HEARD_LIMIT_S):
            raise RigError(f"the {self.role} does not say which key is in force", _MEND_SILENT)

    def take(self, key: bytes) -> None:
        """Give it ``key`` and wait until it says that it is in force.

        One that holds a stored key already goes back to the image's first: otherwise its answer
        would be the same whether it took the new key or not.

        Raises:
            RigError: it refused, or does not answer.
        """
        if self._security["key"] == LINK_KEY_ORIGINS["stored"]:
            self.forget()
        self._tell(key, "stored")

    def forget(self) -> None:
        """Put it back to the image's key.

        Raises:
            RigError: as :meth:`take`.
        """
        self._tell(bytes(KEY_SIZE_B), "image")

    def poll(self, timeout_s: float = POLL_S) -> None:
        """Take in what has come."""
        found = self._stream.feed(self._port.read_bytes(timeout_s)).messages
        for name in ("hello", "link_security"):
            if found[name].size:
                last = {field: found[name][field][-1] for field in found[name].dtype.names or ()}
                if name == "hello":
                    self._hello = last
                else:
                    self._security = last
        refused = found["fault"]["code"] == FAULT_CODES["command_refused"]
        self._refusals += [int(n) for n in found["fault"]["argument"][refused]]

    def _tell(self, key: bytes, origin: str) -> None:
        while waiting := self._port.read_bytes(0.0):
            self._stream.feed(waiting)
        self._refusals = []
        wanted = LINK_KEY_ORIGINS[origin]
        for _ in range(TRIES):
            self._security = {}
            self._port.write(encode("link_key", {"key": list(key)}, self._seq))
            self._seq += 1
            if self._came(
                lambda: bool(self._refusals) or self._security.get("key") == wanted,
                ANSWER_LIMIT_S,
            ):
                break
        else:
            raise RigError(f"the {self.role} does not answer the key", _MEND_SILENT)
        if self._refusals:
            raise RigError(
                f"the {self.role} could not store the key (its error {self._refusals[-1]})",
                "reset it and try again\nif it stays, its flash is worn",
            )

    def _came(self, condition: Callable[[], bool], limit_s: float) -> bool:
        deadline_s = self._now_s() + limit_s
        while not condition():
            if self._now_s() > deadline_s:
                return False
            self.poll()
        return True


def change(nodes: Mapping[str, Node], *, forget: bool = False) -> None:
    """Give both nodes one new key, or with ``forget`` the image's again.

    Raises:
        RigError: a node cannot be reached, and none was told anything; or not both took the key:
            the message says which did, and the mend what to do about it.
    """
    for node in nodes.values():
        node.connect()
    key = secrets.token_bytes(KEY_SIZE_B)
    done: list[str] = []
    for role, node in nodes.items():
        try:
            if forget:
                node.forget()
            else:
                node.take(key)
        except RigError as error:
            raise RigError(_state(error.message, role, done), _mend(error.mend, done)) from error
        done.append(role)


def wait_connected(
    nodes: Mapping[str, Node],
    limit_s: float = CONNECT_LIMIT_S,
    now_s: Callable[[], float] = time.monotonic,
) -> None:
    """Wait until each node says that the other has proved the key.

    Raises:
        RigError: they do not find each other.
    """
    deadline_s = now_s() + limit_s
    while not all(node.is_secure for node in nodes.values()):
        if now_s() > deadline_s:
            raise RigError(
                f"both nodes took the key but are not connected by it after {limit_s:g} s",
                "are they powered and within reach of each other?\nagain: hil link-key",
            )
        for node in nodes.values():
            node.poll()


def _state(what: str, role: str, done: list[str]) -> str:
    if done:
        return f"{what}: the {done[0]} has the new key, the {role} has not; they do not connect"
    return f"{what}: the other node was not told anything"


def _mend(mend: str, done: list[str]) -> str:
    again = "hil link-key  (a new key for both)"
    if done:
        again += "\nhil link-key --forget  (both back to the image's key)"
    return f"{mend}\n{again}"
