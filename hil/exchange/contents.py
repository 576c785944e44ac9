# SPDX-License-Identifier: Apache-2.0
"""From a recording to tables: samples, states, sync, events, repetitions, and the provenance."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import RecordingError
from hil.exchange.table import Column, Contents, Table
from hil.fusion.inputs import SUBTICKS_PER_TICK, runs
from hil.fusion.replay import FIELDS, host_steps
from hil.imu.batches import batches, starts
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, GYRO_RADPS_PER_LSB_PER_DPS
from hil.library import SOURCE_LABELS
from hil.recording import Recording
from hil.reps import of_recording, repetitions, show
from hil.streams import ROLES, frames, rows, table
from hil.wire.codec import physical
from hil.wire.messages import SYNC_STATES, TICK_RATE_HZ, name_of

Int = NDArray[np.int64]
Float = NDArray[np.float64]

XYZ: Final = "xyz"
WXYZ: Final = "wxyz"
UNKNOWN_CDEGC: Final = -32768
"""A temperature that nobody measured: below absolute zero."""
STATE: Final[Sequence[tuple[str, str, str, str, str]]] = (
    ("position_m", "position_{}_m", XYZ, "m", "Leader's sensor, world frame, z up."),
    ("velocity_mps", "velocity_{}_mps", XYZ, "m/s", "Leader's sensor, world frame, z up."),
    ("quaternion", "quaternion_{}", WXYZ, "1", "Body to world."),
    ("accel_bias_mps2", "accel_bias_{}_mps2", XYZ, "m/s^2", "Body frame."),
    ("gyro_bias_radps", "gyro_bias_{}_radps", XYZ, "rad/s", "Body frame."),
)
"""The 16 states: field of the EKF frame, name of its columns, their axes, unit, meaning."""
VARIANCE: Final[Sequence[tuple[str, str, str]]] = (
    ("variance_position_{}_m2", "m^2", "Position."),
    ("variance_velocity_{}_m2ps2", "m^2/s^2", "Velocity."),
    ("variance_attitude_{}_rad2", "rad^2", "Attitude error, a small turn in the world frame."),
    ("variance_accel_bias_{}_m2ps4", "m^2/s^4", "Accelerometer bias."),
    ("variance_gyro_bias_{}_rad2ps2", "rad^2/s^2", "Gyroscope bias."),
)
"""The 15 numbers of the covariance's diagonal, three by three."""


def contents(recording: Recording) -> Contents:
    """Everything of ``recording`` that other programs are given.

    Raises:
        RecordingError: its streams cannot be decoded.
    """
    found = [_imu(recording, role) for role in ROLES]
    ekf, estimator = _ekf(recording)
    tables = [*found, ekf, _sync(recording), _events(recording), _repetitions(recording)]
    return Contents({one.name: one for one in tables if len(one)}, provenance(recording, estimator))


def provenance(recording: Recording, estimator: str) -> dict[str, Any]:
    """Where the tables come from, as plain JSON data."""
    known = recording.provenance
    return {
        "format": "hil-export",
        "version": 1,
        "recording": recording.name,
        "recording_sha256": _sha256(recording),
        "source": known.source,
        "source_label": SOURCE_LABELS[known.source],
        "created_utc": known.created_utc,
        "build_ids": build_ids(recording),
        "estimator": estimator,
        "complete": recording.integrity.complete,
        "problems": list(recording.integrity.problems),
        "scenario": _plain(known.scenario),
        "tools": _plain(known.tools),
        "notes": known.notes,
        "exported_by": f"hil {version('hil')}",
    }


def build_ids(recording: Recording) -> dict[str, str]:
    """Role -> build id of the image that ran, as its manifest says, or else the node itself."""
    found = {}
    for role in ROLES:
        said = recording.provenance.manifests.get(role, {}).get("build_id")
        hello = frames(recording, role, "hello")
        if said is not None:
            found[role] = str(said).removeprefix("0x")
        elif hello.size:
            found[role] = f"{int(hello['build_id'][-1]):016x}"
    return found


