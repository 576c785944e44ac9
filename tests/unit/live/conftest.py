# SPDX-License-Identifier: Apache-2.0
"""A live page that is served while a test looks at it, and the browser that looks."""

from __future__ import annotations

import asyncio
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.live.access import Access
from hil.live.page import Page
from hil.live.server import Address, Server
from hil.live.sources import Feed, Replay, Source
from hil.recording import Recording, load

ROOT = Path(__file__).parents[3]
RECORDINGS = ROOT / "fixtures" / "recordings"
LIMIT_S = 60.0


def until(happens: Callable[[], Any], what: str, limit_s: float = LIMIT_S) -> Any:
    deadline_s = time.monotonic() + limit_s
    while not (found := happens()):
        if time.monotonic() > deadline_s:
            pytest.fail(f"never happened: {what}")
        time.sleep(0.02)
    return found


class Served:
    """A page on a port of its own, with its loop in a thread; a context manager."""

    def __init__(
        self, source: Source, access: Access | None = None, host: str = "127.0.0.1", port: int = 0
    ) -> None:
        self.page = Page(source.about)
        self.access = access or Access(open_to_all=True)
        self.address = Address(host, port)
        self._source = source
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True)

    @property
    def url(self) -> str:
        return self.address.url

    async def _run(self) -> None:
        self._loop, self._leaving = asyncio.get_running_loop(), asyncio.Event()
        feed = Feed(self._source, self.page)
        self.server = Server(self.page, feed, self.access)
        async with self.server.listening(self.address.host, self.address.port) as self.address:
            with feed:
                self._ready.set()
                await self._leaving.wait()

    def __enter__(self) -> Served:
        self._thread.start()
        assert self._ready.wait(LIMIT_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._leaving.set)
        self._thread.join(LIMIT_S)
        assert not self._thread.is_alive()


@pytest.fixture(scope="session")
def clean() -> Recording:
    return load(RECORDINGS / "clean-7ms5" / "recording.mcap")


@pytest.fixture(scope="session")
def clean_page(clean: Recording) -> Iterator[Served]:
    """The whole recording, replayed at once."""
    with Served(Replay(clean, 0.0)) as served:
        until(lambda: served.page.ended, "the end of the replay")
        yield served


@pytest.fixture
def serve() -> type[Served]:
    return Served


@pytest.fixture(scope="session")
def has_browser() -> None:
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        pytest.skip("no Chromium here: apt-get install -y chromium chromium-driver")
