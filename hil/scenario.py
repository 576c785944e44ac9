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

    [nodes.leader.imu]           # the simulated sensor and how it is set up
    odr_hz = 1667
    odr_error = -0.068
    faults = [{ kind = "overrun", at_s = 20.0 }]

    [nodes.leader.calibration]   # what its flash holds when it starts
    gyro_offset_dps = [0.5, 0.0, 0.0]

    [motion]                     # what the bar does: a lift of hil.motion.lifts
    lift = "bench"
    seed = 3

    [channel]
    kind = "multiatt"
    attenuation_db = 60.0

    [[link_drops]]
    at_s = 30.0

    [[inject]]
    kind = "drop"
    value = 1e-4
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from hil.errors import ScenarioError, printable, shorten
from hil.faults.injection import Injection, limited
from hil.faults.injection import from_mapping as injection_from

SIZE_MAX_B = 256 * 1024
NUMBER_MAX = 1 << 63
"""Numbers stay below it, as they have to in a recording's provenance."""

KCONFIG_TYPES = (int, str, bool)

ROLES = ("leader", "follower")
CHANNEL_KINDS = ("ideal", "multiatt")
IMU_FAULT_KINDS = (
    "stuck_bus",
    "wrong_who_am_i",
    "dropped_edge",
    "overrun",
    "bit_errors",
    "missing_int",
)
CHIP_ERRORS = ("ideal", "calibrated", "uncalibrated")


@dataclass(frozen=True)
class Wander:
    """One sinusoidal term of a crystal's frequency wander: A * sin(2 pi t / T + phase)."""

    amplitude_ppm: float
    period_s: float
    phase_rad: float = 0.0


@dataclass(frozen=True)
class ImuFault:
    """A fault of the simulated sensor, in true time; ``docs/lsm6dsox.md`` says what ``rate`` means.

    Without ``duration_s`` it lasts to the end of the run.
    """

    kind: str
    at_s: float
    duration_s: float | None = None
    rate: float | None = None


@dataclass(frozen=True)
class ImuScenario:
    """The IMU of one node: how it is set up and, in simulation, what chip it is.

    ``odr_hz``, ``accel_fs_g``, ``gyro_fs_dps`` and ``rest_s`` are sent to the node when it has
    booted; 0 leaves a setting as the image has it. ``odr_error`` is relative, and grows by
    ``odr_drift_per_s``. ``errors`` names the population that the chip's bias, scale and
    misalignment are drawn from; ``noise`` is the datasheet's density.
    """

    odr_hz: float = 0.0
    accel_fs_g: int = 0
    gyro_fs_dps: int = 0
    rest_s: int = 0
    odr_error: float = 0.0
    odr_drift_per_s: float = 0.0
    temperature_degc: float = 25.0
    temperature_ramp_degc_per_s: float = 0.0
    noise: bool = True
    errors: str = "calibrated"
    faults: tuple[ImuFault, ...] = ()


@dataclass(frozen=True)
class Motion:
    """What the simulated bar does: a lift, from ``start_s`` of true time on.

    ``rests`` puts the bar down between repetitions, in the lifts that know both ways. For the
    first ``handled_s`` somebody has the bar in hand: it is not still while the nodes start.
    """

    lift: str
    seed: int = 1
    rests: bool = False
    start_s: float = 3.0
    handled_s: float = 0.0


@dataclass(frozen=True)
class LinkDrop:
    """The leader ends the connection at ``at_s`` and stays away for ``hold_ms``."""

    at_s: float
    hold_ms: int = 0