def ekf_states(recording: Recording) -> tuple[NDArray[Any], str]:
    """EKF frames of the leader, or else what the host's core makes of the batches.

    Returns:
        the frames, and who computed them; empty where there is neither. The core's outputs have
        the names that the frames have.
    """
    sent = frames(recording, "leader", "ekf_state")
    if sent.size and {"centre_velocity_mps", "centre_height_m"} <= set(sent.dtype.names or ()):
        return sent, "EKF frames of the leader's firmware"
    try:
        outputs = [host_steps(run) for run in runs(recording)]
    except ValueError as error:
        return sent[:0], f"none: the samples cannot be fed to the estimator: {error}"
    if not sum(map(len, outputs)):
        return sent[:0], "none: no EKF frame, and the estimator never ended its alignment"
    made = np.concatenate(outputs)
    names = {"t_ticks_leader": "t_ticks", "step": "step", "flags": "flags", **FIELDS}
    renamed = np.zeros(
        len(made),
        [(name, made.dtype[own].base, made.dtype[own].shape) for name, own in names.items()],
    )
    for name, own in names.items():
        renamed[name] = made[own]
    return renamed, "the host's core in float32, over the recorded samples"


def _sha256(recording: Recording) -> str:
    if recording.path is None or not recording.path.is_file():
        return ""
    with recording.path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value, default=dict))


def _imu(recording: Recording, role: str) -> Table:
    """Every sample that was sent, in the order of sending, and both of its times."""
    sender = role if frames(recording, role, "imu_batch").size else "leader"
    sent = frames(recording, sender, "imu_batch")
    raw = rows(recording, sender, "imu_batch")
    mine = sent["source"] == ROLES.index(role)
    raw = raw[mine[raw["row"]]] if sent.size else raw
    sent = sent[mine]
    count = sent["count"].astype(np.int64)
    batch = np.repeat(np.arange(len(sent)), count)
    within = np.arange(len(batch)) - np.repeat(np.cumsum(count) - count, count)
    ticks = sample_ticks(
        sent["t_first_ticks_node"][batch].astype(np.int64),
        sent["period_ticks"][batch].astype(np.int64),
        within,
    )
    index = sent["sample_index"][batch].astype(np.int64) + within
    seconds = ticks / TICK_RATE_HZ
    own = sender == role
    leader_s = seconds if role == "leader" or not own else _on_leader(recording, index, raw)
    accel = raw["accel_lsb"] * (sent["accel_fs_g"][batch] * ACCEL_MPS2_PER_LSB_PER_G)[:, None]
    gyro = raw["gyro_lsb"] * (sent["gyro_fs_dps"][batch] * GYRO_RADPS_PER_LSB_PER_DPS)[:, None]
    cdegc = sent["temperature_cdegc"][batch].astype(np.int64)
    sigma = sent["t_sigma_ticks"][batch] / (SUBTICKS_PER_TICK * TICK_RATE_HZ)
    columns = (
        Column("sample_index", index, "1", "Counts samples since the sensor was started."),
        Column(
            "t_node_s",
            seconds if own else np.full(len(batch), np.nan),
            "s",
            "Time of the sample on the clock of its own node.",
        ),
        Column(
            "t_leader_s", leader_s, "s", "The same on the leader's clock, as the leader had it."
        ),
        *_axes("gyro_{}_radps", XYZ, gyro, "rad/s", "Angular rate, sensor frame."),
        *_axes("accel_{}_mps2", XYZ, accel, "m/s^2", "Specific force, sensor frame."),
        Column(
            "temperature_degc",
            np.where(cdegc == UNKNOWN_CDEGC, np.nan, cdegc * 0.01),
            "degC",
            "Die temperature.",
        ),
        Column("t_sigma_s", sigma, "s", "Standard error of the time."),
        Column("gyro_fs_dps", sent["gyro_fs_dps"][batch].astype(np.int64), "deg/s", "Full scale."),
        Column("accel_fs_g", sent["accel_fs_g"][batch].astype(np.int64), "g", "Full scale."),
        Column(
            "flags",
            sent["flags"][batch].astype(np.int64),
            "1",
            "Of the sample's batch: 1 hardware time, 2 overrun before, 4 clipped, 8 uncorrected.",
        ),
    )
    return Table(f"imu_{role}", columns, _ns(leader_s))


