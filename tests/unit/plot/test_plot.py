# SPDX-License-Identifier: Apache-2.0
"""Figures: what is in them, by the numbers; their label; and that they are drawn at all."""

from __future__ import annotations

import io
import json
import re
from html import unescape
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from hil import synthesis
from hil.cli import app
from hil.exchange.foreign import Said
from hil.exchange.recorded import imported
from hil.exchange.table import Column, ExchangeError, Table
from hil.plot import page, picture, write
from hil.plot.figure import Figure, Panel, figure, quaternion_sigma, trace
from hil.recording import load
from hil.reference.attitude import exp, multiply
from hil.reps import of_recording, repetitions

FIXTURES = Path(__file__).parents[3] / "fixtures" / "recordings"
SVG = "{http://www.w3.org/2000/svg}"
T = np.arange(200) / 100.0


@pytest.fixture(scope="module")
def real():
    return load(FIXTURES / "cal-boot" / "recording.mcap")


@pytest.fixture(scope="module")
def whole(real) -> Figure:
    return figure(real)


def small(**changes) -> Figure:
    one = Panel("Height", "m", [trace("centre", T, np.sin(T), np.full(200, 0.1))])
    given = {
        "label": "SIMULATION",
        "name": "small",
        "note": "build ids: leader 00ab",
        "panels": [[one]],
        "still": [(0.5, 1.0)],
        "repetitions": [(1.2, 1.6)],
        "span_s": (0.0, 1.99),
    }
    return Figure(**(given | changes))


def test_all_sixteen_states_are_there_with_their_deviations(whole, real):
    states = [
        t
        for row in whole.panels
        for p in row
        if len(p.traces) == 1
        for t in p.traces
        if (t.sigma is not None)
    ]
    assert len(states) == 16
    sent = real.decoded("leader").messages["ekf_state"]
    quiet = states[3 + 2]
    assert np.array_equal(quiet.y, sent["velocity_mps"][:, 2].astype(float))
    assert quiet.sigma == pytest.approx(np.sqrt(sent["variance"][:, 5].astype(float)))
    assert len(whole.panels) == 3 + 4 + 5 + 1


def test_stillness_and_repetitions_are_those_of_the_frames(whole, real):
    sent = real.decoded("leader").messages["ekf_state"]
    t_s = sent["t_ticks_leader"] / 16e6
    inside = np.zeros(len(t_s), bool)
    for a, b in whole.still:
        inside |= (t_s >= a - 1e-9) & (t_s <= b + 1e-9)
    assert np.array_equal(inside, (sent["flags"] & 4) != 0)
    found = [r for one in of_recording(real) for r in repetitions(one).repetitions]
    assert [a for a, _ in whole.repetitions] == pytest.approx(
        [r.t_start_s for r in found], abs=6e-4
    )


def test_label_and_build_ids_are_in_every_kind_of_file(whole, real, tmp_path):
    build = real.provenance.manifests["leader"]["build_id"]
    for text in (picture.svg(whole), page.html(whole)):
        assert "SIMULATION" in text
        assert "REPLAY of cal-boot" in text
        assert build in text
    made = figure(synthesis.synthesise(synthesis.Plan(duration_s=4.0)), ["imu"])
    assert made.label == "SYNTHETIC"


def test_deviations_of_the_quaternion_are_those_of_drawn_turns():
    """Against thousands of turns drawn at random, composed by the reference's own quaternions."""
    rng = np.random.default_rng(2)
    q = np.array([0.5, -0.1, 0.7, 0.3])
    q /= np.linalg.norm(q)
    sigma = np.array([0.01, 0.002, 0.03])
    drawn = np.array([multiply(exp(rng.normal(0.0, sigma)), q) for _ in range(4000)])
    columns = [
        Column(f"quaternion_{a}", np.array([v]), "1", "") for a, v in zip("wxyz", q, strict=True)
    ]
    columns += [
        Column(f"variance_attitude_{a}_rad2", np.array([s * s]), "rad^2", "")
        for a, s in zip("xyz", sigma, strict=True)
    ]
    found = quaternion_sigma(Table("ekf", tuple(columns), np.zeros(1, np.int64)))
    assert np.concatenate(found) == pytest.approx(drawn.std(axis=0), rel=0.06)


