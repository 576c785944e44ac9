# SPDX-License-Identifier: Apache-2.0
"""The page's server: five files and one WebSocket, which carries frames out and receipts in.

A browser says which frame it has drawn. One that is behind by ``IN_FLIGHT_MAX`` is sent nothing
until it has caught up, and then the newest state: nothing queues up for it here.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from importlib.resources import files
from typing import Any, Final
from urllib.parse import SplitResult, parse_qs, urlsplit

from websockets.asyncio.server import Server as Listener
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers, MultipleValuesError
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from hil.errors import HilError
from hil.live.access import Access, cookie_name, is_loopback
from hil.live.page import Page, Seen
from hil.live.sources import Feed

FRAME_RATE_HZ: Final = 30.0
IN_FLIGHT_MAX: Final = 6
"""A fifth of a second: a wireless network's round trip, and no more."""
CLIENTS_MAX: Final = 16
MESSAGE_MAX: Final = 32
"""Bytes of a receipt, which is a decimal number."""
HANDSHAKE_LIMIT_S: Final = 5.0
WRITE_LIMIT: Final = 1 << 16
CLOSE_LIMIT_S: Final = 1.0

FILES: Final = {
    "/": ("hil.live", "assets/live.html", "text/html; charset=utf-8"),
    "/live.css": ("hil.live", "assets/live.css", "text/css; charset=utf-8"),
    "/live.js": ("hil.live", "assets/live.js", "text/javascript; charset=utf-8"),
    "/icon.svg": ("hil.live", "assets/icon.svg", "image/svg+xml"),
    "/uplot.js": ("hil.report", "assets/uplot/uPlot.iife.min.js", "text/javascript; charset=utf-8"),
    "/uplot.css": ("hil.report", "assets/uplot/uPlot.min.css", "text/css; charset=utf-8"),
}
"""Path -> package, file, type: all that is ever served."""
SOCKET_PATH: Final = "/frames"

REFUSALS: Final = {
    HTTPStatus.FORBIDDEN: "This page is not for this browser.\n\n"
    "An address opens the page once. The computer that runs 'hil live' shows the next one: open "
    "that.\n",
    HTTPStatus.MISDIRECTED_REQUEST: "This server is not known by that name.\n",
    HTTPStatus.NOT_FOUND: "There is no such file here.\n",
    HTTPStatus.BAD_REQUEST: "This request is not understood.\n",
    HTTPStatus.SERVICE_UNAVAILABLE: "Too many browsers show this page already.\n",
}


@dataclass(frozen=True)
class Address:
    """Where the server listens."""

    host: str
    port: int

    @property
    def url(self) -> str:
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{shown}:{self.port}/"