def sample_ticks(first: Int, period: Int, within: Int) -> Int:
    """int64[n]: time of the sample ``within`` its batch, as the estimator counts it.

    Args:
        first: ticks of the first sample of its batch.
        period: in 1/256 ticks.
    """
    return first + (within * period + SUBTICKS_PER_TICK // 2) // SUBTICKS_PER_TICK


def _on_leader(recording: Recording, index: Int, raw: NDArray[Any]) -> Float:
    """float64[n]: leader's time of the follower's samples; NaN where none arrived with a time.

    The leader's copies since the follower's last start are looked up by their index; one with
    other values is not of the same start.
    """
    found = np.full(len(index), np.nan)
    own = batches(recording, "follower", "follower")
    copy = batches(recording, "leader", "follower")
    if not len(copy) or not len(own):
        return found
    first = max(starts(copy), default=0)
    after = int(copy.count[:first].sum())
    within = np.arange(int(copy.count.sum())) - np.repeat(
        np.cumsum(copy.count) - copy.count, copy.count
    )
    period = np.rint(copy.period_ticks * SUBTICKS_PER_TICK).astype(np.int64)
    ticks = sample_ticks(
        np.repeat(copy.t_first_ticks, copy.count), np.repeat(period, copy.count), within
    )
    timed = np.repeat(copy.has("hardware_time") & (copy.t_first_ticks > 0), copy.count)
    timed[:after] = False
    rows_of_copy = np.flatnonzero(timed)
    since = int(own.count[: max(starts(own), default=0)].sum())
    _, at, of = np.intersect1d(index[since:], copy.sample_index[rows_of_copy], return_indices=True)
    at, of = at + since, rows_of_copy[of]
    same = np.all(own.samples[at] == copy.samples[of], axis=1)
    found[at[same]] = ticks[of[same]] / TICK_RATE_HZ
    return found


def _ekf(recording: Recording) -> tuple[Table, str]:
    states, estimator = ekf_states(recording)
    t_s = states["t_ticks_leader"].astype(np.int64) / TICK_RATE_HZ
    variance = [
        Column(name.format(axis), _f64(states["variance"])[:, 3 * k + n], unit, f"Variance: {text}")
        for k, (name, unit, text) in enumerate(VARIANCE)
        for n, axis in enumerate(XYZ)
    ]
    columns = (
        Column("t_leader_s", t_s, "s", "Time of the state."),
        Column("step", states["step"].astype(np.int64), "1", "Step number."),
        *(
            column
            for field, name, axes, unit, text in STATE
            for column in _axes(name, axes, _f64(states[field]), unit, text)
        ),
        *variance,
        *_axes("innovation_{}", "012", _f64(states["innovation"]), "1", "Last innovation."),
        Column("nis", _f64(states["nis"]), "1", "Normalised innovation squared, last update."),
        Column("gate", _f64(states["gate"]), "1", "Gate that it was held against."),
        Column(
            "flags", states["flags"].astype(np.int64), "1", "Updates that ran: docs/exchange.md."
        ),
        *_axes(
            "centre_velocity_{}_mps",
            XYZ,
            _f64(states["centre_velocity_mps"]),
            "m/s",
            "Of the bar's centre, world frame.",
        ),
        Column("centre_height_m", _f64(states["centre_height_m"]), "m", "Of the bar's centre."),
    )
    return Table("ekf", columns, _ns(t_s)), estimator


def _sync(recording: Recording) -> Table:
    sent = frames(recording, "leader", "sync_state")
    spoken = table(recording, "leader")
    t_s = sent["t_ref_ticks_leader"].astype(np.int64) / TICK_RATE_HZ

    def of(field: str) -> Float:
        return physical(sent, "sync_state", field, spoken)

    columns = (
        Column("t_leader_s", t_s, "s", "Reference instant of the clock model."),
        Column("offset_s", of("offset_ticks") / TICK_RATE_HZ, "s", "Follower less leader then."),
        Column("skew", of("skew"), "1", "Follower's rate over the leader's, less one."),
        Column("residual_rms_s", of("residual_rms_ticks") / TICK_RATE_HZ, "s", "Of the fit."),
        Column("offset_sigma_s", of("offset_sigma_ticks") / TICK_RATE_HZ, "s", "Standard error."),
        Column("window_s", of("window_us") * 1e-6, "s", "Length of the window of pairs."),
        Column("pairs_used", sent["pairs_used"].astype(np.int64), "1", "Pairs in the window."),
        Column("pairs_dropped", sent["pairs_dropped"].astype(np.int64), "1", "Since boot."),
        Column(
            "state",
            texts(name_of(SYNC_STATES, int(n)) for n in sent["state"]),
            "",
            "unsynced, converging, locked or holdover.",
        ),
        Column("generation", sent["generation"].astype(np.int64), "1", "Counts connections."),
    )
    return Table("sync", columns, _ns(t_s))


def bench_less_leader_s(recording: Recording) -> float:
    """Bench clock less leader's clock, to some ms: by the fastest frame; NaN without any.

    A sample's last instant is at most this much before the read that brought it.
    """
    own = batches(recording, "leader", "leader")
    if not len(own):
        return float("nan")
    last = own.t_first_ticks + (own.count - 1) * own.period_ticks
    return float(np.min(own.seen_t_ns_bench / 1e9 - last / TICK_RATE_HZ))


def _events(recording: Recording) -> Table:
    events = recording.events
    bench_s = np.array([e.t_ns_bench for e in events], dtype=np.int64) / 1e9
    leader_s = bench_s - bench_less_leader_s(recording)
    columns = (
        Column("t_bench_s", bench_s, "s", "Bench clock: since the start of the run."),
        Column("t_leader_s", leader_s, "s", "On the leader's clock, to some milliseconds."),
        Column("kind", texts(e.kind for e in events), "", "What happened."),
        Column("node", texts(e.node for e in events), "", "To whom."),
        Column(
            "data",
            texts(json.dumps(_plain(e.data), sort_keys=True) for e in events),
            "",
            "More of it, JSON.",
        ),
    )
    return Table("events", columns, _ns(leader_s))


def _repetitions(recording: Recording) -> Table:
    try:
        found = [repetitions(trace) for trace in of_recording(recording)]
    except RecordingError:
        found = []
    table_rows = list(show.rows([one for one in found if one.repetitions]))
    columns = tuple(
        _repetition_column(name, unit, decimals, table_rows)
        for name, unit, decimals in show.COLUMNS
    )
    start = np.array([row["t_start_s_leader"] for row in table_rows], dtype=np.float64)
    return Table("repetitions", columns, _ns(start))


def _repetition_column(
    name: str, unit: str, decimals: int, table_rows: Sequence[dict[str, Any]]
) -> Column:
    values = [row[name] for row in table_rows]
    if decimals:
        known = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
        return Column(name, known, unit, "Of the bar's centre: docs/estimator.md.")
    if values and isinstance(values[0], str):
        return Column(name, texts(values), "", "See hil reps.")
    return Column(name, np.array(values, dtype=np.int64), "1", "Number.")


def _axes(name: str, axes: str, values: Float, unit: str, text: str) -> Iterator[Column]:
    for n, axis in enumerate(axes):
        yield Column(name.format(axis), values[:, n], unit, text)


def _f64(values: NDArray[Any]) -> Float:
    return np.asarray(values, dtype=np.float64)


def texts(values: Any) -> NDArray[Any]:
    """object[n] of str."""
    listed = [str(v) for v in values]
    found = np.empty(len(listed), dtype=object)
    found[:] = listed
    return found


def _ns(t_s: Float) -> Int:
    """int64[n]: ns, never below 0; a time that is not known is that of the row before."""
    if not len(t_s):
        return np.zeros(0, dtype=np.int64)
    last = np.maximum.accumulate(np.where(np.isfinite(t_s), np.arange(len(t_s)), -1))
    filled = np.where(last >= 0, t_s[last], 0.0)
    return np.maximum(np.rint(filled * 1e9), 0).astype(np.int64)
