# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: headless Chromium, from the file, with no network."""

from __future__ import annotations

import base64
import shutil
import time
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from hil.measure import Measurement
from hil.recording import Recording
from hil.report import NotRun, Result, build, write
from hil.series import Series

CHROMIUM = shutil.which("chromium")
CHROMEDRIVER = shutil.which("chromedriver")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None or CHROMEDRIVER is None,
    reason="no Chromium here: apt-get install -y chromium chromium-driver",
)

ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1280,900",
)

FAULTY = "faulty-skew-sign"


class Browser:
    """One page in Chromium, with the few things that a reader does."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def open(
        self, path: Path, fragment: str = "", *, width: int = 1280, dark: bool = False
    ) -> None:
        self.driver.get("about:blank")
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        motion = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme, motion]})
        self.driver.get(path.as_uri() + (f"#{fragment}" if fragment else ""))

    def js(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        return WebDriverWait(self.driver, 20, poll_frequency=0.05).until(
            lambda _: condition(), f"never happened: {what}"
        )

    def draw_all(self) -> None:
        """Read the page from top to bottom, so that every chart is drawn."""
        step = 500
        for y in range(0, int(self.js("return document.documentElement.scrollHeight")), step):
            self.js("window.scrollTo(0, arguments[0])", y)
            time.sleep(0.02)
        waiting = "figure:has([data-chart]):not([data-drawn])"
        self.until(
            lambda: self.js("return !document.querySelector(arguments[0])", waiting),
            "all charts drawn",
        )

    def chart(self, title: str, run: int = 0) -> WebElement:
        """The figure with ``title`` in the run numbered ``run``, in view and drawn."""
        article = self.driver.find_elements(By.CSS_SELECTOR, "article.run")[run]
        figure = article.find_element(By.XPATH, f".//figure[.//h5[text()='{title}']]")
        self.js("arguments[0].scrollIntoView({block: 'center'})", figure)
        self.until(lambda: figure.get_attribute("data-drawn"), f"chart {title} drawn")
        return figure

    @staticmethod
    def span(figure: WebElement) -> tuple[float, float]:
        low, high = (figure.get_attribute(f"data-x-{end}") for end in ("min", "max"))
        return float(low or "nan"), float(high or "nan")

    def zoom_by_drag(self, figure: WebElement) -> None:
        """Drag over the middle half of a chart."""
        over = figure.find_element(By.CSS_SELECTOR, ".u-over")
        quarter = over.size["width"] // 4
        ActionChains(self.driver).move_to_element_with_offset(
            over, -quarter, 0
        ).click_and_hold().move_by_offset(quarter, 0).move_by_offset(quarter, 0).release().perform()

    def log(self) -> list[Any]:
        return list(self.driver.get_log("browser"))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for argument in ARGUMENTS:
        options.add_argument(argument)
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('profile')}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(CHROMEDRIVER)))
    try:
        yield Browser(driver)
    finally:
        driver.quit()


@pytest.fixture(scope="module")
def page(four_runs: list[Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write(build([*four_runs, NotRun("idle", "sim", "no workspace")]), folder)
    return folder / "index.html"


@pytest.fixture(scope="module")
def short_page(four_runs: list[Result], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of everything: verdicts of each kind, charts of each kind, a run that was not run."""
    bad = four_runs[-1]
    checks = [bad.measurements[n] for n in (0, 2, 4, -1)]
    plots = [s for s in bad.series if s.name.split(".")[1].startswith(("error", "allan", "skew"))]
    folder = tmp_path_factory.mktemp("short")
    results = [Result(bad.recording, checks, plots), NotRun("idle", "sim", "no workspace")]
    write(build(results), folder)
    return folder / "index.html"


