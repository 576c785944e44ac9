# SPDX-License-Identifier: Apache-2.0
"""The parts of a run on the bench, each by itself."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil import scenario
from hil.bench import align, boot, prepared, trust, watch, wiring_check
from hil.bench.analyser.capture import CaptureEdges
from hil.bench.applied import applied, sentence
from hil.bench.inventory import Analyser, Inventory, Signal
from hil.bench.port import Chunk
from hil.bench.unfinished import attempt
from hil.errors import BuildError, RigError
from hil.recording import SerialStream
from hil.wire.codec import decode, encode
from hil.wire.messages import BY_NAME, schema_hash
from tests.bench.fakes import images

MS = 1_000_000


def frame(name: str, seq: int, **values: Any) -> bytes:
    """A frame whose fields are 0 where nothing is said."""
    return encode(name, {f.name: 0 for f in BY_NAME[name].fields} | values, seq)


# What a bench can do


def test_what_only_a_simulation_can_do_is_taken_out_and_named() -> None:
    plan = scenario.from_mapping(
        {
            "name": "x",
            "nodes": {
                "leader": {
                    "drift_ppm": 13.7,
                    "imu": {"odr_hz": 833, "faults": [{"kind": "overrun", "at_s": 1.0}]},
                    "calibration": {},
                },
                "follower": {"imu": {"odr_error": 0.01}},
            },
            "motion": {"lift": "bench"},
            "channel": {"kind": "multiatt"},
            "firmware": {"leader": {"BV_CONN_INTERVAL": 24}},
            "link_drops": [{"at_s": 3.0}],
        },
        "test",
    )
    kept, left_out = applied(plan)
    assert left_out == [
        *("the crystals", "the motion 'bench'", "the channel 'multiatt'", "the sensor's faults"),
        *("the sensor's clock, noise and temperature", "the calibration in flash"),
    ]
    assert kept.nodes["leader"] == scenario.NodeScenario(imu=scenario.ImuScenario(odr_hz=833))
    assert kept.motion is None
    assert kept.channel == scenario.Channel()
    assert (kept.kconfig, kept.link_drops) == (plan.kconfig, plan.link_drops)


def test_a_scenario_that_a_bench_can_do_is_left_as_it_is() -> None:
    plan = scenario.Scenario("x", nodes={"leader": scenario.NodeScenario()})
    assert applied(plan) == (plan, [])
    assert sentence([]) == ""


# The start of the boards


def hello(seq: int, uptime_ms: int, **values: int) -> bytes:
    return frame("hello", seq, uptime_ms=uptime_ms, schema_hash=schema_hash(), **values)


def test_firmware_that_ran_on_is_told_from_firmware_that_started() -> None:
    old, new = hello(7, 61_000), hello(0, 0, build_id=9)
    chunks = [
        Chunk(1000 * MS, b"noise" + old[:10]),
        Chunk(1010 * MS, old[10:] + b"more"),
        Chunk(1400 * MS, b"text" + new[:4]),
        Chunk(1405 * MS, new[4:] + b"tail"),
    ]
    assert boot.first_hello(chunks[:2], 990 * MS) is None
    found = boot.first_hello(chunks, 990 * MS)
    assert found is not None
    fields, start = found
    assert fields["build_id"] == 9
    rest = boot.behind(chunks, start)
    assert b"".join(chunk.data for chunk in rest) == new + b"tail"
    assert [chunk.t_ns_host for chunk in rest] == [1400 * MS, 1405 * MS]


@pytest.mark.parametrize(("uptime_ms", "is_new"), [(400, True), (412, True), (420, False)])
def test_an_uptime_that_fits_between_reset_and_arrival(uptime_ms: int, is_new: bool) -> None:
    chunks = [Chunk(1410 * MS, hello(0, uptime_ms))]
    assert (boot.first_hello(chunks, 1000 * MS) is not None) is is_new


class Line:
    """A port that gives its chunks one by one."""

    path = "/dev/ttyACM7"

    def __init__(self, *data: bytes) -> None:
        self._data = list(data)
        self._kept = [hello(0, 0), b"old"]

    def read_bytes(self, timeout_s: float) -> bytes:
        """What a debugger had kept: also a HELLO at boot, and that is not to be taken."""
        return self._kept.pop() if self._kept else b""

    def read(self, timeout_s: float) -> list[Chunk]:
        time.sleep(timeout_s)
        return [Chunk(time.monotonic_ns(), self._data.pop(0))] if self._data else []


def test_both_boards_are_heard_from_their_start_on() -> None:
    leader = Line(hello(3, 61_000), hello(0, 0) + b"a", b"b")
    follower = Line(b"", b"", b"", hello(0, 0) + b"c")
    ports: Any = {"leader": leader, "follower": follower}
    calls: list[str] = []
    zero_ns, boots = boot.restart(ports, lambda: calls.append("reset"), 5.0)
    assert calls == ["reset"]
    said = {role: b"".join(c.data for c in b.chunks) for role, b in boots.items()}
    assert said == {"leader": hello(0, 0) + b"ab", "follower": hello(0, 0) + b"c"}
    assert boots["leader"].dropped_bytes == 3 + len(hello(0, 0) + hello(3, 61_000))
    assert zero_ns < boots["leader"].t_ns_host < boots["follower"].t_ns_host


def test_boards_that_do_not_start_are_told_apart() -> None:
    ports: Any = {"leader": Line(hello(9, 61_000)), "follower": Line(b"junk")}
    with pytest.raises(RigError) as caught:
        boot.restart(ports, lambda: None, 0.2)
    assert caught.value.message.splitlines() == [
        "the leader goes on at /dev/ttyACM7 as if there had been no reset",
        "the follower did not say HELLO at /dev/ttyACM7 within 0.2 s of its reset (4 bytes came)",
    ]
    assert "vcom" in caught.value.mend


# Images given


def test_images_built_before_are_read_and_held_against_the_scenario(tmp_path: Path) -> None:
    for role in ("leader", "follower"):
        replace(images.built(tmp_path / role, role), kconfig={"A": 1}).save()
    found = prepared.images(tmp_path)
    assert {role: image.role for role, image in found.items()} == {
        "leader": "leader",
        "follower": "follower",
    }
    wanted = {role: {"A": 1} for role in found}
    prepared.check_kconfig(found, scenario.Scenario("x", kconfig=wanted))
    with pytest.raises(BuildError, match="wants the leader built with no option"):
        prepared.check_kconfig(found, scenario.Scenario("x"))
    (tmp_path / "follower" / "hil-manifest.json").write_text("{")
    with pytest.raises(BuildError, match="no image of the follower"):
        prepared.images(tmp_path)


# A run that did not end


def test_a_run_that_failed_leaves_its_mark_until_one_succeeds(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"

    def fail() -> None:
        with attempt(bench) as before:
            assert not before
            raise RigError("x")

    with pytest.raises(RigError):
        fail()
    with attempt(bench) as before:
        assert before
    with attempt(bench) as before:
        assert not before


# The analyser


def test_the_place_of_an_analyser_is_taken_out_of_its_driver() -> None:
    def split(driver: str) -> tuple[str, str]:
        return watch.split_driver(Analyser("sigrok", 8_000_000, driver))

    assert split("fx2lafw") == ("fx2lafw", "")
    assert split("fx2lafw:conn=1.7") == ("fx2lafw", "1.7")
    assert split("x:a=b:conn=1.7") == ("x:a=b", "1.7")


def test_inputs_of_a_saleae_are_numbers() -> None:
    def bench(name: str) -> Inventory:
        channels = {name: Signal("leader", "pulse")}
        return Inventory(Path("b"), {}, analyser=Analyser("saleae", 8_000_000, "", channels))

    made = watch.analyser_of(bench("D3"), 1.0)
    assert made is not None
    assert made.channels == ("leader.pulse",)
    with pytest.raises(RigError, match="a Saleae input is a number"):
        watch.analyser_of(bench("SDA"), 1.0)
    assert watch.analyser_of(Inventory(Path("b"), {}), 1.0) is None


def capture(rate_hz: float = 1e6, samples: int = 2_000_000, **channels: Any) -> CaptureEdges:
    """Channels that begin low and change at these samples; ``__`` in a name is a dot."""
    times = [np.asarray(t, dtype=np.int64) for t in channels.values()]
    sample = np.concatenate(times)
    channel = np.concatenate([np.full(len(t), n, np.uint8) for n, t in enumerate(times)])
    level = np.concatenate([(np.arange(len(t)) + 1) % 2 for t in times]).astype(np.uint8)
    order = np.argsort(sample, kind="stable")
    names = tuple(name.replace("__", ".") for name in channels)
    return CaptureEdges(
        rate_hz, samples, names, np.zeros(len(times), np.uint8),
        *(column[order] for column in (sample, channel, level)),
    )  # fmt: skip


def test_a_capture_from_a_sample_on() -> None:
    part = trust.since(capture(a=[10, 20, 30], b=[5]), 15)
    assert part.initial.tolist() == [1, 1]
    assert part.sample.tolist() == [5, 15]
    assert part.level.tolist() == [0, 1]
    assert part.samples == 2_000_000 - 15


def test_only_what_the_firmware_says_it_did_is_asked_of_the_analyser() -> None:
    """A node that made no pulse is for the checks; one that says it did has a loose wire."""
    still = capture(leader__pulse=[])
    silent = decode(b"")
    streams = {"leader": silent, "follower": silent}
    assert trust.findings(still, streams, 0) == []
    spoke = decode(frame("pulse", 0, index=1))
    found = trust.findings(still, streams | {"leader": spoke}, 0)
    assert [finding.kind for finding in found] == ["stuck"]


def stream(pulse_ticks: list[int], first_index: int = 0) -> SerialStream:
    """A leader whose frames come 4 ms after what they tell; its tick 0 is at 1 s."""
    events = [
        (
            t,
            frame(
                "pulse", 0, index=first_index + n, compare_ticks_node=t, scheduled_ticks_leader=t
            ),
        )
        for n, t in enumerate(pulse_ticks)
    ]
    last = pulse_ticks[-1]
    events += [
        (t, frame("sync_capture", 0, tx_end_ticks_node=t, rx_end_ticks_node=t))
        for t in range(0, last, 160_000)
    ]
    events.sort(key=lambda event: event[0])
    at_ns = np.array([1_000_000_000 + t * 125 // 2 + 4 * MS for t, _ in events])
    sizes = [len(data) for _, data in events]
    data = np.frombuffer(b"".join(data for _, data in events), np.uint8)
    return SerialStream(data, np.cumsum([0, *sizes[:-1]]), at_ns)  # fmt: skip


@pytest.mark.parametrize("off_ms", [0, 37, -60, 110, -190])
def test_a_capture_is_moved_to_where_the_leader_reports_its_pulses(off_ms: int) -> None:
    ticks = [8_000_000 + n * 1_600_000 for n in range(20)]
    # Pulses at 1.5 s, 1.6 s ...; after the last report the capture goes on for three more.
    true_ns = np.array([1_500 * MS + n * 100 * MS for n in range(23)])
    both = np.sort(np.concatenate([true_ns, true_ns + MS // 2]))
    said = stream(ticks)
    moved = align.align(said, decode(said.data), both - off_ms * MS, 200 * MS)
    # 4 ms late, as the frames are.
    assert moved.shift_ns == pytest.approx((off_ms + 4) * MS, abs=1000)
    assert moved.pulses == 20
    assert moved.uncertainty_ns < 25 * MS


def test_a_capture_without_the_leaders_pulses_stays_where_the_host_saw_it() -> None:
    said = stream([8_000_000 + n * 1_600_000 for n in range(20)])
    stay = align.Alignment(0, 200 * MS, 0)
    assert align.align(said, decode(said.data), np.zeros(0, np.int64), 200 * MS) == stay
    far = np.array([60_000 * MS + n * 100 * MS for n in range(20)])
    assert align.align(said, decode(said.data), far, 200 * MS) == stay


# The wires


def test_wires_with_and_without_life() -> None:
    rise = np.arange(50_000, 1_950_000, 100_000)
    pulse = np.sort(np.concatenate([rise, rise + 500]))
    sound = capture(
        leader__pulse=pulse, leader__radio_end=np.arange(100, 2_000_000, 7500), leader__imu_int1=[]
    )
    found = {check.name: check for check in wiring_check.judge(sound)}
    assert {name: check.verdict for name, check in found.items()} == {
        "wire leader.pulse": "pass",
        "wire leader.radio_end": "pass",
        "wire leader.imu_int1": "fail",
    }
    assert "pulses as wide as they should be" in found["wire leader.pulse"].found
    assert "hil bench reset" in found["wire leader.imu_int1"].fix


def test_wires_that_are_exchanged_are_found_by_what_they_carry() -> None:
    rise = np.arange(50_000, 1_950_000, 100_000)
    pulse = np.sort(np.concatenate([rise, rise + 500]))
    swapped = capture(leader__radio_end=pulse, leader__pulse=np.arange(100, 2_000_000, 7500))
    failed = [check for check in wiring_check.judge(swapped) if check.verdict == "fail"]
    assert any("swap the wires of leader.pulse and leader.radio_end" in c.fix for c in failed)


def test_a_bench_without_an_analyser_is_one_line_with_its_mend() -> None:
    checks = wiring_check.check_wiring(Inventory(Path("b"), {}))
    assert [(c.name, c.verdict) for c in checks] == [("wiring", "fail")]
    assert "docs/bench.md" in checks[0].fix
