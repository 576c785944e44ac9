# SPDX-License-Identifier: Apache-2.0
"""The live page over real firmware on the simulated bench, while it runs."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from hil import scenario
from hil.build import Manifest, find_babblesim, find_workspace
from hil.live.sources import Simulation
from hil.motion.repetitions import truth
from hil.simulator.motion import lift
from tests.unit.live.browser import DESKTOP, PHONE, chromium
from tests.unit.live.conftest import Served, has_browser, until

__all__ = ["has_browser"]

ROOT = Path(__file__).parents[2]
DURATION_S = 15.5


@pytest.mark.alone
@pytest.mark.usefixtures("has_browser")
def test_the_page_follows_a_running_simulation(
    images: Mapping[str, Manifest], tmp_path: Path
) -> None:
    chosen = scenario.load(ROOT / "fixtures" / "scenarios" / "reconnect.toml")
    chosen = replace(chosen, duration_s=DURATION_S, link_drops=())
    source = Simulation(find_babblesim(find_workspace(None)), images, chosen, speed=1.0)
    with chromium(tmp_path / "profile") as browser, Served(source) as served:
        browser.open(served.url, DESKTOP)
        assert browser.text("label") in ("…", "SIMULATION")
        browser.until(lambda: browser.js("return window.drawings.size") == 3, "charts")
        browser.until(lambda: re.fullmatch(r"−?\d\.\d\d", browser.text("now")), "a velocity")
        assert browser.text("label") == "SIMULATION"
        for size in (DESKTOP, PHONE):
            browser.resize(size)
            browser.check_updates(20.0)
        shown = int(browser.text("count"))
        assert 0 <= shown <= 3
        until(lambda: served.page.ended, "the end of the scenario", limit_s=150.0)
        assert served.page.ended == "the scenario has come to its end"
        assert chosen.motion is not None
        start_s = chosen.motion.start_s
        ends_s = [one.t_end_s + start_s for one in truth(lift(chosen.motion).trajectory)]
        lifts = [end_s for end_s in ends_s if end_s < DURATION_S]
        assert len(lifts) == 3
        browser.until(lambda: int(browser.text("count")) == len(lifts), "every repetition")
        time.sleep(0.3)
        assert int(browser.text("count")) == len(lifts)
        assert browser.errors() == []