def test_a_trace_is_broken_where_time_jumps_and_not_elsewhere():
    t = np.concatenate([T, T + 5.0, [np.nan]])
    one = trace("x", t, np.ones(401))
    assert np.count_nonzero(np.isnan(one.y)) == 1
    assert np.all(np.diff(one.t_s) >= 0)
    panel = Panel("x", "m", [one])
    (curve,) = re.findall(
        r'class="trace"[^>]* d="([^"]*)"', picture.svg(small(panels=[[panel]], span_s=(0.0, 7.0)))
    )
    assert curve.count("M") == 2


def test_svg_has_curve_band_and_spans_where_they_belong():
    root = ET.fromstring(picture.svg(small()))
    by_class = {e.get("class"): e for e in root.iter() if e.get("class")}
    box = by_class["frame"]
    left, width = float(box.get("x")), float(box.get("width"))
    still = [
        e
        for e in root.iter(f"{SVG}rect")
        if e.get("class") == "still" and (float(e.get("height")) > 20)
    ]
    assert float(still[0].get("x")) == pytest.approx(left + width * 0.5 / 1.99, abs=0.1)
    assert float(still[0].get("width")) == pytest.approx(width * 0.5 / 1.99, abs=0.2)
    points = re.findall(r"[ML]([\d.]+) ([\d.]+)", by_class["trace"].get("d"))
    assert len(points) == 200
    assert float(points[0][0]) == pytest.approx(left, abs=0.1)
    assert float(points[-1][0]) == pytest.approx(left + width, abs=0.1)
    # The sine's top lies above its start on the page.
    assert min(float(y) for _, y in points) == float(points[157][1]) < float(points[0][1])
    assert by_class["band"].get("d").endswith("Z")


def test_names_out_of_a_file_cannot_become_markup(real):
    evil = small(name="</svg><script>x</script>", note='"><img src=x>')
    ET.fromstring(picture.svg(evil))
    for text in (picture.svg(evil), page.html(evil)):
        assert "<script>x" not in text
        assert "<img" not in text


def test_png_is_the_svg_painted(tmp_path):
    write.write(small(), tmp_path / "x.png")
    image = Image.open(io.BytesIO((tmp_path / "x.png").read_bytes())).convert("RGB")
    assert image.width == 2400
    colours = {c for _, c in image.getcolors(1 << 20)}
    assert (0, 0x72, 0xB2) in colours, "the curve"
    assert (0x1B, 0x27, 0x33) in colours, "the label"


def test_the_page_has_the_numbers_and_lets_only_its_own_scripts_run():
    text = page.html(small())
    found = re.search(r'type="application/json" id="~chart-data">(.*?)</script>', text)
    assert found
    (chart,) = json.loads(found[1]).values()
    centre, high, low = chart["traces"]
    assert centre["y"]["v"] == pytest.approx(np.sin(T), abs=1e-6)
    assert np.array(high["y"]["v"]) - low["y"]["v"] == pytest.approx(np.full(200, 0.2), abs=1e-6)
    assert chart["bands"] == [{"series": [2, 3], "colour": 0}]
    assert {s["kind"] for s in chart["spans"]} == {"still", "repetition"}
    assert "default-src 'none'" in unescape(text)


def test_nothing_to_draw_and_wrong_names_are_said(tmp_path):
    np.savez(
        tmp_path / "short.npz",
        t_s=np.arange(10) / 100.0,
        gyro_radps=np.zeros((10, 3)),
        accel_mps2=np.full((10, 3), 5.66),
    )
    recording, _ = imported([tmp_path / "short.npz"], Said(), "short")
    with pytest.raises(ExchangeError, match=r"nothing to draw of state.*never ended its alignment"):
        figure(recording, ["state"])
    assert figure(recording, ["imu"]).label == "IMPORTED"
    (tmp_path / "short.npz").unlink()
    with pytest.raises(ExchangeError, match="does not say what to write"):
        write.write(small(), tmp_path / "figure.bmp")
    result = CliRunner().invoke(
        app, ["plot", str(FIXTURES / "cal-boot"), "-o", str(tmp_path / "x.svg"), "--what", "soup"]
    )
    assert result.exit_code == 2
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_a_figure(tmp_path):
    file = tmp_path / "deep" / "x.svg"
    result = CliRunner().invoke(
        app, ["plot", str(FIXTURES / "cal-boot"), "-o", str(file), "--what", "velocity, zupt"]
    )
    assert result.exit_code == 0, result.output
    assert "SIMULATION, REPLAY of cal-boot" in result.output
    assert ET.fromstring(file.read_text(encoding="utf-8")).tag == f"{SVG}svg"