class Server:
    """Serves one page to several browsers.

    Args:
        traded: called when a browser has spent a token; the next one is then in ``access``.
    """

    def __init__(
        self, page: Page, feed: Feed, access: Access, traded: Callable[[], None] = lambda: None
    ) -> None:
        self.access = access
        self._page = page
        self._feed = feed
        self._traded = traded
        self._clients = 0
        self._tick = asyncio.Event()
        self._texts: dict[Seen, tuple[dict[str, Any], Seen]] = {}

    @asynccontextmanager
    async def listening(self, host: str, port: int) -> AsyncIterator[Address]:
        """Serve while the block runs.

        Args:
            port: 0 for any that is free.

        Raises:
            HilError: the address cannot be listened on.
        """
        quiet = logging.getLogger("hil.live")
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False
        try:
            listener = await serve(
                self._serve,
                host,
                port,
                process_request=self._answer,
                compression=None,
                server_header=None,
                max_size=MESSAGE_MAX,
                max_queue=4,
                write_limit=WRITE_LIMIT,
                open_timeout=HANDSHAKE_LIMIT_S,
                close_timeout=CLOSE_LIMIT_S,
                logger=quiet,
            )
        except OSError as error:
            raise HilError(
                f"cannot listen on {host}, port {port}: {error.strerror or error}",
                "another port: --http-port 0 takes any that is free",
            ) from error
        ticking = asyncio.create_task(self._keep_ticking())
        try:
            yield Address(host, _port(listener))
        finally:
            ticking.cancel()
            listener.close()
            await listener.wait_closed()

    async def _keep_ticking(self) -> None:
        due_s = time.monotonic()
        while True:
            with self._feed.lock:
                self._page.refresh(time.monotonic())
            self._texts.clear()
            self._tick.set()
            self._tick = asyncio.Event()
            # Frames that were missed are not made up for.
            due_s = max(due_s + 1.0 / FRAME_RATE_HZ, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())

    # ---- HTTP ----------------------------------------------------------------------------------

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file or a refusal; None lets the WebSocket be opened."""
        try:
            host = request.headers.get("Host", "")
            origin = request.headers.get("Origin", "")
            cookies = request.headers.get("Cookie", "")
        except MultipleValuesError:
            return _refusal(HTTPStatus.BAD_REQUEST)
        address, port = connection.local_address[:2]
        if not self.access.is_our_host(host, address, port):
            return _refusal(HTTPStatus.MISDIRECTED_REQUEST)
        asked = urlsplit(request.path)
        session = self.access.has_session(cookies, port)
        if asked.path != SOCKET_PATH:
            return self._file(asked, host, port, session)
        if not session or not self.access.is_our_origin(origin, host):
            return _refusal(HTTPStatus.FORBIDDEN)
        return None if self._clients < CLIENTS_MAX else _refusal(HTTPStatus.SERVICE_UNAVAILABLE)

    def _file(self, asked: SplitResult, host: str, port: int, session: bool) -> Response:
        cookie = ""
        if not session and asked.path == "/":
            given = self.access.trade(parse_qs(asked.query).get("token", [""])[0])
            if given is not None:
                session = True
                cookie = f"{cookie_name(port)}={given}; HttpOnly; SameSite=Strict; Path=/"
                self._traded()
        if not session:
            return _refusal(HTTPStatus.FORBIDDEN)
        if asked.path not in FILES:
            return _refusal(HTTPStatus.NOT_FOUND)
        response = _response(HTTPStatus.OK, _file(asked.path), FILES[asked.path][2], host)
        if cookie:
            response.headers["Set-Cookie"] = cookie
        return response

    # ---- WebSocket -----------------------------------------------------------------------------

    async def _serve(self, connection: ServerConnection) -> None:
        self._clients += 1
        client = _Client(connection)
        try:
            async with asyncio.TaskGroup() as both:
                sending = both.create_task(self._send(client))
                await client.listen()
                sending.cancel()
        finally:
            self._clients -= 1

    async def _send(self, client: _Client) -> None:
        seen = Seen()
        while True:
            await self._tick.wait()
            if client.sent - client.drawn >= IN_FLIGHT_MAX:
                continue
            frame, known = self._frame(seen)
            if known == seen:
                continue
            seen = known
            client.sent += 1
            text = json.dumps({"n": client.sent, **frame}, allow_nan=False)
            try:
                await client.connection.send(text)
            except ConnectionClosed:
                return

    def _frame(self, seen: Seen) -> tuple[dict[str, Any], Seen]:
        """As :meth:`Page.since`, worked out once for all browsers that know as much."""
        if seen not in self._texts:
            with self._feed.lock:
                self._texts[seen] = self._page.since(seen)
        return self._texts[seen]


class _Client:
    """One browser: how many frames it was sent, and how many it has drawn."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.sent = 0
        self.drawn = 0

    async def listen(self) -> None:
        """Take receipts; anything else ends the connection."""
        with contextlib.suppress(ConnectionClosed):
            async for message in self.connection:
                number = _receipt(message)
                if not self.drawn < number <= self.sent:
                    await self.connection.close(1008, "not a receipt")
                    return
                self.drawn = number


def _receipt(message: str | bytes) -> int:
    plain = isinstance(message, str) and message.isascii() and message.isdecimal()
    return int(message) if plain else -1


def _response(status: HTTPStatus, body: bytes, type_: str, host: str) -> Response:
    policy = (
        f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        f"connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )
    headers = Headers(
        {
            "Connection": "close",
            "Content-Type": type_,
            "Content-Length": str(len(body)),
            "Content-Security-Policy": policy if host else "default-src 'none'",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
    )
    return Response(status.value, status.phrase, headers, body)


def _refusal(status: HTTPStatus) -> Response:
    return _response(status, REFUSALS[status].encode(), "text/plain; charset=utf-8", "")


@cache
def _file(path: str) -> bytes:
    package, name, _ = FILES[path]
    return files(package).joinpath(*name.split("/")).read_bytes()


def _port(listener: Listener) -> int:
    return int(next(iter(listener.sockets)).getsockname()[1])


def reachable(host: str) -> str:
    """The address to tell others: of a server that listens on all, the one towards the network."""
    if host not in ("0.0.0.0", "::", ""):  # noqa: S104
        return host
    family, far = (
        (socket.AF_INET6, "2001:db8::1") if host == "::" else (socket.AF_INET, "192.0.2.1")
    )
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            # Nothing is sent: the system only picks the way.
            probe.connect((far, 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "::1" if family == socket.AF_INET6 else "127.0.0.1"


def access_for(host: str) -> Access:
    """Free on this machine; by token from anywhere else."""
    return Access(open_to_all=is_loopback(host), names=[host])