@pytest.fixture(scope="module")
def hostile_page(hostile: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    write(build([hostile]), folder)
    return folder / "index.html"


def test_it_opens_from_a_file_loads_nothing_and_draws_every_chart(
    browser: Browser, page: Path
) -> None:
    browser.open(page)
    browser.draw_all()
    assert browser.log() == []
    assert browser.js("return performance.getEntriesByType('resource').length") == 0
    inked = browser.js(
        """return Array.from(document.querySelectorAll('figure canvas'), c => {
             const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
             let n = 0;
             for (let i = 3; i < d.length; i += 4) n += d[i] > 200;
             return n;
           })"""
    )
    holders = browser.js("return document.querySelectorAll('[data-chart]').length")
    # Of eight figures a run, the histogram and the Allan deviation are stills, and the trace of
    # the skew shares its chart.
    assert len(inked) == holders == 4 * 6
    assert min(inked) > 300
    stills = browser.js(
        """return Array.from(document.querySelectorAll('figure svg.still'), s => {
             const box = s.querySelector('.trace').getBoundingClientRect();
             return Math.min(box.width, box.height);
           })"""
    )
    assert len(stills) == 4 * 2
    assert min(stills) > 50


def test_a_failing_run_is_red_at_first_glance(browser: Browser, page: Path) -> None:
    browser.open(page)
    title = browser.driver.find_element(By.CSS_SELECTOR, ".failures h2")
    red, green, blue = browser.js(
        "return getComputedStyle(arguments[0]).backgroundColor.match(/[0-9]+/g).map(Number)", title
    )[:3]
    assert red > 2 * max(green, blue)
    table = browser.driver.find_element(By.CSS_SELECTOR, ".failures")
    assert table.rect["y"] + table.rect["height"] < 900
    for part in (FAULTY, "sync.error_p99_ns", "41\u202f234 ± 2.1 ns", "≤ 150 ns", "T1"):
        assert part in table.text


def test_a_deep_link_shows_its_check(browser: Browser, page: Path) -> None:
    browser.open(page, f"{FAULTY}/sync.one_way_bias_ns")
    row = browser.driver.find_element(By.ID, f"{FAULTY}/sync.one_way_bias_ns")

    def top() -> float:
        return float(browser.js("return arguments[0].getBoundingClientRect().top", row))

    browser.until(lambda: 0 < top() < 850, "the check in view")
    assert browser.js("return document.activeElement === arguments[0]", row)
    plain = row.find_element(By.XPATH, "following-sibling::tr").find_element(By.TAG_NAME, "td")
    marked = row.find_element(By.TAG_NAME, "td")
    assert marked.value_of_css_property("background-color") != plain.value_of_css_property(
        "background-color"
    )
    # A check in a group that starts closed.
    folded = browser.driver.find_element(By.ID, "clean-7ms5/link.frames_lost")
    assert not folded.is_displayed()
    browser.js("location.hash = arguments[0]", "clean-7ms5/link.frames_lost")
    browser.until(folded.is_displayed, "the group opened")
    assert browser.js("return document.activeElement === arguments[0]", folded)


def test_zoom_by_drag_moves_the_timelines_of_that_run_and_double_click_ends_it(
    browser: Browser, page: Path
) -> None:
    browser.open(page)
    browser.draw_all()
    second = browser.chart("Offset over time, line taken out")
    other_run = browser.chart("Sync error at the pulses", run=1)
    first = browser.chart("Sync error at the pulses")
    whole, other_whole = browser.span(first), browser.span(other_run)
    browser.zoom_by_drag(first)
    browser.until(lambda: browser.span(first) != whole, "zoom")
    low, high = browser.span(first)
    assert high - low == pytest.approx((whole[1] - whole[0]) / 2, rel=0.05)
    browser.until(
        lambda: browser.span(second) == pytest.approx((low, high), rel=1e-6), "the others follow"
    )
    assert browser.span(other_run) == other_whole
    ActionChains(browser.driver).double_click(
        first.find_element(By.CSS_SELECTOR, ".u-over")
    ).perform()
    browser.until(lambda: browser.span(first) == pytest.approx(whole), "the whole run again")
    assert browser.log() == []


def test_zoom_by_keyboard(browser: Browser, page: Path) -> None:
    browser.open(page)
    other = browser.chart("Offset over time, line taken out")
    figure = browser.chart("Residuals of the pairs")
    plot = figure.find_element(By.CSS_SELECTOR, ".plot")
    low, high = browser.span(figure)
    browser.js("arguments[0].focus()", plot)
    plot.send_keys("+")
    browser.until(lambda: browser.span(figure) != (low, high), "zoom in")
    zoomed = browser.span(figure)
    assert zoomed[1] - zoomed[0] == pytest.approx((high - low) / 2)
    browser.until(lambda: browser.span(other) == zoomed, "the others follow")
    plot.send_keys(Keys.ARROW_LEFT)
    browser.until(lambda: browser.span(figure)[0] < zoomed[0], "move")
    plot.send_keys(Keys.SHIFT, Keys.ARROW_RIGHT)
    live = browser.driver.find_element(By.ID, "~live")
    browser.until(lambda: " ns" in (live.get_attribute("textContent") or ""), "a value read out")
    plot.send_keys("0")
    browser.until(lambda: browser.span(figure) == pytest.approx((low, high)), "whole run")


def test_zoom_by_button(browser: Browser, page: Path) -> None:
    browser.open(page, width=390)
    figure = browser.chart("Residuals of the pairs")
    whole = browser.span(figure)
    figure.find_element(By.CSS_SELECTOR, "[data-do=in]").click()
    browser.until(lambda: browser.span(figure) != whole, "zoom in")
    figure.find_element(By.CSS_SELECTOR, "[data-do=reset]").click()
    browser.until(lambda: browser.span(figure) == pytest.approx(whole), "whole run")


def test_zoom_by_two_fingers_and_move_by_one(browser: Browser, page: Path) -> None:
    browser.open(page, width=390)
    figure = browser.chart("Residuals of the pairs")
    whole = browser.span(figure)
    over = figure.find_element(By.CSS_SELECTOR, ".u-over")
    left, top, width, height = browser.js(
        "const b = arguments[0].getBoundingClientRect(); return [b.left, b.top, b.width, b.height]",
        over,
    )

    def touch(kind: str, *shares: float) -> None:
        points = [{"x": left + width * s, "y": top + height / 2} for s in shares]
        browser.driver.execute_cdp_cmd(
            "Input.dispatchTouchEvent", {"type": kind, "touchPoints": points}
        )

    touch("touchStart", 0.4, 0.6)
    touch("touchMove", 0.3, 0.7)
    touch("touchMove", 0.2, 0.8)
    touch("touchEnd")
    browser.until(lambda: browser.span(figure) != whole, "zoom in")
    low, high = browser.span(figure)
    assert high - low == pytest.approx((whole[1] - whole[0]) / 3, rel=0.1)
    assert (low + high) / 2 == pytest.approx((whole[0] + whole[1]) / 2, rel=0.1)
    touch("touchStart", 0.3)
    touch("touchMove", 0.5)
    touch("touchMove", 0.7)
    touch("touchEnd")
    browser.until(lambda: browser.span(figure)[0] < low, "move to earlier times")


@pytest.mark.parametrize("name", ["page", "hostile_page"])
@pytest.mark.parametrize("width", [360, 390, 768, 1280])
def test_no_sideways_scroll(
    browser: Browser, request: pytest.FixtureRequest, name: str, width: int
) -> None:
    browser.open(request.getfixturevalue(name), width=width)
    browser.draw_all()
    browser.js("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert browser.js("return document.documentElement.scrollWidth") <= width


def test_hostile_text_runs_nothing(browser: Browser, hostile_page: Path) -> None:
    browser.open(hostile_page)
    browser.draw_all()
    browser.js("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert browser.js("return window.hacked === undefined")
    assert browser.js("return document.querySelectorAll('img, script:not(head *)').length") == 2
    assert browser.log() == []


def test_the_policy_stops_what_escaping_would_miss(browser: Browser, page: Path) -> None:
    browser.open(page)
    browser.js(
        """const s = document.createElement('script'); s.textContent = 'window.hacked = 1';
           document.body.append(s);
           const i = document.createElement('img'); i.src = 'https://example.invalid/x.png';
           document.body.append(i);"""
    )
    assert browser.js("return window.hacked === undefined")
    refused = [entry["message"] for entry in browser.log()]
    assert any("Content Security Policy" in message for message in refused)


def test_theme_follows_the_system_until_the_reader_chooses(browser: Browser, page: Path) -> None:
    def background() -> str:
        return str(browser.js("return getComputedStyle(document.body).backgroundColor"))

    browser.open(page)
    light = background()
    browser.open(page, dark=True)
    dark = background()
    assert light != dark
    button = browser.driver.find_element(By.ID, "~theme")
    assert button.text == "Light theme"
    button.click()
    assert (background(), button.text) == (light, "Dark theme")
    browser.open(page, dark=True)
    assert background() == light
    browser.js("localStorage.clear()")


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (390, False)])
def test_axe_finds_no_serious_fault(browser: Browser, page: Path, width: int, dark: bool) -> None:
    browser.open(page, width=width, dark=dark)
    browser.draw_all()
    browser.js("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    browser.js((files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8"))
    found = browser.driver.execute_async_script(
        """axe.run({resultTypes: ['violations']})
             .then(r => arguments[0](r.violations), e => arguments[0]([{id: String(e)}]))"""
    )
    faults = [
        f"{v['id']} ({v.get('impact')}): {v['nodes'][0]['html'][:160]}"
        for v in found
        if v.get("impact") not in ("minor", "moderate")
    ]
    assert faults == []


