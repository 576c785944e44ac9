# SPDX-License-Identifier: Apache-2.0
"""The reducer: records with known numbers in, what the browser is told out."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from hil.live import words
from hil.live.page import About, Page, Seen
from hil.live.trail import POINTS_MAX, Trail
from hil.recording import Recording
from hil.wire.codec import decode, encode
from hil.wire.live import LiveStream
from hil.wire.messages import BY_NAME, FAULT_CODES

ABOUT = About("bench", "LIVE", "two boards", "As they speak.")
TICKS = 16_000_000
SILENT_S = 4.0


class Feeder:
    """A page, and frames of a node by their fields; what is left out is 0."""

    def __init__(self, about: About = ABOUT) -> None:
        self.page = Page(about)
        self.now_s = 100.0
        for role in about.roles:
            self.page.port(role, "open")

    def say(self, role: str, name: str, **values: Any) -> None:
        zeros = {f.name: [0] * f.count if f.count > 1 else 0 for f in BY_NAME[name].fields}
        self.page.take(role, decode(encode(name, {**zeros, **values}, 0)), self.now_s)

    def ekf(self, t_s: float, v: float, flags: int = 1) -> None:
        self.say(
            "leader",
            "ekf_state",
            t_ticks_leader=round(t_s * TICKS),
            quaternion=[1, 0, 0, 0],
            centre_velocity_mps=[0, 0, v],
            flags=flags,
        )

    def batch(self, source: int, ticks: int, samples: list[tuple[int, int]]) -> None:
        """Samples with so much on the accelerometer's x and the gyroscope's z; 4 g, 1000 dps."""
        self.say(
            "leader",
            "imu_batch",
            source=source,
            accel_fs_g=4,
            gyro_fs_dps=1000,
            t_first_ticks_node=ticks,
            period_ticks=80_000 * 256,
            samples=[{"accel_lsb": [a, 0, 0], "gyro_lsb": [0, 0, g]} for a, g in samples],
            count=len(samples),
        )

    def frame(self, seen: Seen | None = None) -> dict[str, Any]:
        self.page.refresh(self.now_s)
        frame, _ = self.page.since(seen or Seen())
        json.dumps(frame, allow_nan=False)
        return frame

    def row(self, id_: str) -> dict[str, Any]:
        return next(row for row in self.frame()["health"]["rows"] if row["id"] == id_)


@pytest.fixture
def feeder() -> Feeder:
    return Feeder()


def test_velocity_is_the_vertical_one_of_the_bars_centre(feeder: Feeder) -> None:
    for k, v in enumerate((0.0, 0.1234567, -0.5)):
        feeder.ekf(10.0 + 0.01 * k, v)
    frame = feeder.frame()
    assert frame["velocity"] == [[10.0, 0.0], [10.01, 0.123], [10.02, -0.5]]
    assert (frame["t"], frame["v"]) == (10.02, -0.5)


def test_a_browser_is_told_only_what_is_new(feeder: Feeder) -> None:
    feeder.ekf(1.0, 0.1)
    feeder.page.refresh(feeder.now_s)
    frame, seen = feeder.page.since(Seen())
    assert set(frame) == {"t", "v", "about", "velocity", "repetitions", "health"}
    assert feeder.page.since(seen)[1] == seen
    feeder.ekf(1.01, 0.2)
    feeder.page.refresh(feeder.now_s)
    frame, later = feeder.page.since(seen)
    assert frame == {"t": 1.01, "v": 0.2, "velocity": [[1.01, 0.2]]}
    assert later != seen


def test_imu_samples_are_averaged_over_20_ms(feeder: Feeder) -> None:
    """4 g: 1000 counts are 1000 * 4 * 0.0305 mg = 0.122 g = 1.1964 m/s^2; 1000 dps: 35 dps.

    5 ms from sample to sample, from 1.000 s on: four to a bin, and the fifth opens the next one.
    """
    feeder.batch(0, TICKS, [(1000, 1000), (1000, 1000), (3000, 0), (3000, 0), (500, 0)])
    points = feeder.frame()["imu"]["leader"]
    assert points == [[1.01, 2.39, 0.0, 0.0, 0.0, 0.0, 17.5]]


def test_the_followers_samples_are_put_on_the_leaders_clock(feeder: Feeder) -> None:
    """Its clock is 2 s ahead at 10 s and gains 10 ppm: 20 s of it are 18 s - 80 us."""
    feeder.ekf(18.0, 0.0)
    feeder.say(
        "leader",
        "sync_state",
        t_ref_ticks_leader=10 * TICKS,
        offset_ticks=2 * TICKS * 256,
        skew=10_000_000,
        state=2,
    )
    feeder.batch(1, 20 * TICKS + 1600, [(0, 0)] * 5)
    ((t_s, *_),) = feeder.frame()["imu"]["follower"]
    assert t_s == pytest.approx(18.01, abs=1e-6)


def test_the_followers_samples_wait_for_the_clocks(feeder: Feeder) -> None:
    feeder.batch(1, TICKS, [(0, 0)] * 16)
    assert "imu" not in feeder.frame()


def test_a_leader_that_began_anew_begins_a_new_page(feeder: Feeder) -> None:
    feeder.ekf(100.0, 0.1)
    feeder.page.refresh(feeder.now_s)
    _, seen = feeder.page.since(Seen())
    feeder.ekf(1.0, 0.3)
    frame = feeder.frame(seen)
    assert frame["velocity"] == [[1.0, 0.3]]
    assert "about" in frame


def test_a_pause_leaves_a_hole_in_the_line(feeder: Feeder) -> None:
    feeder.ekf(1.0, 0.1)
    feeder.ekf(2.0, 0.2)
    assert feeder.frame()["velocity"] == [[1.0, 0.1], [2.0, None], [2.0, 0.2]]


def test_what_is_no_number_leaves_a_hole_too(feeder: Feeder) -> None:
    feeder.ekf(1.0, float("nan"))
    feeder.ekf(1.01, float("inf"))
    frame = feeder.frame()
    assert frame["velocity"] == [[1.0, None], [1.01, None]]
    assert frame["v"] is None


def test_the_ring_holds_thirty_seconds() -> None:
    trail = Trail(1, 3)
    for k in range(6000):
        trail.add(k / 100, [0.0])
    points = trail.since(0)
    assert points[0][0] == pytest.approx(59.99 - 30.0, abs=0.011)
    assert (trail.total, points[-1][0]) == (6000, 59.99)
    for k in range(20_000):
        trail.add(60.0 + k / 10_000, [0.0])
    assert len(trail.since(0)) == POINTS_MAX


def test_the_sync_line_has_sigma_state_and_age(feeder: Feeder) -> None:
    """400 ticks/256 are 97.7 ns; the reference is 20 ms before the newest estimate."""
    common = {"t_ref_ticks_leader": 10 * TICKS, "offset_sigma_ticks": 400}
    feeder.say("leader", "sync_state", **common, state=2)
    feeder.ekf(10.02, 0.0)
    row = feeder.row("sync")
    assert (row["value"], row["level"], row["words"]) == (
        "±98 ns",
        "ok",
        "locked: the clocks agree",
    )
    assert feeder.row("offset")["value"] == "20 ms"
    feeder.ekf(12.0, 0.0)
    assert feeder.row("offset")["level"] == "warn"
    feeder.say("leader", "sync_state", **{**common, "offset_sigma_ticks": 700}, state=2)
    assert feeder.row("sync")["words"] == "locked: over the 150 ns allowed"
    feeder.say("leader", "sync_state", **common, state=0)
    assert feeder.row("sync")["level"] == "bad"


def test_the_radio_line_has_signal_and_losses(feeder: Feeder) -> None:
    up = {"connected": 1, "phy": 2, "conn_interval_us": 7500}
    feeder.say("leader", "link_stats", t_ticks_node=TICKS, **up, rssi_dbm=-59, batches_lost=3)
    assert feeder.row("radio")["value"] == "−59 dBm"
    assert feeder.row("radio")["words"] == "2M, every 7.5 ms"
    assert feeder.row("lost") == {
        **{"id": "lost", "title": "Lost on air", "value": "3", "words": "none for 10 s"},
        **{"level": "ok", "state": "All well"},
    }
    feeder.say("leader", "link_stats", t_ticks_node=2 * TICKS, **up, rssi_dbm=-90, batches_lost=5)
    assert feeder.row("radio")["level"] == "warn"
    assert (feeder.row("lost")["value"], feeder.row("lost")["level"]) == ("5", "warn")
    assert feeder.row("lost")["words"] == "2 in the last 10 s"
    feeder.say("leader", "link_stats", t_ticks_node=13 * TICKS, **up, rssi_dbm=127, batches_lost=5)
    assert (feeder.row("radio")["value"], feeder.row("lost")["level"]) == ("Connected", "ok")
    feeder.say("leader", "link_stats", t_ticks_node=14 * TICKS, connected=0, batches_lost=5)
    assert (feeder.row("radio")["value"], feeder.row("radio")["level"]) == ("Down", "bad")


def test_an_overrun_is_a_fault_now_and_a_warning_later(feeder: Feeder) -> None:
    for t_s, overruns, level in ((1, 0, "ok"), (2, 1, "bad"), (11, 1, "bad"), (13, 1, "warn")):
        feeder.say("follower", "fifo_stats", t_ticks_node=t_s * TICKS, overruns=overruns)
        feeder.say("leader", "fifo_stats", t_ticks_node=t_s * TICKS)
        assert feeder.row("fifo")["level"] == level, t_s
    assert feeder.row("fifo")["value"] == "0 / 1"
    assert feeder.row("fifo")["words"].startswith("follower: ")


def test_processor_load_is_held_against_the_budget(feeder: Feeder) -> None:
    for role in ("leader", "follower"):
        feeder.say(role, "system", cpu_load_permille=123)
    assert (feeder.row("cpu")["value"], feeder.row("cpu")["level"]) == ("12%", "ok")
    feeder.say("leader", "system", cpu_load_permille=620)
    assert feeder.row("cpu")["value"] == "62% / 12%"
    assert feeder.row("cpu")["words"] == "leader: over the 50% allowed"


def test_faults_are_in_plain_words_newest_first(feeder: Feeder) -> None:
    feeder.say("leader", "system", t_ticks_node=20 * TICKS)
    for second, code in enumerate(FAULT_CODES.values()):
        detail = list(b"INT1 <b>".ljust(48, b"\0"))
        feeder.say("leader", "fault", t_ticks_node=second * TICKS, code=code, detail=detail)
    health = feeder.frame()["health"]
    assert len(health["faults"]) == 6
    assert health["faults"][0]["words"] == words.FAULTS["cal_store"]
    assert health["faults"][0]["detail"] == "INT1 <b>"
    assert (health["level"], health["state"]) == ("bad", "Fault")


def test_every_fault_of_the_protocol_has_words() -> None:
    assert set(words.FAULTS) == set(FAULT_CODES)
    assert words.fault(60_000) == "fault number 60000"


def test_a_port_that_is_lost_or_silent_is_said_so(feeder: Feeder) -> None:
    feeder.say("leader", "hello")
    feeder.say("follower", "hello")
    assert feeder.row("ports")["value"] == "Connected"
    feeder.now_s += SILENT_S
    feeder.say("leader", "hello")
    assert feeder.row("ports")["value"] == "Connected / Silent"
    assert feeder.row("ports")["words"].startswith("follower: ")
    feeder.page.port("leader", "lost", "/dev/ttyACM0: unplugged")
    health = feeder.frame()["health"]
    assert (health["port"], health["level"]) == ("lost", "bad")
    assert feeder.row("ports")["words"] == "leader: /dev/ttyACM0: unplugged"


def test_a_sensor_that_rests_is_no_fault(feeder: Feeder) -> None:
    feeder.ekf(10.0, 0.0)
    feeder.say("leader", "system", t_ticks_node=11 * TICKS)
    assert not feeder.frame()["health"]["resting"]
    feeder.say("leader", "system", t_ticks_node=13 * TICKS)
    assert feeder.frame()["health"]["resting"]
    assert (feeder.row("estimate")["value"], feeder.row("estimate")["level"]) == ("Resting", "ok")


def test_garbage_and_silence_change_nothing(feeder: Feeder) -> None:
    random = np.random.default_rng(1)
    stream = LiveStream()
    for _ in range(50):
        feeder.page.take("leader", stream.feed(random.bytes(2000)), feeder.now_s)
    feeder.page.take("leader", stream.feed(b""), feeder.now_s)
    frame = feeder.frame()
    assert (frame["t"], frame["repetitions"]["count"]) == (None, 0)
    assert feeder.row("ports")["value"].startswith("Damaged")


@pytest.mark.parametrize("piece", [997, 60_000])
def test_a_whole_recording_gives_the_count_of_hil_reps(clean: Recording, piece: int) -> None:
    feeder = Feeder(About("replay", "REPLAY", "clean", ""))
    data = clean.serial["leader"].data.tobytes()[: None if piece > 1000 else 200_000]
    stream = LiveStream()
    for begin in range(0, len(data), piece):
        feeder.page.take("leader", stream.feed(data[begin : begin + piece]), feeder.now_s)
    found = feeder.frame()
    if piece > 1000:
        assert found["repetitions"]["count"] == 8
        assert found["repetitions"]["loss_percent"] == 6.4
    # However the bytes were cut: 97 to 100 estimates a second.
    t = [p[0] for p in found["velocity"]]
    assert np.median(np.diff(t)) == pytest.approx(1 / 97, rel=0.05)
