# SPDX-License-Identifier: Apache-2.0
"""A scenario: what a run does, read from TOML, the same for every backend.

Example::

    name = "clean-7ms5"
    description = "Commensurate-free drifts, ideal channel."
    duration_s = 60
    seed = 1

    [firmware.leader]            # Kconfig of the image, beside the defaults
    BV_CONN_INTERVAL = 6

    [nodes.leader]
    drift_ppm = 13.7
    start_offset_us = 12345
    wander = [{ amplitude_ppm = 0.2, period_s = 37.0, phase_rad = 0.0 }]

    [channel]
    kind = "multiatt"
    attenuation_db = 60.0
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hil.errors import ScenarioError

ROLES = ("leader", "follower")
CHANNEL_KINDS = ("ideal", "multiatt")


@dataclass(frozen=True)
class Wander:
    """One sinusoidal term of a crystal's frequency wander: A * sin(2 pi t / T + phase)."""

    amplitude_ppm: float
    period_s: float
    phase_rad: float = 0.0


@dataclass(frozen=True)
class NodeScenario:
    """The simulated crystal of one node.

    ``start_offset_us`` is how far the node's local time lags true time at true time zero.
    """

    drift_ppm: float = 0.0
    start_offset_us: int = 0
    wander: tuple[Wander, ...] = ()
    imu: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Channel:
    """Radio channel of the simulation.

    ``ideal`` never loses a packet. ``multiatt`` attenuates by ``attenuation_db``; near the
    receiver's sensitivity packets are then corrupted at random, which is the lossy channel.
    """

    kind: str = "ideal"
    attenuation_db: float = 60.0


@dataclass(frozen=True)
class Scenario:
    """One run. ``kconfig`` maps role -> Kconfig name (without ``CONFIG_``) -> value.

    ``expect_fail`` names the checks that this scenario is made to fail: it is a test of the
    checks, and it is never part of a default run.
    """

    name: str
    description: str = ""
    duration_s: float = 60.0
    seed: int = 1
    nodes: Mapping[str, NodeScenario] = field(default_factory=dict)
    channel: Channel = field(default_factory=Channel)
    kconfig: Mapping[str, Mapping[str, int | str | bool]] = field(default_factory=dict)
    expect_fail: tuple[str, ...] = ()

    def node(self, role: str) -> NodeScenario:
        return self.nodes.get(role, NodeScenario())


def load(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: not TOML, an unknown key, a missing name or a value out of range; the
            message names file and key.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScenarioError(
            f"{path}: cannot be read: {error.strerror}",
            "name an existing file, e.g. fixtures/scenarios/clean-7ms5.toml",
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}") from error
    return from_mapping(data, str(path))


def from_mapping(data: Mapping[str, Any], where: str) -> Scenario:
    """Build a scenario from plain data, as TOML or a recording's provenance holds it."""
    top = {
        "name": str,
        "description": str,
        "duration_s": (int, float),
        "seed": int,
        "firmware": dict,
        "nodes": dict,
        "channel": dict,
        "expect_fail": list,
    }
    _check(data, top, where)
    if not data.get("name"):
        raise ScenarioError(f"{where}: 'name' is missing", 'add: name = "my-scenario"')
    if data.get("duration_s", 60) <= 0:
        raise ScenarioError(f"{where}: 'duration_s' must be positive")
    nodes = data.get("nodes", {})
    kconfig = data.get("firmware", {})
    for section, table in (("nodes", nodes), ("firmware", kconfig)):
        for role in table:
            if role not in ROLES:
                raise ScenarioError(
                    f"{where}: unknown role '{section}.{role}'", "roles: " + ", ".join(ROLES)
                )
    channel = data.get("channel", {})
    _check(channel, {"kind": str, "attenuation_db": (int, float)}, f"{where}: [channel]")
    if channel.get("kind", "ideal") not in CHANNEL_KINDS:
        raise ScenarioError(
            f"{where}: channel.kind = {channel['kind']!r} is unknown",
            "kinds: " + ", ".join(CHANNEL_KINDS),
        )
    return Scenario(
        name=data["name"],
        description=data.get("description", ""),
        duration_s=float(data.get("duration_s", 60.0)),
        seed=data.get("seed", 1),
        nodes={role: _node(node, f"{where}: [nodes.{role}]") for role, node in nodes.items()},
        channel=Channel(**channel),
        kconfig={role: dict(options) for role, options in kconfig.items()},
        expect_fail=tuple(data.get("expect_fail", ())),
    )


def to_mapping(scenario: Scenario) -> dict[str, Any]:
    """The inverse of :func:`from_mapping`: what a recording's provenance keeps."""
    return {
        "name": scenario.name,
        "description": scenario.description,
        "duration_s": scenario.duration_s,
        "seed": scenario.seed,
        "firmware": {role: dict(options) for role, options in scenario.kconfig.items()},
        "nodes": {
            role: {
                "drift_ppm": node.drift_ppm,
                "start_offset_us": node.start_offset_us,
                "wander": [
                    {
                        "amplitude_ppm": w.amplitude_ppm,
                        "period_s": w.period_s,
                        "phase_rad": w.phase_rad,
                    }
                    for w in node.wander
                ],
                "imu": dict(node.imu),
            }
            for role, node in scenario.nodes.items()
        },
        "channel": {
            "kind": scenario.channel.kind,
            "attenuation_db": scenario.channel.attenuation_db,
        },
        "expect_fail": list(scenario.expect_fail),
    }


def _node(data: Mapping[str, Any], where: str) -> NodeScenario:
    _check(
        data,
        {"drift_ppm": (int, float), "start_offset_us": int, "wander": list, "imu": dict},
        where,
    )
    for term in data.get("wander", ()):
        _check(
            term,
            {"amplitude_ppm": (int, float), "period_s": (int, float), "phase_rad": (int, float)},
            f"{where}: wander",
        )
        if not {"amplitude_ppm", "period_s"} <= term.keys() or term["period_s"] <= 0:
            raise ScenarioError(f"{where}: each wander term needs amplitude_ppm and period_s > 0")
    return NodeScenario(
        drift_ppm=float(data.get("drift_ppm", 0.0)),
        start_offset_us=data.get("start_offset_us", 0),
        wander=tuple(Wander(**term) for term in data.get("wander", ())),
        imu=dict(data.get("imu", {})),
    )


def _check(data: Mapping[str, Any], allowed: Mapping[str, Any], where: str) -> None:
    for key, value in data.items():
        if key not in allowed:
            raise ScenarioError(
                f"{where}: unknown key '{key}'", "known keys: " + ", ".join(sorted(allowed))
            )
        if not isinstance(value, allowed[key]) or isinstance(value, bool):
            raise ScenarioError(f"{where}: '{key}' has the wrong type ({type(value).__name__})")