def test_it_prints_with_every_chart_and_the_theme_returns(
    browser: Browser, short_page: Path
) -> None:
    browser.open(short_page, dark=True)
    before = browser.js("return getComputedStyle(document.body).backgroundColor")
    pdf = base64.b64decode(browser.driver.execute_cdp_cmd("Page.printToPDF", {})["data"])
    assert pdf.startswith(b"%PDF")
    assert len(pdf) > 100_000
    drawn, holders = browser.js(
        "return [document.querySelectorAll('figure[data-drawn]').length,"
        " document.querySelectorAll('[data-chart]').length]"
    )
    assert drawn == holders
    browser.until(
        lambda: browser.js("return getComputedStyle(document.body).backgroundColor") == before,
        "the dark theme again",
    )


def test_print_shows_every_check_and_what_was_folded_is_folded_again(
    browser: Browser, page: Path
) -> None:
    browser.open(page)
    rows = "return Array.from(document.querySelectorAll('tr[id], tr[id] code, .budget p'))"
    hidden = rows + ".filter(e => !e.checkVisibility()).length"
    folded = "return document.querySelectorAll('details:not([open])').length"
    before = browser.js(folded)
    assert browser.js(hidden) > 0
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        browser.js("window.dispatchEvent(new Event('beforeprint'))")
        # The checks beside the first of a budget line have rows of their own.
        others = "return document.querySelectorAll('.others code').length"
        assert browser.js(hidden) == browser.js(others)
        assert browser.js("return document.querySelectorAll('[data-chart]:empty').length") == 0
        browser.js("window.dispatchEvent(new Event('afterprint'))")
        assert browser.js(folded) == before
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_a_million_points_zoom_as_smoothly_as_six_thousand(
    browser: Browser, recording: Callable[..., Recording], tmp_path: Path
) -> None:
    """A ratio of times on the same machine; the one spike in a million is still drawn."""
    spent = {}
    for n in (6_000, 1_000_000):
        t = np.linspace(0.0, 3600.0, n)
        y = np.random.default_rng(1).normal(size=n)
        y[n // 3] = 50.0
        folder = tmp_path / str(n)
        write(build([Result(recording(), [], [Series("s", "Noise", "s", "ns", t, y)])]), folder)
        assert (folder / "index.html").stat().st_size < 1_000_000
        browser.open(folder / "index.html")
        figure = browser.chart("Noise")
        browser.js("arguments[0].querySelector('.plot').focus()", figure)
        largest = browser.js(
            """const c = JSON.parse(document.getElementById('~chart-data').textContent);
               const y = Object.values(c)[0].traces[0].y;
               return y.o + Math.max(...y.k) * y.s"""
        )
        assert largest == pytest.approx(50.0, abs=0.01)
        spent[n] = browser.driver.execute_async_script(
            """const plot = arguments[0].querySelector('.plot'), done = arguments[1];
               const key = k => plot.dispatchEvent(new KeyboardEvent('keydown', {key: k}));
               const start = performance.now();
               let step = 0;
               requestAnimationFrame(function next() {
                 key(step % 10 < 5 ? '+' : '-');
                 if (++step < 20) requestAnimationFrame(next);
                 else requestAnimationFrame(() => done(performance.now() - start));
               });""",
            figure,
        )
    assert spent[1_000_000] < 3.0 * spent[6_000]


def test_a_check_and_its_budget_line_lead_to_each_other(browser: Browser, page: Path) -> None:
    browser.open(page, f"{FAULTY}/sync.error_p99_ns")
    row = browser.driver.find_element(By.ID, f"{FAULTY}/sync.error_p99_ns")
    line = browser.driver.find_element(By.ID, f"{FAULTY}/budget/T1")
    focus = "return document.activeElement === arguments[0]"
    browser.js("arguments[0].click()", row.find_element(By.LINK_TEXT, "T1"))
    browser.until(lambda: browser.js(focus, line), "the line")
    for part in ("41\u202f234", "≤ 150 ns", "over", "Fail"):
        assert part in line.text
    back = line.find_element(By.CSS_SELECTOR, "td a[href*='sync.error']")
    browser.js("arguments[0].click()", back)
    browser.until(lambda: browser.js(focus, row), "the check")


def test_without_scripts_everything_but_the_charts_is_there(browser: Browser, page: Path) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.open(page)
        text = browser.driver.find_element(By.TAG_NAME, "body").text
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert "Timelines need JavaScript" in text
    assert "41\u202f234 ± 2.1 ns" in text


def test_an_hour_opens_quickly_and_stays_small(
    browser: Browser,
    recording: Callable[..., Recording],
    measurements: Callable[..., list[Measurement]],
    series: Callable[..., list[Series]],
    tmp_path: Path,
) -> None:
    run = Result(recording(duration_s=3600.0), measurements(), series(duration_s=3600.0))
    write(build([run]), tmp_path)
    path = tmp_path / "index.html"
    assert path.stat().st_size < 5_000_000
    started = time.monotonic()
    browser.open(path)
    browser.draw_all()
    assert time.monotonic() - started < 20
    figure = browser.chart("Offset over time, line taken out")
    for _ in range(6):
        figure.find_element(By.CSS_SELECTOR, ".plot").send_keys("+")
    low, high = browser.span(figure)
    browser.until(lambda: browser.span(figure)[1] - browser.span(figure)[0] < 60, "zoom in")
    assert high > low
    assert browser.log() == []
