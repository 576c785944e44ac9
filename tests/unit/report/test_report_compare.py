# SPDX-License-Identifier: Apache-2.0
"""Two reports side by side: what changed comes first, in the table and on the page."""

from __future__ import annotations

import io
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from hil.errors import HilError
from hil.measure import Limits, Measurement
from hil.report import NotRun, Result, build, compare, compare_page, write

Make = Callable[..., Any]
NAMES = ("before", "after")


def one(name: str, value: float | None, high: float = 150.0, unsure: float = 0.0) -> Measurement:
    return Measurement(name, value, "ns", Limits(high=high), "T1", "how", uncertainty=unsure)


BEFORE = [
    one("same.exact", 10.0),
    one("same.within", 100.0, unsure=3.0),
    one("moved.little", 100.0),
    one("moved.much", 10.0, unsure=3.0),
    one("limit", 10.0, high=150.0),
    one("gone", 10.0),
    one("mended", 200.0),
    one("broken", 100.0),
    one("vanished", 100.0),
]
AFTER = [
    one("same.exact", 10.0),
    one("same.within", 104.9, unsure=4.0),  # less than sqrt(3^2 + 4^2) = 5
    one("moved.little", 105.0),
    one("moved.much", 15.1, unsure=4.0),
    one("limit", 10.0, high=140.0),
    one("come", 10.0),
    one("mended", 100.0),
    one("broken", 200.0),
    one("vanished", None),
]


@pytest.fixture
def found(recording: Make) -> compare.Comparison:
    first = build([(recording(), BEFORE)], generated_utc="2026-11-21T08:30:00+00:00")
    second = build([(recording(duration_s=30.0), AFTER)], generated_utc="2026-11-22T08:30:00+00:00")
    return compare.compare(first, second, NAMES)


def test_what_changed_comes_first(found: compare.Comparison) -> None:
    (pair,) = found.pairs
    assert [(row.id, row.kind) for row in pair.rows] == [
        ("broken", "verdict"),
        ("vanished", "verdict"),
        ("mended", "verdict"),
        ("moved.much", "value"),
        ("moved.little", "value"),
        ("limit", "limits"),
        ("gone", "only"),
        ("come", "only"),
        ("same.exact", "same"),
        ("same.within", "same"),
    ]
    assert [row.id for _, row in found.worse] == ["broken"]
    assert found.headline == (
        "fail",
        "1 check got worse and does not pass; 2 other verdicts changed; "
        "2 values changed, verdict the same; 1 limit changed; 2 checks in one of the two only.",
    )


def test_a_change_has_its_uncertainty(found: compare.Comparison) -> None:
    changes = {row.id: row.change for row in found.pairs[0].rows}
    assert changes["moved.much"] == "+5.1 ± 5 ns"
    assert changes["mended"] == "−100 ns"
    assert changes["same.exact"] == changes["gone"] == changes["vanished"] == ""
    first, second = ({"uncertainty": u} for u in (3.0, 4.0))
    assert compare.combined_uncertainty(first, second) == 5.0


def test_what_ran_is_compared_to_the_last_key(found: compare.Comparison) -> None:
    facts = {fact.key: (fact.first, fact.second) for fact in found.pairs[0].facts}
    assert facts == {"scenario.duration_s": ("60", "30"), "contents.duration_s": ("60", "30")}


def test_images_tools_and_rig_that_differ_are_named(recording: Make) -> None:
    first = build([(recording(), BEFORE)])
    second = json.loads(json.dumps(first))
    second["recordings"][0]["provenance"]["images"]["leader"]["build_id"] = "0123456789abcdef"
    second["recordings"][0]["provenance"]["tools"]["bsim"] = "v2.6"
    second["rig"]["git"]["commit"] = "c" * 40
    compared = compare.compare(first, second, NAMES)
    keys = [fact.key for fact in compared.pairs[0].facts]
    assert keys == ["images.leader.build_id", "tools.bsim"]
    assert [fact.key for fact in compared.rig] == ["rig.git.commit"]
    assert compared.headline == ("pass", "9 checks compared, none changed.")


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [
        (one("a", 100.0), one("a", 200.0), True),
        (one("a", 100.0), one("a", 149.0, unsure=5.0), True),
        (one("a", 149.0, unsure=5.0), one("a", 200.0), True),
        (one("a", 200.0), one("a", 149.0, unsure=5.0), False),
        (one("a", 200.0), one("a", 300.0), False),
        (one("a", 200.0), one("a", 100.0), False),
        (one("a", 100.0), one("a", None), False),
        (None, one("a", 200.0), True),
        (None, one("a", 100.0), False),
        (one("a", 200.0), None, False),
        (one("a", 100.0), one("a", math.nan), True),
    ],
)
def test_worse_is_a_bad_verdict_that_is_graver(
    recording: Make, before: Measurement | None, after: Measurement | None, worse: bool
) -> None:
    first, second = (build([(recording(), [m] if m else [])]) for m in (before, after))
    assert bool(compare.compare(first, second, NAMES).worse) is worse


