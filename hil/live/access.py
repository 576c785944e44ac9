# SPDX-License-Identifier: Apache-2.0
"""Who may see the page.

* ``Host`` must name the very address that the connection was made to, or a name that the server was
  told to have. A page elsewhere whose name was made to point here (DNS rebinding) sends its own.
* A WebSocket must come from a page of that same host (``Origin``).
* Beyond this machine, a browser needs a session. It is given one for a token that is in the address
  it opens; each token works once, and the next one is made when it is used.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Sequence
from http.cookies import CookieError, SimpleCookie
from typing import Final

TOKEN_BYTES: Final = 32
SESSIONS_MAX: Final = 16
NAMES_MAX: Final = 253


class Access:
    """See the module.

    Args:
        open_to_all: no session is needed: the server listens on this machine alone.
        names: host names that the server answers to beside the address of the connection.

    Attributes:
        token: what opens the next session; empty when no more are given.
    """

    def __init__(self, *, open_to_all: bool, names: Sequence[str] = ()) -> None:
        self.open_to_all = open_to_all
        self.token = "" if open_to_all else secrets.token_urlsafe(TOKEN_BYTES)
        self._names = {name.lower() for name in names}
        self._sessions: list[str] = []

    def is_our_host(self, host: str, address: str, port: int) -> bool:
        """Whether a ``Host`` header names this server.

        Args:
            address, port: the server's end of the connection.
        """
        name, given = _split(host)
        if given != port:
            return False
        ours = _ip(address)
        asked = _ip(name)
        if asked is not None:
            return asked == ours
        loopback = ours is not None and ours.is_loopback
        return name in self._names or (loopback and name == "localhost")

    @staticmethod
    def is_our_origin(origin: str, host: str) -> bool:
        """Whether an ``Origin`` header is that of a page of ``host``, which has been checked."""
        return hmac.compare_digest(origin.encode(), f"http://{host}".encode())

    def has_session(self, cookies: str, port: int) -> bool:
        """Whether a ``Cookie`` header shows a session, or none is needed."""
        if self.open_to_all:
            return True
        try:
            found = SimpleCookie(cookies).get(cookie_name(port))
        except CookieError:
            return False
        shown = found.value.encode() if found else b""
        return any(hmac.compare_digest(shown, one.encode()) for one in self._sessions)

    def trade(self, token: str) -> str | None:
        """A new session for the token, which is spent with that; None when it is not the one."""
        if not self.token or not hmac.compare_digest(token.encode(), self.token.encode()):
            return None
        session = secrets.token_urlsafe(TOKEN_BYTES)
        self._sessions.append(session)
        full = len(self._sessions) >= SESSIONS_MAX
        self.token = "" if full else secrets.token_urlsafe(TOKEN_BYTES)
        return session


def cookie_name(port: int) -> str:
    """Cookies do not tell ports apart, so their names must."""
    return f"hil_live_{port}"


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches ``address``."""
    found = _ip(address)
    return address == "localhost" or (found is not None and found.is_loopback)


def _split(host: str) -> tuple[str, int]:
    """Name and port of a ``Host`` header; port 80 where there is none, -1 where it is no number."""
    name, colon, port = host.rpartition(":")
    if not colon or port.endswith("]"):
        name, port = host, "80"
    if len(name) > NAMES_MAX or not (port.isascii() and port.isdecimal() and len(port) <= 5):
        return "", -1
    return name.removeprefix("[").removesuffix("]").lower(), int(port)


def _ip(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None