@dataclass(frozen=True)
class StoredCalibration:
    """What a simulated node's flash holds when it starts: its own chip's true errors.

    The gyroscope's bias is off by ``gyro_offset_dps``, as after months or a change of temperature.
    """

    gyro_offset_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class NodeScenario:
    """One node: its simulated crystal, its IMU and, if it has one, its stored calibration.

    ``start_offset_us`` is how far the node's local time lags true time at true time zero.
    """

    drift_ppm: float = 0.0
    start_offset_us: int = 0
    wander: tuple[Wander, ...] = ()
    imu: ImuScenario = field(default_factory=ImuScenario)
    calibration: StoredCalibration | None = None


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
    checks, and it is never part of a default run. Nor is one with faults to ``inject``.
    """

    name: str
    description: str = ""
    duration_s: float = 60.0
    seed: int = 1
    nodes: Mapping[str, NodeScenario] = field(default_factory=dict)
    channel: Channel = field(default_factory=Channel)
    kconfig: Mapping[str, Mapping[str, int | str | bool]] = field(default_factory=dict)
    motion: Motion | None = None
    link_drops: tuple[LinkDrop, ...] = ()
    expect_fail: tuple[str, ...] = ()
    inject: tuple[Injection, ...] = ()

    def node(self, role: str) -> NodeScenario:
        return self.nodes.get(role, NodeScenario())


def load(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: not TOML, an unknown key, a missing name or a value out of range; the
            message names file and key.
    """
    try:
        if path.stat().st_size > SIZE_MAX_B:
            raise ScenarioError(
                f"{path}: larger than {SIZE_MAX_B // 1024} KiB; this is no scenario",
                "see fixtures/scenarios/README.md",
            )
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScenarioError(
            f"{path}: cannot be read: {error.strerror}",
            "name an existing file, e.g. fixtures/scenarios/clean-7ms5.toml",
        ) from error
    except RecursionError:
        raise ScenarioError(
            f"{path}: not valid TOML: nested too deep", "compare with a file in fixtures/scenarios"
        ) from None
    except ValueError as error:
        # ValueError: also of text that is no UTF-8 and of numbers with thousands of digits.
        raise ScenarioError(
            printable(f"{path}: not valid TOML: {shorten(str(error))}"),
            "compare with a file in fixtures/scenarios",
        ) from error
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
        "motion": dict,
        "link_drops": list,
        "expect_fail": list,
        "inject": list,
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
    for role, options in kconfig.items():
        # Any name: the build knows which there are.
        names = dict.fromkeys(options, KCONFIG_TYPES) if isinstance(options, dict) else {}
        _check(options, names, f"{where}: [firmware.{role}]")
    if not all(isinstance(check, str) for check in data.get("expect_fail", ())):
        raise ScenarioError(f"{where}: 'expect_fail' needs names of checks")
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
        motion=_motion(data["motion"], f"{where}: [motion]") if data.get("motion") else None,
        link_drops=tuple(
            _link_drop(d, f"{where}: [[link_drops]]") for d in data.get("link_drops", ())
        ),
        expect_fail=tuple(data.get("expect_fail", ())),
        inject=limited(
            tuple(injection_from(one, f"{where}: [[inject]]") for one in data.get("inject", ()))
        ),
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
                "imu": _plain(node.imu),
                **({"calibration": _calibration_mapping(node)} if node.calibration else {}),
            }
            for role, node in scenario.nodes.items()
        },
        "motion": _plain(scenario.motion) if scenario.motion else {},
        "link_drops": [_plain(drop) for drop in scenario.link_drops],
        "channel": {
            "kind": scenario.channel.kind,
            "attenuation_db": scenario.channel.attenuation_db,
        },
        "expect_fail": list(scenario.expect_fail),
        **({"inject": [one.to_mapping() for one in scenario.inject]} if scenario.inject else {}),
    }


def _node(data: Mapping[str, Any], where: str) -> NodeScenario:
    _check(
        data,
        {
            **{"drift_ppm": (int, float), "start_offset_us": int, "wander": list},
            **{"imu": dict, "calibration": dict},
        },
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
        imu=_imu(data.get("imu", {}), f"{where}.imu"),
        calibration=_calibration(data, f"{where}.calibration"),
    )


def _calibration(node: Mapping[str, Any], where: str) -> StoredCalibration | None:
    if "calibration" not in node:
        return None
    data = node["calibration"]
    _check(data, {"gyro_offset_dps": list}, where)
    offset = data.get("gyro_offset_dps", [0.0, 0.0, 0.0])
    if len(offset) != 3 or not all(
        type(value) in (int, float) and math.isfinite(value) for value in offset
    ):
        raise ScenarioError(f"{where}: gyro_offset_dps needs three numbers: x, y, z")
    x, y, z = map(float, offset)
    return StoredCalibration((x, y, z))


