# SPDX-License-Identifier: Apache-2.0
"""What a synthetic recording shall contain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hil.recording import ClockModel


@dataclass(frozen=True)
class NodePlan:
    """One node.

    Attributes:
        drift_ppm, start_offset_us, wander: crystal, as in a scenario.
        timer_start_us: local time at which the TIMER reads zero. A negative value lets the
            counter wrap early in the run.
        imu_rate_hz: true sample rate; imu_odr_hz: nominal one.
    """

    drift_ppm: float
    start_offset_us: int
    timer_start_us: int
    wander: tuple[Mapping[str, float], ...] = ()
    imu_rate_hz: float = 193.86
    imu_odr_hz: float = 208.0

    def to_scenario(self) -> dict[str, Any]:
        """The node's part of a scenario."""
        return {
            "drift_ppm": self.drift_ppm,
            "start_offset_us": self.start_offset_us,
            "wander": [dict(term) for term in self.wander],
            "imu": {"odr_hz": self.imu_odr_hz},
        }

    @property
    def clock(self) -> ClockModel:
        return ClockModel.from_mapping(self.to_scenario())


LEADER = NodePlan(
    13.7, 12_345, 1_500, ({"amplitude_ppm": 0.2, "period_s": 37.0, "phase_rad": 0.0},)
)
FOLLOWER = NodePlan(
    -31.1, 45_678, 2_345, ({"amplitude_ppm": 0.2, "period_s": 41.0, "phase_rad": 1.0},)
)


@dataclass(frozen=True)
class Plan:
    """A run of two nodes.

    Attributes:
        loss: share of packets that arrive corrupted; ``lossy`` declares the channel as such.
        delay_us: chain delay of transmitter plus receiver, the one-way bias.
        reconnect_at_s: the link is lost here and back half a second later.
        state_period_s: distance of the leader's clock models.
        pulse_period_s, pulse_lead_s: schedule, and how long before it a pulse is programmed.
        lock_after_s: span of pairs that makes the model locked.
        skew_sign, capture_late_us, timer_bits, pulse_error_ticks: faults of the firmware;
            ``capture_late_us`` holds one lateness per RX, drawn at random, for the follower.
    """

    name: str = "synthetic"
    duration_s: float = 20.0
    seed: int = 1
    conn_interval_us: int = 7_500
    phy: int = 2
    delay_us: float = 5.0
    loss: float = 0.0
    leader: NodePlan = LEADER
    follower: NodePlan = FOLLOWER
    reconnect_at_s: float | None = None
    state_period_s: float = 0.1
    pulse_period_s: float = 0.25
    pulse_lead_s: float = 0.1
    lock_after_s: float = 1.9
    skew_sign: int = 1
    capture_late_us: tuple[int, ...] = (0,)
    timer_bits: int = 64
    pulse_error_ticks: int = 0
    build_id: Mapping[str, int] = field(
        default_factory=lambda: {"leader": 0x1111_2222_3333_4444, "follower": 0x5555_6666_7777_8888}
    )

    def node(self, role: str) -> NodePlan:
        return self.leader if role == "leader" else self.follower

    def to_scenario(self) -> dict[str, Any]:
        """As :func:`hil.scenario.to_mapping` writes it, for the provenance."""
        return {
            "name": self.name,
            "description": "synthetic frames and edges, no firmware",
            "duration_s": self.duration_s,
            "seed": self.seed,
            "firmware": {},
            "nodes": {"leader": self.leader.to_scenario(), "follower": self.follower.to_scenario()},
            "channel": {
                "kind": "multiatt" if self.loss else "ideal",
                "attenuation_db": 60.0,
            },
            "expect_fail": [],
        }