def test_runs_are_paired_by_name(recording: Make) -> None:
    first = build([(recording(name), BEFORE) for name in ("a", "b")])
    second = build([(recording(name), BEFORE) for name in ("b", "c")])
    compared = compare.compare(first, second, NAMES)
    assert [(p.name, p.first is not None, p.second is not None) for p in compared.pairs] == [
        ("a", True, False),
        ("b", True, True),
        ("c", False, True),
    ]
    alone = compare.compare(build([(recording("a"), [])]), build([(recording("b"), [])]), NAMES)
    assert [p.name for p in alone.pairs] == ["a → b"]
    assert alone.headline == ("unset", "There is no check to compare.")


def test_runs_that_never_ran_can_be_compared(recording: Make) -> None:
    idle = build([NotRun("a", "sim", "no workspace")])
    compared = compare.compare(idle, build([(recording("a"), BEFORE)]), NAMES)
    assert "1 check got worse" in compared.headline[1]  # "mended" fails where nothing failed before
    compare_page.render(compared)


@pytest.mark.parametrize("width", [60, 110, 200])
def test_the_table_says_it_without_colour(found: compare.Comparison, width: int) -> None:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    compare.render(found, console)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= width
    assert "same.exact" not in text
    assert "2 checks unchanged" in text
    if width == 200:
        (line,) = [one for one in text.splitlines() if "broken" in one]
        assert " ".join(line.split()) == "worse broken ✓ 100 ns ✗ 200 ns +100 ns ≤ 150 ns T1"
        assert text.index("broken") < text.index("moved.much") < text.index("limit ")


