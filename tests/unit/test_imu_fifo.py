# SPDX-License-Identifier: Apache-2.0
"""The FIFO suite: each counter under its own name, and injected faults noticed and over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hil import checks, imu, timesync
from hil.budget import Conditions
from hil.imu import fifo, injected
from hil.imu.chip import FifoStats, fifo_stats, has_chip
from hil.imu.injected import Injected
from hil.measure import Measurement, Verdict
from hil.recording import Recording
from hil.synthesis import Plan, synthesise
from hil.wire.messages import BY_NAME, FAULT_CODES, IMU_FLAGS
from hil.wire.records import record_type
from tests.unit.test_imu_truth import chip, stream

SIM = Conditions(conn_interval_us=7_500)
BENCH = Conditions(conn_interval_us=7_500, simulated=False)
SECONDS = 10
RATE_HZ = 388


def counters(**changed: Any) -> FifoStats:
    """A frame a second; ``changed`` replaces whole columns."""
    raw = np.zeros(SECONDS, record_type(BY_NAME["fifo_stats"]))
    at_s = np.arange(1, SECONDS + 1)
    raw["t_ticks_node"] = at_s * 16_000_000
    raw["samples"] = at_s * RATE_HZ
    raw["bus_busy_us"] = at_s * 5_500
    raw["level_max"] = raw["watermark"] = 32
    for name, values in changed.items():
        raw[name] = values
    return FifoStats(raw, raw["t_ticks_node"].astype(np.int64), at_s * 10**9, 416.0, 1)


def judged_by(stats: FifoStats) -> dict[str, Measurement]:
    return {m.name.removeprefix("fifo.x."): m for m in fifo.counted("fifo.x", stats, SIM)}


def failing(found: Mapping[str, Measurement]) -> set[str]:
    return {name for name, m in found.items() if m.verdict is not Verdict.PASS}


def test_sound_counters_pass() -> None:
    found = judged_by(counters())
    assert failing(found) == set()
    assert found["rate_hz"].value == pytest.approx(RATE_HZ)
    assert found["level_max_share"].value == pytest.approx(32 / 512)
    assert found["bus_occupancy"].value == pytest.approx(0.0055)
    assert "wake_to_sample_ms" not in found


@pytest.mark.parametrize("name", fifo.COUNTERS)
def test_each_counter_fails_its_own_measurement_and_no_other(name: str) -> None:
    found = judged_by(counters(**{name: np.arange(SECONDS) // 9}))
    assert failing(found) == {name}
    assert found[name].value == 1


def test_a_level_beyond_half_of_the_fifo_is_too_late_once_too_often() -> None:
    level = np.full(SECONDS, 32)
    level[4] = 257
    assert failing(judged_by(counters(level_max=level))) == {"level_max_share"}
    level[4] = 256
    assert failing(judged_by(counters(level_max=level))) == set()


def test_the_bus_counter_may_wrap() -> None:
    busy = (np.arange(SECONDS) * 5_500 - 20_000) % 2**32
    assert judged_by(counters(bus_busy_us=busy))["bus_occupancy"].value == pytest.approx(0.0055)
    busy = np.arange(SECONDS) * 160_000
    assert failing(judged_by(counters(bus_busy_us=busy))) == {"bus_occupancy"}


def test_a_rest_is_no_loss_of_rate_but_a_stall_is() -> None:
    samples = np.cumsum([0, RATE_HZ, RATE_HZ, 0, 0, 0, RATE_HZ, RATE_HZ, RATE_HZ, RATE_HZ])
    samples += RATE_HZ
    awake = np.where(np.arange(SECONDS) < 6, 0, 1)
    rested = judged_by(counters(samples=samples, wake_ups=awake, wake_to_sample_us=180_000))
    assert failing(rested) == set()
    assert rested["rate_hz"].value == pytest.approx(RATE_HZ)
    assert rested["wake_to_sample_ms"].value == pytest.approx(180.0)
    assert failing(judged_by(counters(samples=samples))) == {"rate_hz"}
    slow = judged_by(counters(samples=samples, wake_ups=awake, wake_to_sample_us=251_000))
    assert failing(slow) == {"wake_to_sample_ms"}


def test_one_frame_is_no_measurement() -> None:
    stats = counters()
    one = FifoStats(stats.raw[:1], stats.t_ticks[:1], stats.seen_t_ns_bench[:1], 416.0, 1)
    assert len(failing(judged_by(one))) == 3 + len(fifo.COUNTERS)


@pytest.fixture(scope="module")
def sound() -> Recording:
    return synthesise(Plan(duration_s=8.0))


def test_load_has_a_limit_where_there_is_a_processor(sound: Recording) -> None:
    simulated = fifo.cpu_load(sound, "leader", SIM)
    assert simulated.value == pytest.approx(0.2)
    assert simulated.limits.high is None
    assert "busy waits" in simulated.how
    bench = fifo.cpu_load(sound, "leader", BENCH)
    assert bench.limits.high == 0.5
    assert "simulated" not in bench.how


def test_nominal_rate_of_a_stream_is_what_the_node_says(sound: Recording) -> None:
    stats = fifo_stats(sound, "leader")
    assert (stats.odr_hz, stats.decimation) == (208.0, 1)
    scenario = {"nodes": {"leader": {"imu": {"odr_hz": 6667.0}}}}
    other = replace(sound, provenance=replace(sound.provenance, scenario=scenario))
    found = {m.name: m for m in imu.measure(other, timesync.analyse(other))}
    assert found["imu.leader.rate_hz"].limits.high == pytest.approx(1.1 * 208)


def test_a_protocol_older_than_the_driver_has_no_fifo(sound: Recording) -> None:
    """Without the fields that came with the driver, nothing of the chip is asked for."""
    schema = dict(sound.provenance.schema)
    schema["messages"] = [
        {**m, "fields": m["fields"][:13]} if m["name"] == "fifo_stats" else m
        for m in schema["messages"]
    ]
    old = replace(sound, provenance=replace(sound.provenance, schema=schema))
    assert not has_chip(old, "leader")
    assert imu.measure_fifo(old, timesync.analyse(old)) == []
    names = {m.name for m in imu.measure(old, timesync.analyse(old))}
    assert not any("truth" in name or "int1" in name for name in names)
    assert {s.name for s in imu.series(old, timesync.analyse(old))} == {
        "imu.leader.rate",
        "imu.follower.rate",
        "imu.follower_at_leader.latency",
    }


def test_series_of_the_chip(sound: Recording) -> None:
    found = {s.name: s for s in imu.series(sound, timesync.analyse(sound))}
    known = {m.name for m in checks.evaluate(sound)}
    for role in ("leader", "follower"):
        level = found[f"fifo.{role}.level"]
        assert level.y.tolist() == [32.0] * 7
        assert level.limits[0].value == 256
        for name in ("int1_error", "time_error"):
            s = found[f"imu.{role}.{name}"]
            assert s.y.size > 20
            assert np.max(np.abs(s.y)) < s.limits[0].value
    assert {s.check for s in found.values() if s.check} <= known


# --- injected faults -----------------------------------------------------------------------------


def with_faults(recording: Recording, *faults: Mapping[str, Any]) -> Recording:
    scenario = {
        **recording.provenance.scenario,
        "nodes": {"leader": {"imu": {"faults": list(faults)}}},
    }
    return replace(recording, provenance=replace(recording.provenance, scenario=scenario))


def detected(recording: Recording, **fault: Any) -> Measurement:
    run = with_faults(recording, fault)
    found = {m.name: m for m in injected.measure(run, "leader", SIM)}
    assert injected.measure(run, "follower", SIM) == []
    return found[f"fifo.leader.fault_1_{fault['kind']}_detected"]


@pytest.fixture(scope="module")
def counted() -> Recording:
    """All counters rise by one between 7 and 8 s."""
    return synthesise(Plan(duration_s=12.0), ["driver_errors"])


@pytest.fixture(scope="module")
def counted_and_said() -> Recording:
    """The same, and a FAULT frame imu_no_interrupt at 5 s."""
    return synthesise(Plan(duration_s=12.0), ["driver_errors", "fault_frame"])


@pytest.mark.parametrize("kind", ["dropped_edge", "overrun", "bit_errors"])
def test_a_fault_is_detected_by_its_counters(
    kind: str, counted: Recording, sound: Recording
) -> None:
    during = detected(counted, kind=kind, at_s=6.2, duration_s=0.5)
    assert during.verdict is Verdict.PASS
    assert during.value == (3 if kind == "bit_errors" else 1)
    assert detected(counted, kind=kind, at_s=8.2, duration_s=0.5).verdict is Verdict.FAIL
    assert detected(sound, kind=kind, at_s=6.2, duration_s=0.5).verdict is Verdict.FAIL


def test_a_fault_needs_all_of_its_signs(counted: Recording, counted_and_said: Recording) -> None:
    fault = {"kind": "missing_int", "at_s": 4.5, "duration_s": 2.0}
    assert detected(counted_and_said, **fault).verdict is Verdict.PASS
    said = detected(counted, **fault)
    assert said.verdict is Verdict.FAIL
    assert said.details == {"missed_edges": 1.0, "FAULT imu_no_interrupt": 0.0}
    # The frame names another fault than a stuck bus has.
    stuck = detected(counted_and_said, **{**fault, "kind": "stuck_bus"})
    assert stuck.details == {"bus_errors": 1.0, "FAULT imu_bus": 0.0}
    who = detected(counted_and_said, **{**fault, "kind": "wrong_who_am_i"})
    assert who.details == {"FAULT imu_who_am_i": 0.0}


def test_every_sign_is_a_counter_or_a_fault_of_the_protocol() -> None:
    fields = {f.name for f in BY_NAME["fifo_stats"].fields}
    for signs in injected.SIGNS.values():
        assert set(signs.counters) <= fields
        assert not signs.code or signs.code in FAULT_CODES
        assert signs.counters or signs.code


def test_a_kind_that_nobody_knows_fails(sound: Recording) -> None:
    m = detected(sound, kind="gremlin", at_s=1.0, duration_s=1.0)
    assert m.verdict is Verdict.FAIL
    assert "no kind of fault" in m.how


def test_when_a_fault_ends(sound: Recording) -> None:
    run = with_faults(
        sound,
        {"kind": "stuck_bus", "at_s": 2.0},
        {"kind": "overrun", "at_s": 3.0},
        {"kind": "overrun", "at_s": 3.0, "rate": 1.0},
        {"kind": "missing_int", "at_s": 4.0, "duration_s": 1.5},
    )
    ends = [fault.end_s for fault in injected.listed(run, "leader")]
    # A stall lets the FIFO of 512 words overrun by 64: 288 samples at 208 Hz.
    assert ends == [np.inf, pytest.approx(3.0 + 288 / 208), np.inf, 5.5]
    names = [m.name for m in injected.measure(run, "leader", SIM)]
    assert [n for n in names if n.endswith("recovery_s")] == [
        "fifo.leader.fault_2_overrun_recovery_s",
        "fifo.leader.fault_4_missing_int_recovery_s",
    ]


def recovery(changed: slice, *, silent: bool, until_s: float = 5.0) -> Measurement:
    """Fault until 2 s; the batches in ``changed`` are missing, or without a hardware time."""
    b = stream(chip(9000))
    keep = np.ones(len(b), dtype=bool)
    flags = b.flags.copy()
    if silent:
        keep[changed] = False
    else:
        flags[changed] &= ~IMU_FLAGS["hardware_time"]
    b = replace(b, flags=flags[keep], seen_t_ns_bench=b.seen_t_ns_bench[keep])
    return injected.recovery("r", Injected("stuck_bus", 1.0, 2.0), until_s, b, SIM)


def at(seconds: float) -> int:
    """Number of the first batch that is seen after so long."""
    return int(np.searchsorted(stream(chip(9000)).seen_t_ns_bench, seconds * 1e9))


@pytest.mark.parametrize("silent", [True, False])
def test_recovery_lasts_until_batches_have_hardware_times_again(silent: bool) -> None:
    batch_s = 8 / 1553.4
    good = recovery(slice(at(1.0), at(2.0)), silent=silent)
    assert good.verdict is Verdict.PASS
    assert good.value == pytest.approx(0.0, abs=batch_s)
    late = recovery(slice(at(1.0), at(2.9)), silent=silent)
    assert late.verdict is Verdict.PASS
    assert late.value == pytest.approx(0.9, abs=2 * batch_s)
    worse = recovery(slice(at(1.0), at(3.1)), silent=silent)
    assert worse.verdict is Verdict.FAIL
    never = recovery(slice(at(1.0), None), silent=silent)
    assert never.verdict is Verdict.FAIL
    assert "no batch" in never.how


def test_a_relapse_belongs_to_the_recovery_until_the_next_fault() -> None:
    relapse = slice(at(2.5), at(2.6))
    assert recovery(relapse, silent=False).value == pytest.approx(0.6, abs=0.02)
    assert recovery(relapse, silent=False, until_s=2.4).value == pytest.approx(0.0, abs=0.02)
