# SPDX-License-Identifier: Apache-2.0
"""Invented runs, as rich and as nasty as real ones, for the tests of the report."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.measure import Limits, Measurement
from hil.recording import Edges, Event, Integrity, Provenance, Recording, SerialStream
from hil.report import Result
from hil.series import LimitLine, Series, histogram
from hil.wire.codec import encode
from hil.wire.messages import schema_hash

HELLO = {
    "protocol_version": 1,
    "target": 0,
    "schema_hash": schema_hash(),
    "reset_reason": 0,
    "tick_rate_hz": 16_000_000,
    "conn_interval_us": 7500,
    "uptime_ms": 2000,
}


def make_recording(
    name: str = "clean-7ms5",
    *,
    source: str = "sim",
    description: str = "Commensurate-free drifts with wander, ideal channel, 7.5 ms interval.",
    expect_fail: tuple[str, ...] = (),
    duration_s: float = 60.0,
    integrity: Integrity | None = None,
    path: Path | None = None,
    notes: str = "",
    attenuation_db: float | None = None,
) -> Recording:
    """A recording with little in its streams and everything in its provenance."""
    manifests = {
        role: {
            "role": role,
            "target": "sim",
            "build_id": f"{build:016x}",
            "zephyr": "4.1.0",
            "dirty": False,
            "flash_bytes": 174_816,
            "ram_bytes": 54_272,
            "files": {"exe": {"sha256": f"{build:064x}", "size_bytes": 1_843_200}},
            "kconfig": {"CONFIG_BV_CONN_INTERVAL": 6},
        }
        for role, build in (("leader", 0x5D1F00C2A9E37B41), ("follower", 0x8C0A7719E64D2F35))
    }
    streams = {}
    for role_number, role in enumerate(("leader", "follower")):
        data = np.frombuffer(
            encode(
                "hello",
                {
                    **HELLO,
                    "role": role_number,
                    "build_id": int(str(manifests[role]["build_id"]), 16),
                    "device_id": 0xA1B2C3D4E5F60000 + role_number,
                },
                0,
            ),
            dtype=np.uint8,
        )
        streams[role] = SerialStream(data, np.array([0]), np.array([int(duration_s * 1e9)]))
    wander = [{"amplitude_ppm": 0.2, "period_s": 37.0, "phase_rad": 0.0}]
    lossy = attenuation_db is not None
    scenario = {
        "name": name,
        "description": description,
        "duration_s": duration_s,
        "seed": 1,
        "firmware": {"leader": {"BV_CONN_INTERVAL": 6}},
        "nodes": {
            "leader": {"drift_ppm": 13.7, "start_offset_us": 12345, "wander": wander},
            "follower": {"drift_ppm": -31.1, "start_offset_us": 99871, "wander": wander},
        },
        "channel": {
            "kind": "multiatt" if lossy else "ideal",
            "attenuation_db": attenuation_db if lossy else 60.0,
        },
        "expect_fail": list(expect_fail),
    }
    return Recording(
        provenance=Provenance(
            source=source,
            created_utc="2026-11-22T08:30:00+00:00",
            scenario=scenario,
            manifests=manifests,
            tools={"hil": "0.1.0", "bsim": "v2.5", "python": "3.11.2"},
            host={"machine": "x86_64", "system": "Linux 6.1"},
            notes=notes,
        ),
        serial=streams,
        edges=Edges(
            np.array([1_000_000_000, 1_000_001_000]),
            np.array([0, 1]),
            np.array([1, 1]),
            ("leader.pulse", "follower.pulse"),
            1000.0,
        ),
        events=(Event(0, "start", "leader"), Event(0, "start", "follower")),
        integrity=integrity or Integrity(complete=True, blocks=412),
        path=path,
    )


def make_measurements(error_p99_ns: float = 92.4, *, unset: bool = True) -> list[Measurement]:
    """Checks as a run has them; ``error_p99_ns`` decides whether the sync check passes."""
    scale = error_p99_ns / 92.4
    rows: list[tuple[str, float | None, str, Limits, str, str, float]] = [
        (
            "sync.error_p99_ns",
            error_p99_ns,
            "ns",
            Limits(high=150.0, marginal=10.0),
            "T1",
            "Pulses of both nodes in exact ticks against true time, 118 pulses while locked.",
            2.1,
        ),
        (
            "sync.error_max_ns",
            121.0 * scale,
            "ns",
            Limits(high=300.0, marginal=10.0),
            "T2",
            "The same pulses, the largest error.",
            2.1,
        ),
        (
            "sync.error_rms_ns",
            min(41.6 * scale, 64.2),
            "ns",
            Limits(high=66.0, marginal=5.0),
            "T3",
            "The same pulses, root mean square.",
            0.0,
        ),
        (
            "sync.skew_error_ppb",
            104.0,
            "ppb",
            Limits(high=200.0, marginal=10.0),
            "T5",
            "Slope of the reported model against the slope of true time, at every report.",
            0.0,
        ),
        (
            "sync.convergence_s",
            2.31,
            "s",
            Limits(high=5.0),
            "T6",
            "From the first connection event to the first locked report.",
            0.01,
        ),
        (
            "sync.locked_share",
            1.0,
            "1",
            Limits(low=0.99),
            "T7",
            "Share of reports after lock in which the model is locked.",
            0.0,
        ),
        (
            "sync.one_way_bias_ns",
            5003.0,
            "ns",
            Limits(low=4500.0, high=5500.0),
            "B1",
            "Leader to follower minus half the round trip, mean of 7,934 pairs.",
            3.2,
        ),
        ("sync.pairs_wrong", 0, "1", Limits(high=0.0), "P1", "7,934 pairs against true time.", 0.0),
        (
            "link.frames_lost",
            0,
            "1",
            Limits(high=0.0),
            "L2",
            "Gaps in the sequence numbers of both serial streams.",
            0.0,
        ),
        (
            "link.frame_crc_errors",
            0,
            "1",
            Limits(high=0.0),
            "L2",
            "Frames of both serial streams whose CRC is wrong.",
            0.0,
        ),
        (
            "imu.follower_at_leader.samples_lost",
            0,
            "1",
            Limits(high=0.0),
            "I1",
            "Gaps in the sample index of the follower's batches as the leader passed them on.",
            0.0,
        ),
    ]
    if unset:
        rows.append(
            (
                "sync.wrap_errors",
                None,
                "1",
                Limits(high=0.0),
                "W1",
                "The run is shorter than the 268.4 s after which the counter wraps.",
                0.0,
            )
        )
    return [
        Measurement(
            name,
            value,
            unit,
            limits,
            budget,
            how,
            uncertainty,
            clock="leader" if name == "sync.convergence_s" else "",
            details={"pulses": 118, "per_node": {"leader": 59, "follower": 59}}
            if name == "sync.error_p99_ns"
            else {},
        )
        for name, value, unit, limits, budget, how, uncertainty in rows
    ]


def make_series(
    *,
    duration_s: float = 60.0,
    interval_s: float = 7.5e-3,
    skew_fault_ppb: float = 0.0,
    seed: int = 1,
) -> list[Series]:
    """The sync plots of one run."""
    random = np.random.default_rng(seed)
    t = np.arange(0.4, duration_s, interval_s)
    omega = 2 * math.pi / 37.0
    offset_ns = 2 * 0.2e3 / omega * (1 - np.cos(omega * t))
    offset_ns -= np.polyval(np.polyfit(t, offset_ns, 1), t)
    settle = 4e5 * np.exp(-(t - 0.4) / 0.25)
    residual = random.normal(0.0, 289.0 / math.sqrt(6.0), t.size)
    pulse_t = np.arange(3.0, duration_s, 0.5)
    pulse_error = random.normal(0.0, 38.0, pulse_t.size) + skew_fault_ppb * 0.5
    pulse_error += skew_fault_ppb * 0.3 * np.sin(pulse_t)
    tau = np.geomspace(interval_s, duration_s / 4, 24)
    allan = np.sqrt((1.1e-7 / tau) ** 2 + (1.5e-8 * np.sqrt(tau)) ** 2)
    state_t = np.arange(2.4, duration_s, 0.1)
    true_skew = -44.8 + 0.4 * np.sin(omega * state_t)
    limit = (LimitLine(150.0, "+150 ns, T1"), LimitLine(-150.0, "−150 ns, T1", "below"))
    common: dict[str, Any] = {"x_unit": "s", "clock": "leader", "x_label": "time"}
    return [
        Series(
            name="sync.error",
            title="Sync error at the pulses",
            y_unit="ns",
            x=pulse_t,
            y=pulse_error,
            kind="points",
            limits=limit,
            y_label="follower minus leader",
            check="sync.error_p99_ns",
            caption="Each pulse in exact ticks, put on true time: how far apart both nodes fired.",
            **common,
        ),
        histogram(
            "sync.error_histogram",
            "Sync error, distribution",
            pulse_error,
            "ns",
            bins=40,
            limits=limit,
            x_label="follower minus leader",
            check="sync.error_p99_ns",
        ),
        Series(
            name="sync.allan",
            title="Allan deviation of the offset",
            x_unit="s",
            y_unit="1",
            x=tau,
            y=allan,
            x_label="averaging time",
            y_label="Allan deviation",
            x_log=True,
            y_log=True,
        ),
        Series(
            name="sync.offset",
            title="Offset over time, line taken out",
            y_unit="ns",
            x=t,
            y=offset_ns + residual / 4,
            y_label="offset",
            caption="From every pair; the straight line is the drift and is not shown.",
            **common,
        ),
        Series(
            name="sync.skew_reported",
            title="reported",
            y_unit="ppm",
            x=state_t,
            y=true_skew + skew_fault_ppb * 1e-3 + random.normal(0.0, 0.03, state_t.size),
            y_label="skew",
            plot="sync.skew",
            plot_title="Skew, reported and true",
            check="sync.skew_error_ppb",
            **common,
        ),
        Series(
            name="sync.skew_true",
            title="true",
            y_unit="ppm",
            x=state_t,
            y=true_skew,
            y_label="skew",
            plot="sync.skew",
            **common,
        ),
        Series(
            name="sync.residual",
            title="Residuals of the pairs",
            y_unit="ns",
            x=t,
            y=np.where((t > 20) & (t < 21), np.nan, residual),
            kind="points",
            y_label="pair minus fit",
            caption="No pairs between 20 s and 21 s: the link was lost.",
            **common,
        ),
        Series(
            name="sync.convergence",
            title="Convergence after the first connection",
            y_unit="ns",
            x=t[: int(5 / interval_s)],
            y=np.abs(settle + residual)[: int(5 / interval_s)] + 1.0,
            y_label="error of the model",
            y_log=True,
            limits=(LimitLine(150.0, "150 ns, T1"),),
            check="sync.convergence_s",
            **common,
        ),
        Series(
            name="sync.edges",
            title="Pulses on the analyser against the schedule",
            y_unit="ns",
            x=pulse_t,
            y=random.integers(-1, 2, pulse_t.size) * 1000.0,
            kind="points",
            limits=(LimitLine(1500.0, "+1500 ns, G1"), LimitLine(-1500.0, "−1500 ns, G1", "below")),
            x_unit="s",
            clock="bench",
            x_label="time",
            y_label="follower edge minus leader edge",
        ),
    ]


@pytest.fixture(scope="session")
def recording() -> Callable[..., Recording]:
    return make_recording


@pytest.fixture(scope="session")
def measurements() -> Callable[..., list[Measurement]]:
    return make_measurements


@pytest.fixture(scope="session")
def series() -> Callable[..., list[Series]]:
    return make_series


@pytest.fixture(scope="session")
def four_runs() -> list[Result]:
    """Three good runs and one that is made to fail, and does."""
    return [
        Result(make_recording(), make_measurements(), make_series()),
        Result(
            make_recording("wander-30ms", description="Wandering crystals, 30 ms interval."),
            make_measurements(145.2),
            make_series(interval_s=30e-3, seed=2),
        ),
        Result(
            make_recording("lossy-7ms5", description="Lossy channel.", attenuation_db=91.5),
            make_measurements(98.0),
            make_series(seed=3),
        ),
        Result(
            make_recording(
                "faulty-skew-sign",
                description="The follower applies the skew with the wrong sign.",
                expect_fail=("sync.error_p99_ns", "sync.error_max_ns"),
            ),
            make_measurements(41_234.0),
            make_series(skew_fault_ppb=82_000.0, seed=4),
        ),
    ]


HOSTILE = (
    "</script><script>window.hacked=1</script>",
    '"><img src=x onerror="window.hacked=2">',
    "<!-- <script> ]]> &amp; {{ 7*7 }} {% raw %} ' onload='x",
    "javascript:window.hacked=3",
    "[red]not markup[/red] \x1b[31m \x00 \ud800 \u2028",
    "W" * 300,
)


@pytest.fixture(scope="session")
def hostile() -> Result:
    """A run that puts hostile text wherever a recording or an analysis can put text."""
    for_index = iter(range(10**6))

    def bad() -> str:
        return HOSTILE[next(for_index) % len(HOSTILE)]

    base = make_recording()
    mapping = base.provenance.to_mapping()
    scenario = {
        **mapping["scenario"],
        "name": HOSTILE[0],
        "description": "".join(HOSTILE),
        "expect_fail": list(HOSTILE),
        bad(): {bad(): [bad(), {bad(): bad()}]},
    }
    provenance = Provenance(
        **{
            **mapping,
            "scenario": scenario,
            "created_utc": bad(),
            "manifests": {bad(): {bad(): bad(), "build_id": bad()} for _ in HOSTILE},
            "tools": {bad(): bad() for _ in HOSTILE},
            "host": {bad(): bad() for _ in HOSTILE},
            "notes": "".join(HOSTILE),
        }
    )
    recording = Recording(
        provenance=provenance,
        serial=base.serial,
        edges=base.edges,
        events=tuple(Event(0, text, text) for text in HOSTILE),
        integrity=Integrity(False, HOSTILE, 1, 2),
    )
    measurements = [
        Measurement(
            name=text,
            value=999.0,
            unit=text,
            limits=Limits(high=1.0),
            budget=text,
            how=text,
            clock=text,
            details={text: {text: [text]}},
        )
        for text in HOSTILE
    ]
    series = [
        Series(
            name=text,
            title=text,
            x_unit=text,
            y_unit=text,
            x=np.arange(20.0),
            y=np.arange(20.0),
            limits=(LimitLine(10.0, text),),
            clock=text,
            y_clock=text,
            x_label=text,
            y_label=text,
            plot=text,
            plot_title=text,
            check=text,
            caption=text,
        )
        for text in HOSTILE
    ]
    return Result(recording, measurements, series, rig_failure="".join(HOSTILE))
