# SPDX-License-Identifier: Apache-2.0
"""The live page in Chromium, and what is counted in it, apart from what the page itself counts."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

ARGUMENTS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    "--window-size=1280,900",
)
COUNT_DRAWINGS = """
window.drawings = new Map();
(function () {
  var real = CanvasRenderingContext2D.prototype.clearRect;
  CanvasRenderingContext2D.prototype.clearRect = function () {
    var of = window.drawings.get(this.canvas) || new Set();
    of.add(document.timeline.currentTime);
    window.drawings.set(this.canvas, of);
    return real.apply(this, arguments);
  };
})();
"""
"""Every chart clears its canvas to draw: counted once for each frame of the screen."""
DESKTOP = (1280, 800)
PHONE = (390, 844)


class Browser:
    """One page in Chromium."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": COUNT_DRAWINGS})

    def resize(self, size: tuple[int, int]) -> None:
        width, height = size
        values = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", values)

    def open(self, url: str, size: tuple[int, int] = DESKTOP) -> None:
        self.driver.get("about:blank")
        self.driver.get_log("browser")
        self.resize(size)
        self.driver.get(url)

    def js(self, script: str, *arguments: Any) -> Any:
        return self.driver.execute_script(script, *arguments)

    def text(self, id_: str) -> str:
        return str(self.driver.find_element(By.ID, id_).text)

    def until(self, condition: Callable[[], Any], what: str, limit_s: float = 20.0) -> Any:
        return WebDriverWait(self.driver, limit_s, poll_frequency=0.05).until(
            lambda _: condition(), f"never happened: {what}"
        )

    def updates_hz(self, seconds: float) -> float:
        """Screen frames a second in which the slowest of all charts was drawn anew."""
        self.js("window.drawings.clear()")
        begin_s = time.monotonic()
        time.sleep(seconds)
        counts = self.js("return Array.from(window.drawings.values(), of => of.size)")
        taken_s = time.monotonic() - begin_s
        return float(min(counts)) / taken_s if len(counts) == 3 else 0.0

    def check_updates(self, wanted_hz: float, seconds: float = 2.0, tries: int = 5) -> None:
        """Fail when charts are never drawn as often as wanted for so long."""
        seen_hz: list[float] = []
        for _ in range(tries):
            seen_hz.append(self.updates_hz(seconds))
            if seen_hz[-1] >= wanted_hz:
                return
        rates = ", ".join(f"{rate:.1f}" for rate in seen_hz)
        pytest.fail(f"updates/s: {rates}; wanted {wanted_hz:g}")

    def overflow(self) -> int:
        """By how many pixels the page can be scrolled sideways."""
        return int(self.js("return document.documentElement.scrollWidth - window.innerWidth"))

    def axe(self) -> list[str]:
        """What axe finds wrong."""
        self.js((files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8"))
        found = self.driver.execute_async_script(
            """axe.run({resultTypes: ['violations']})
                 .then(r => arguments[0](r.violations), e => arguments[0]([{id: String(e)}]))"""
        )
        return [f"{v['id']} ({v.get('impact')}): {v['nodes'][0]['html'][:160]}" for v in found]

    def errors(self) -> list[Any]:
        return list(self.driver.get_log("browser"))


@contextmanager
def chromium(profile: Path) -> Iterator[Browser]:
    """A Chromium of its own."""
    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for argument in (*ARGUMENTS, f"--user-data-dir={profile}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield Browser(driver)
    finally:
        driver.quit()