def hil(*args: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", "from hil.cli import main; main()", *map(str, args)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_the_command_compares_reports_and_recordings(recording: Make, tmp_path: Path) -> None:
    write(build([(recording(), BEFORE)]), tmp_path / "a")
    write(build([(recording(), AFTER)]), tmp_path / "b")
    out = ("-o", tmp_path / "out")
    done = hil("report", "--compare", tmp_path / "a", tmp_path / "b" / "report.json", *out)
    assert done.returncode == 1, done.stderr
    assert "1 check got worse" in done.stdout
    assert (tmp_path / "out" / "compare.html").is_file()
    equal = hil("report", "--compare", tmp_path / "a", tmp_path / "a", *out)
    assert equal.returncode == 0
    assert "9 checks compared, none changed" in equal.stdout
    recordings = Path(__file__).parents[3] / "fixtures" / "recordings"
    runs = hil("report", "--compare", recordings / "clean-7ms5", recordings / "faulty", *out)
    assert runs.returncode == 1, runs.stderr
    assert "sync.skew_error_ppb" in runs.stdout
    three = hil("report", "--compare", tmp_path / "a", tmp_path / "b", tmp_path / "b", *out)
    assert three.returncode == 2
    assert "--compare takes two" in three.stderr
    file = tmp_path / "file"
    file.write_text("in the way")
    blocked = hil("report", "--compare", tmp_path / "a", tmp_path / "b", "-o", file)
    assert blocked.returncode == 2
    assert "cannot be written" in blocked.stderr


def test_a_page_that_cannot_be_written_is_named(found: compare.Comparison, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(HilError, match="the comparison cannot be written"):
        compare_page.write(found, tmp_path / "file")


# ---- the page in a browser ---------------------------------------------------------------------

CHROMIUM, CHROMEDRIVER = shutil.which("chromium"), shutil.which("chromedriver")
in_browser = pytest.mark.skipif(
    CHROMIUM is None or CHROMEDRIVER is None,
    reason="no Chromium here: apt-get install -y chromium chromium-driver",
)


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for argument in ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"):
        options.add_argument(argument)
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('profile')}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chrome = webdriver.Chrome(options=options, service=Service(str(CHROMEDRIVER)))
    try:
        yield chrome
    finally:
        chrome.quit()


def show(driver: webdriver.Chrome, page: Path, *, width: int = 1280, dark: bool = False) -> None:
    driver.get("about:blank")
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
    driver.get(page.as_uri())


@pytest.fixture
def page(found: compare.Comparison, tmp_path: Path) -> Path:
    return compare_page.write(found, tmp_path)


@in_browser
def test_the_page_opens_from_a_file_and_is_red_at_first_glance(
    driver: webdriver.Chrome, page: Path
) -> None:
    show(driver, page)
    assert driver.get_log("browser") == []
    assert driver.execute_script("return performance.getEntriesByType('resource').length") == 0
    hero = driver.find_element(By.CSS_SELECTOR, ".hero")
    colour = hero.value_of_css_property("background-color")
    red, green, blue = (int(v) for v in colour.partition("(")[2].rstrip(")").split(",")[:3])
    assert red > 2 * max(green, blue)
    assert "1 check got worse" in hero.text
    first = driver.find_elements(By.CSS_SELECTOR, "tbody tr")[0]
    assert first.rect["y"] + first.rect["height"] < 900
    for part in ("broken", "100 ns", "200 ns", "+100 ns", "≤ 150 ns", "T1"):
        assert part in first.text


@in_browser
def test_what_is_unchanged_opens_by_keyboard(driver: webdriver.Chrome, page: Path) -> None:
    show(driver, page)
    (row,) = [
        r
        for r in driver.find_elements(By.CSS_SELECTOR, "tbody tr")
        if "same.exact" in (r.get_attribute("textContent") or "")
    ]
    assert not row.is_displayed()
    summary = driver.find_element(By.CSS_SELECTOR, "summary")
    for _ in range(10):
        driver.switch_to.active_element.send_keys(Keys.TAB)
        if driver.switch_to.active_element == summary:
            break
    driver.switch_to.active_element.send_keys(Keys.ENTER)
    assert row.is_displayed()


@in_browser
@pytest.mark.parametrize("width", [360, 768, 1280])
def test_no_sideways_scroll(driver: webdriver.Chrome, page: Path, width: int) -> None:
    show(driver, page, width=width)
    driver.execute_script("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert driver.execute_script("return document.documentElement.scrollWidth") <= width


@in_browser
def test_theme(driver: webdriver.Chrome, page: Path) -> None:
    def background() -> Any:
        return driver.execute_script("return getComputedStyle(document.body).backgroundColor")

    show(driver, page)
    light = background()
    show(driver, page, dark=True)
    assert background() != light
    button = driver.find_element(By.ID, "~theme")
    assert button.text == "Light theme"
    button.click()
    assert (background(), button.text) == (light, "Dark theme")
    driver.execute_script("localStorage.clear()")


@in_browser
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (390, False)])
def test_axe_finds_no_serious_fault(
    driver: webdriver.Chrome, page: Path, width: int, dark: bool
) -> None:
    show(driver, page, width=width, dark=dark)
    driver.execute_script("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    driver.execute_script((files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8"))
    faults = driver.execute_async_script(
        """axe.run({resultTypes: ['violations']})
             .then(r => arguments[0](r.violations), e => arguments[0]([{id: String(e)}]))"""
    )
    assert [f["id"] for f in faults if f.get("impact") not in ("minor", "moderate")] == []


@in_browser
def test_hostile_text_runs_nothing_and_fits(
    driver: webdriver.Chrome, hostile: Result, recording: Make, tmp_path: Path
) -> None:
    compared = compare.compare(
        build([(recording(), BEFORE)]), build([hostile]), ("<img src=x>", '"><script>')
    )
    page = compare_page.write(compared, tmp_path)
    for width in (360, 1280):
        show(driver, page, width=width)
        assert driver.execute_script("return window.hacked === undefined")
        assert driver.find_elements(By.TAG_NAME, "img") == []
        assert driver.execute_script("return document.documentElement.scrollWidth") <= width
        assert driver.get_log("browser") == []
