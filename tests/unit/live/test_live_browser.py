# SPDX-License-Identifier: Apache-2.0
"""The live page in a real browser: how often it is drawn, what it shows, on which screens."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from hil.live.access import Access
from hil.live.sources import Replay
from hil.recording import Recording, load
from hil.reps import of_recording, repetitions
from tests.unit.live.browser import DESKTOP, PHONE, Browser, chromium
from tests.unit.live.conftest import RECORDINGS, Served, until

pytestmark = pytest.mark.usefixtures("has_browser")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with chromium(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def running(clean: Recording) -> Iterator[Served]:
    """The recording at its own pace."""
    with Served(Replay(clean, 1.0)) as served:
        yield served


@pytest.mark.alone
@pytest.mark.parametrize("size", [DESKTOP, PHONE])
def test_every_chart_is_drawn_twenty_times_a_second(
    browser: Browser, running: Served, size: tuple[int, int]
) -> None:
    browser.open(running.url, size)
    browser.until(lambda: browser.text("connection") == "Connected", "connected")
    assert browser.errors() == []
    browser.check_updates(20.0)
    assert browser.errors() == []


def test_a_chart_without_news_is_not_drawn(browser: Browser, clean_page: Served) -> None:
    """So that what is counted above is news."""
    browser.open(clean_page.url)
    browser.until(lambda: browser.text("count") == "8", "the count")
    assert browser.updates_hz(1.0) < 5.0


def test_it_shows_what_hil_reps_finds(
    browser: Browser, clean_page: Served, clean: Recording
) -> None:
    (trace,) = of_recording(clean)
    found = repetitions(trace)
    assert len(found.full) == 8
    last = found.full[-1].figures
    browser.open(clean_page.url)
    browser.until(lambda: browser.text("count") == "8", "the count")
    assert browser.text("label") == "REPLAY"
    assert browser.text("mean") == f"{last.mean_mps:.2f}"
    assert browser.text("peak") == f"{last.peak_mps:.2f}"
    assert browser.text("loss") == f"{found.velocity_loss_percent:.0f}"
    bars = browser.driver.find_elements(By.CSS_SELECTOR, "#bars .value")
    assert [bar.text for bar in bars] == [f"{r.figures.mean_mps:.2f}" for r in found.full]
    heights = browser.js(
        "return Array.from(document.querySelectorAll('#bars .bar'), b => b.clientHeight)"
    )
    most = max(r.figures.mean_mps for r in found.full)
    share = [h / max(heights) for h in heights]
    assert share == pytest.approx([r.figures.mean_mps / most for r in found.full], abs=0.02)


@pytest.mark.parametrize(("size", "least"), [(DESKTOP, 150), (PHONE, 130)])
def test_the_numbers_are_large_and_within_their_cards(
    browser: Browser, clean_page: Served, size: tuple[int, int], least: int
) -> None:
    browser.open(clean_page.url, size)
    browser.until(lambda: browser.text("count") == "8", "the count")
    for id_, text in (("mean", "0.54"), ("count", "88")):
        # Two digits are as wide as a count gets in earnest.
        browser.js("document.getElementById(arguments[0]).textContent = arguments[1]", id_, text)
        pixels, card, own = browser.js(
            """const e = document.getElementById(arguments[0]), r = document.createRange();
               r.selectNodeContents(e);
               return [parseFloat(getComputedStyle(e).fontSize),
                       e.closest('.card').clientWidth, r.getBoundingClientRect().width];""",
            id_,
        )
        assert pixels >= least
        assert own <= card


@pytest.mark.parametrize("size", [DESKTOP, PHONE, (360, 740), (820, 1180), (1920, 1080)])
def test_no_screen_scrolls_sideways(
    browser: Browser, clean_page: Served, size: tuple[int, int]
) -> None:
    browser.open(clean_page.url, size)
    browser.until(lambda: browser.text("count") == "8", "the count")
    assert browser.overflow() <= 0


@pytest.mark.parametrize("size", [DESKTOP, PHONE])
def test_axe_finds_nothing(browser: Browser, clean_page: Served, size: tuple[int, int]) -> None:
    browser.open(clean_page.url, size)
    browser.until(lambda: browser.text("count") == "8", "the count")
    assert browser.axe() == []
    assert browser.errors() == []


def test_the_sensor_is_chosen_with_the_keyboard(browser: Browser) -> None:
    """A recording that ends while the bar moves: at rest both sensors look alike."""
    moving = load(RECORDINGS / "imu-overrun" / "recording.mcap")
    with Served(Replay(moving, 0.0)) as served:
        until(lambda: served.page.ended, "the end of the replay")
        browser.open(served.url)
        choose(browser)


def choose(browser: Browser) -> None:
    browser.until(lambda: browser.text("count") == "6", "the count")
    chosen = "return document.querySelector('input[name=node]:checked').value"
    picture = "return document.querySelector('#gyro canvas').toDataURL()"
    assert browser.js(chosen) == "leader"
    before = browser.js(picture)
    browser.js("document.querySelector('input[name=node]').focus()")
    ActionChains(browser.driver).send_keys(Keys.ARROW_RIGHT).perform()
    assert browser.js(chosen) == "follower"
    browser.until(lambda: browser.js(picture) != before, "the other sensor's chart")


def test_a_page_that_lost_its_server_goes_on_with_the_next_one(
    browser: Browser, clean: Recording
) -> None:
    with Served(Replay(clean, 0.0)) as first:
        until(lambda: first.page.ended, "the end of the replay")
        browser.open(first.url)
        browser.until(lambda: browser.text("count") == "8", "the count")
        port = first.address.port
    browser.until(lambda: "cut off" in browser.text("connection"), "told of the loss")
    assert browser.text("count") == "8"
    with Served(Replay(clean, 0.0), port=port):
        browser.until(lambda: browser.text("connection") == "Ended", "connected again")
        assert browser.text("count") == "8"


def test_a_phone_with_the_token_stays_in_and_the_next_one_is_kept_out(
    browser: Browser, clean: Recording
) -> None:
    access = Access(open_to_all=False)
    token = access.token
    with Served(Replay(clean, 0.0), access) as served:
        until(lambda: served.page.ended, "the end of the replay")
        browser.open(f"{served.url}?token={token}", PHONE)
        browser.until(lambda: browser.text("count") == "8", "the count")
        assert browser.driver.current_url == served.url
        assert browser.errors() == []
        browser.driver.refresh()
        browser.until(lambda: browser.text("count") == "8", "the count after a reload")
        browser.driver.delete_all_cookies()
        browser.driver.get(f"{served.url}?token={token}")
        assert "An address opens the page once" in browser.js("return document.body.textContent")
