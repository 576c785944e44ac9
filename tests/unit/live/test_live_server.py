# SPDX-License-Identifier: Apache-2.0
"""Who is let in and what is served, over real sockets; browsers that are slow, or not browsers."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from urllib.parse import quote

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hil.errors import HilError
from hil.live import server as server_module
from hil.live.access import SESSIONS_MAX, Access, is_loopback
from hil.live.server import FILES, IN_FLIGHT_MAX, MESSAGE_MAX, Address, Server, reachable
from hil.live.sources import Replay
from hil.recording import Recording
from tests.unit.live.conftest import LIMIT_S, Served, until


def get(served: Served, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    """Status, headers and text of one GET; the path goes out as it stands."""
    connection = http.client.HTTPConnection(served.address.host, served.address.port, LIMIT_S)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    with connection.getresponse() as answer:
        return answer.status, dict(answer.getheaders()), answer.read().decode()


@contextmanager
def open_socket(
    served: Served, *, origin: str | None = None, cookie: str = ""
) -> Iterator[ClientConnection]:
    port = served.address.port
    with connect(
        f"ws://127.0.0.1:{port}/frames",
        origin=origin or f"http://127.0.0.1:{port}",  # type: ignore[arg-type]
        additional_headers={"Cookie": cookie} if cookie else {},
        open_timeout=LIMIT_S,
    ) as frames:
        yield frames


@pytest.fixture(scope="module")
def guarded(clean: Recording) -> Iterator[Served]:
    """As served to a network: by token alone."""
    with Served(Replay(clean, 0.0), Access(open_to_all=False)) as served:
        until(lambda: served.page.ended, "the end of the replay")
        yield served


def trade(served: Served) -> str:
    """A browser that opens the address and keeps the cookie."""
    status, headers, _ = get(served, f"/?token={served.access.token}")
    assert status == 200
    return headers["Set-Cookie"].split(";")[0]


def test_the_files_of_the_page_and_their_headers(clean_page: Served) -> None:
    port = clean_page.address.port
    for path, (_, _, type_) in FILES.items():
        status, headers, text = get(clean_page, path)
        assert (status, headers["Content-Type"]) == (200, type_)
        assert len(text.encode()) == int(headers["Content-Length"])
        policy = headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'")
        assert f"connect-src 'self' ws://127.0.0.1:{port};" in policy
        assert "frame-ancestors 'none'" in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"


def test_the_page_names_no_other_host(clean_page: Served) -> None:
    for path in ("/", "/live.css", "/live.js", "/icon.svg"):
        text = get(clean_page, path)[2].replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text
        assert "https://" not in text
        assert 'src="//' not in text


@pytest.mark.parametrize(
    "path",
    [
        *(
            "/../../etc/passwd",
            "/%2e%2e/%2e%2e/etc/passwd",
            "/..%2f..%2fetc/passwd",
            "//etc/passwd",
        ),
        *("/assets/live.js", "/live.js/../../server.py", "/live.js%00", "/LIVE.JS", "/favicon.ico"),
        "/\\..\\server.py",
    ],
)
def test_no_other_file_is_served(clean_page: Served, path: str) -> None:
    status, _, text = get(clean_page, path)
    assert status == 404
    assert text == "There is no such file here.\n"


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1", "127.0.0.1:1", "10.0.0.1:{port}", "", "[::1]:{port}", "a:b:c"],
)
def test_another_host_is_refused(clean_page: Served, host: str) -> None:
    status, _, text = get(clean_page, "/", Host=host.format(port=clean_page.address.port))
    assert status == 421
    assert "not known by that name" in text


def test_localhost_is_this_host(clean_page: Served) -> None:
    assert get(clean_page, "/", Host=f"LocalHost:{clean_page.address.port}")[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1", "null", ""]
)
def test_a_page_from_elsewhere_gets_no_frames(clean_page: Served, origin: str) -> None:
    port = clean_page.address.port
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(
            f"ws://127.0.0.1:{port}/frames",
            additional_headers={"Origin": origin.format(port=port)} if origin else {},
        ),
    ):
        pass
    assert refused.value.response.status_code == 403


def test_frames_come_to_a_page_of_ours(clean_page: Served) -> None:
    with open_socket(clean_page) as frames:
        frame = json.loads(frames.recv(LIMIT_S))
    assert (frame["n"], frame["repetitions"]["count"]) == (1, 8)
    assert frame["about"]["label"] == "REPLAY"


@pytest.mark.parametrize("token", ["", "wrong", "%00", "é"])
def test_without_the_token_nothing_is_shown(guarded: Served, token: str) -> None:
    status, headers, text = get(guarded, f"/?token={quote(token)}")
    assert status == 403
    assert "Set-Cookie" not in headers
    assert "<html" not in text
    for path in FILES:
        assert get(guarded, path)[0] == 403
    with pytest.raises(InvalidStatus) as refused, open_socket(guarded):
        pass
    assert refused.value.response.status_code == 403


def test_a_token_opens_one_session_that_lasts(guarded: Served) -> None:
    token = guarded.access.token
    status, headers, _ = get(guarded, f"/?token={token}")
    assert status == 200
    cookie, *flags = headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(flags)
    assert token not in cookie
    # The same address again, from another browser, and the token as a cookie.
    assert get(guarded, f"/?token={token}")[0] == 403
    assert get(guarded, "/", Cookie=f"{cookie.split('=')[0]}={token}")[0] == 403
    # The same browser, as often as it likes.
    for _ in range(3):
        assert get(guarded, "/", Cookie=cookie)[0] == 200
        with open_socket(guarded, cookie=cookie) as frames:
            assert json.loads(frames.recv(LIMIT_S))["repetitions"]["count"] == 8
    with (
        pytest.raises(InvalidStatus),
        open_socket(guarded, cookie=cookie, origin="http://evil.example"),
    ):
        pass


def test_sessions_are_limited() -> None:
    access = Access(open_to_all=False)
    seen = set()
    for _ in range(SESSIONS_MAX):
        assert len(access.token) >= 43
        seen.add(access.token)
        assert access.trade(access.token)
    assert len(seen) == SESSIONS_MAX
    assert access.token == ""
    assert access.trade("") is None
    assert access.trade(seen.pop()) is None


def test_an_oversize_message_closes(clean_page: Served) -> None:
    with open_socket(clean_page) as frames:
        frames.recv(LIMIT_S)
        frames.send("1" * (MESSAGE_MAX + 1))
        with pytest.raises(ConnectionClosed) as closed:
            frames.recv(LIMIT_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1009


@pytest.mark.parametrize("message", ["hello", "-1", "0", "999", "1.5", b"1", "²", ""])
def test_anything_but_a_receipt_closes(clean_page: Served, message: Any) -> None:
    with open_socket(clean_page) as frames:
        frames.recv(LIMIT_S)
        frames.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            frames.recv(LIMIT_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008


def test_a_slow_browser_gets_the_newest_state_and_no_queue(clean: Recording) -> None:
    """Twenty times the pace: in the second that it says nothing, twenty of the recording pass."""
    with Served(Replay(clean, 20.0)) as served, open_socket(served) as frames:
        got = [json.loads(frames.recv(LIMIT_S)) for _ in range(IN_FLIGHT_MAX)]
        with pytest.raises(TimeoutError):
            frames.recv(1.0)
        before_s = until(lambda: served.page._t_s, "time passes")
        assert before_s > got[-1]["t"] + 5.0
        frames.send(str(got[-1]["n"]))
        newest = json.loads(frames.recv(LIMIT_S))
        assert newest["n"] == IN_FLIGHT_MAX + 1
        assert newest["t"] >= before_s - 1e-3
        # Nothing between was lost: the line goes on where it ended.
        last = next(p for f in reversed(got) for p in reversed(f.get("velocity", [])))
        assert newest["velocity"][0][0] - last[0] < 0.1


def test_several_browsers_at_once_and_one_that_comes_late(clean: Recording) -> None:
    with Served(Replay(clean, 0.0)) as served, ExitStack() as stack:
        many = [stack.enter_context(open_socket(served)) for _ in range(4)]
        until(lambda: served.page.ended, "the end of the replay")
        for frames in many:
            count = 0
            while count != 8:
                frame = json.loads(frames.recv(LIMIT_S))
                count = frame.get("repetitions", {"count": count})["count"]
                frames.send(str(frame["n"]))
        with open_socket(served) as late:
            whole = json.loads(late.recv(LIMIT_S))
        assert whole["velocity"][-1][0] - whole["velocity"][0][0] == pytest.approx(30.0, abs=0.1)
        for frames in many:
            frames.close()
        assert until(lambda: served.server._clients == 0, "all gone") is True


def test_too_many_browsers_are_refused(clean_page: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "CLIENTS_MAX", 1)
    with open_socket(clean_page):
        until(lambda: clean_page.server._clients, "the first is in")
        with pytest.raises(InvalidStatus) as refused, open_socket(clean_page):
            pass
    assert refused.value.response.status_code == 503


def test_bytes_that_are_no_request_do_no_harm(clean_page: Served) -> None:
    for data in (
        b"\0\xff" * 500 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"POST / H\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", clean_page.address.port), LIMIT_S) as raw:
            raw.sendall(data)
            answer = raw.recv(4096)
        assert b"200 OK" not in answer
    assert get(clean_page, "/")[0] == 200


def test_a_port_that_is_taken_is_said_so(clean_page: Served) -> None:
    async def listen() -> None:
        server = Server(clean_page.page, clean_page.server._feed, clean_page.access)
        async with server.listening("127.0.0.1", clean_page.address.port):
            pass

    with pytest.raises(HilError, match=r"cannot listen on 127\.0\.0\.1") as taken:
        asyncio.run(listen())
    assert "--http-port 0" in str(taken.value)


def test_addresses() -> None:
    assert Address("::1", 80).url == "http://[::1]:80/"
    assert reachable("10.1.2.3") == "10.1.2.3"
    assert reachable("0.0.0.0") != "0.0.0.0"
    assert [is_loopback(a) for a in ("127.0.0.1", "127.9.9.9", "::1", "localhost")] == [True] * 4
    assert [is_loopback(a) for a in ("0.0.0.0", "::", "192.168.1.2", "rack.local", "")] == [
        False
    ] * 5


def test_a_name_that_was_given_is_a_host() -> None:
    access = Access(open_to_all=False, names=["Rack.local"])
    assert access.is_our_host("rack.local:8321", "192.168.1.2", 8321)
    assert access.is_our_host("192.168.1.2:8321", "192.168.1.2", 8321)
    assert access.is_our_host("[fe80::1]:8321", "fe80::1", 8321)
    assert not access.is_our_host("rack.local.evil.example:8321", "192.168.1.2", 8321)
    assert not access.is_our_host("localhost:8321", "192.168.1.2", 8321)
    assert not access.is_our_host("192.168.1.3:8321", "192.168.1.2", 8321)