def _calibration_mapping(node: NodeScenario) -> dict[str, Any]:
    assert node.calibration is not None
    return {"gyro_offset_dps": list(node.calibration.gyro_offset_dps)}


def _imu(data: Mapping[str, Any], where: str) -> ImuScenario:
    number = (int, float)
    _check(
        data,
        {
            **dict.fromkeys(("odr_hz", "odr_error", "odr_drift_per_s"), number),
            **dict.fromkeys(("temperature_degc", "temperature_ramp_degc_per_s"), number),
            **dict.fromkeys(("accel_fs_g", "gyro_fs_dps", "rest_s"), int),
            **{"noise": bool, "errors": str, "faults": list},
        },
        where,
    )
    if data.get("errors", "ideal") not in CHIP_ERRORS:
        raise ScenarioError(
            f"{where}: errors = {data['errors']!r} is unknown", "one of: " + ", ".join(CHIP_ERRORS)
        )
    faults = tuple(_imu_fault(fault, f"{where}: faults") for fault in data.get("faults", ()))
    return ImuScenario(**{**data, "faults": faults})


def _imu_fault(data: Mapping[str, Any], where: str) -> ImuFault:
    number = (int, float)
    _check(data, {"kind": str, "at_s": number, "duration_s": number, "rate": number}, where)
    if not {"kind", "at_s"} <= data.keys():
        raise ScenarioError(f"{where}: each fault needs kind and at_s")
    if data["kind"] not in IMU_FAULT_KINDS:
        raise ScenarioError(
            f"{where}: kind = {data['kind']!r} is unknown", "kinds: " + ", ".join(IMU_FAULT_KINDS)
        )
    return ImuFault(**data)


def _motion(data: Mapping[str, Any], where: str) -> Motion:
    number = (int, float)
    known = {"lift": str, "seed": int, "rests": bool, "start_s": number, "handled_s": number}
    _check(data, known, where)
    if "lift" not in data:
        raise ScenarioError(f"{where}: 'lift' is missing", 'add: lift = "bench"')
    motion = Motion(**data)
    if motion.handled_s and not 0.0 < motion.handled_s < motion.start_s:
        raise ScenarioError(
            f"{where}: handled_s = {motion.handled_s:g} is not within 0 and start_s = "
            f"{motion.start_s:g}",
            "the bar is put down before the lift starts",
        )
    return motion


def _link_drop(data: Mapping[str, Any], where: str) -> LinkDrop:
    _check(data, {"at_s": (int, float), "hold_ms": int}, where)
    if "at_s" not in data:
        raise ScenarioError(f"{where}: each needs at_s")
    return LinkDrop(**data)


def _plain(settings: Any) -> dict[str, Any]:
    """A dataclass as TOML could hold it: without what is not set."""
    return {
        name: [_plain(item) for item in value] if isinstance(value, tuple) else value
        for name, value in ((f.name, getattr(settings, f.name)) for f in fields(settings))
        if value is not None
    }


def _check(data: object, allowed: Mapping[str, Any], where: str) -> None:
    if not isinstance(data, Mapping):
        raise ScenarioError(f"{where}: a table is needed, not {shorten(repr(data))}")
    for key, value in data.items():
        if key not in allowed:
            raise ScenarioError(
                printable(f"{where}: unknown key '{shorten(key)}'"),
                "known keys: " + ", ".join(sorted(allowed)),
            )
        if not isinstance(value, allowed[key]) or (
            isinstance(value, bool) and allowed[key] not in (bool, KCONFIG_TYPES)
        ):
            raise ScenarioError(
                printable(f"{where}: '{shorten(key)}' has the wrong type ({type(value).__name__})")
            )
        # Not below: NaN is neither.
        if isinstance(value, int | float) and not abs(value) < NUMBER_MAX:
            raise ScenarioError(printable(f"{where}: '{shorten(key)}' is no finite number of use"))
