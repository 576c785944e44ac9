# SPDX-License-Identifier: Apache-2.0
"""From foreign samples to a recording: batches in serial streams, and nothing that was not there.

The leader's stream holds the leader's batches and, of a second sensor, the copies that it would
have had, on the leader's clock; the follower's stream holds its own. There are no captures, no
clock models, no edges and no EKF frames: what needs them says that it has none.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil import library, synthesis
from hil.exchange.foreign import Imu, Said, samples
from hil.exchange.sheets import RefusedError, Sheet, files, read
from hil.exchange.table import ExchangeError
from hil.fusion.inputs import SUBTICKS_PER_TICK
from hil.imu.scale import ACCEL_MPS2_PER_LSB_PER_G, GYRO_RADPS_PER_LSB_PER_DPS
from hil.recording import Edges, Integrity, Provenance, Recording
from hil.synthesis.draft import Draft
from hil.wire.messages import ROLES, TICK_RATE_HZ

Int = NDArray[np.int64]
Progress = Callable[[float, str], None]

BATCH_MAX: Final = 16
PERIOD_SPAN: Final = 1e-3
"""A batch's period may be so far from the mean one; samples that need more begin a new batch."""
LINK_NS: Final = 5_000_000
"""From a follower's batch to its copy in the leader's stream."""
NS_PER_TICK: Final = 62.5


def silent(share: float, what: str) -> None:
    """No progress bar."""


def imported(
    paths: Sequence[Path], said: Said, name: str, progress: Progress = silent
) -> tuple[Recording, Mapping[str, Any]]:
    """One or two sensors' files, or an export's folder or file, as a recording in memory.

    Args:
        paths: the leader's file and, if there is one, the follower's.

    Returns:
        the recording, and how the files were read, which its provenance has too.

    Raises:
        ExchangeError: a file is refused, or there are more than two sensors.
    """
    sheets: list[Sheet] = []
    for k, path in enumerate(paths):
        progress(0.1 + 0.2 * k, f"reading {path.name}")
        sheets += read(path)
    if len(sheets) > len(ROLES):
        raise RefusedError(
            f"{len(sheets)} sensors in {', '.join(str(p) for p in paths)}: there are two ends of a "
            "bar",
            "name one file for each sensor, or one export",
        )
    found = {role: samples(sheet, said) for role, sheet in zip(ROLES, sheets, strict=False)}
    facts = {
        "files": [_file(file) for path in paths for file in files(path)],
        "sensors": {role: {**imu.facts, **_steps(imu)} for role, imu in found.items()},
    }
    progress(0.5, "encoding")
    return recording(found, facts, name), facts


def save(made: Recording, output: Path) -> Path:
    """Write the recording as the new folder ``output``, whole or not at all.

    Raises:
        RecordingError, ExchangeError: the name is taken or no file name, or it cannot be written.
    """
    try:
        return _save(made, output)
    except OSError as error:
        raise ExchangeError(
            f"{output}: cannot be written: {error.strerror or error}",
            "name a folder in a place that you may write to, with room",
        ) from error


def _save(made: Recording, output: Path) -> Path:
    path = library.target(output.parent, output.name)
    temporary = path.with_name(".importing.mcap")
    try:
        synthesis.save(made, temporary)
        os.replace(temporary, path)
        library.write_readme(made, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        if not path.exists():
            path.parent.rmdir()
        raise
    return path


def _steps(imu: Imu) -> dict[str, float]:
    """The steps of what was rounded: half of each is the largest error."""
    return {
        "gyro_step_radps": float(imu.gyro_fs_dps.max() * GYRO_RADPS_PER_LSB_PER_DPS),
        "accel_step_mps2": float(imu.accel_fs_g.max() * ACCEL_MPS2_PER_LSB_PER_G),
        "time_step_s": 1.0 / TICK_RATE_HZ,
    }


def _file(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {"name": path.name, "sha256": digest, "bytes": path.stat().st_size}


def recording(found: Mapping[str, Imu], facts: Mapping[str, Any], name: str) -> Recording:
    """The recording of the leader's samples and, if there are any, the follower's.

    Args:
        facts: ``files``, each with its name, and ``sensors``: goes into the provenance.
    """
    draft = Draft(frames={}, raw={})
    leader, follower = found["leader"], found.get("follower")
    for role in ("leader", *(["follower"] if follower is not None and follower.own_clock else [])):
        draft.frames[role], draft.raw[role] = [], []
    _send(draft, "leader", "leader", leader, ticks=leader.node_ticks)
    if follower is not None:
        known = follower.leader_ticks >= 0
        if follower.own_clock:
            apart = (follower.leader_ticks - follower.node_ticks)[known]
            later = int(np.median(apart)) if apart.size else 0
            _send(draft, "follower", "follower", follower, ticks=follower.node_ticks, later=later)
        copies = _rows(follower, known)
        if len(copies):
            _send(draft, "leader", "follower", copies, ticks=copies.leader_ticks)
    end_s = max(float(i.node_ticks[-1]) / TICK_RATE_HZ for i in found.values())
    names = ", ".join(file["name"] for file in facts["files"])
    return Recording(
        provenance=Provenance(
            source="import",
            created_utc=datetime.now(UTC).isoformat(timespec="seconds"),
            scenario={
                "name": name,
                "description": f"Imported from {names}.",
                "duration_s": round(end_s, 3),
                "import": facts,
            },
            tools={"hil": version("hil")},
            notes="Imported samples in batches of the protocol; nothing else of it was there.",
        ),
        serial={role: draft.serial(role) for role in draft.frames},
        edges=Edges(
            np.zeros(0, np.int64), np.zeros(0, np.uint8), np.zeros(0, np.uint8), (), 1000.0
        ),
        events=(),
        integrity=Integrity(complete=True),
    )


def _rows(imu: Imu, chosen: NDArray[np.bool_]) -> Imu:
    columns: dict[str, Any] = {
        k: v[chosen] for k, v in vars(imu).items() if isinstance(v, np.ndarray)
    }
    return replace(imu, **columns)


def _send(draft: Draft, sender: str, source: str, imu: Imu, *, ticks: Int, later: int = 0) -> None:
    """Frames of ``imu`` with these times; ``later``: leader's clock less that of the times."""
    fields = np.stack(
        [imu.gyro_fs_dps, imu.accel_fs_g, imu.flags, imu.cdegc, imu.sigma_subticks], axis=1
    )
    differs = np.any(fields[1:] != fields[:-1], axis=1) | (np.diff(imu.index) != 1)
    link_ns = LINK_NS if sender != source else 0
    counts, heads = imu.counts.tolist(), fields.tolist()
    for start, n, period in cut(ticks, np.concatenate([[True], differs])):
        gyro_fs, accel_fs, flags, cdegc, sigma = heads[start]
        last_ns = round((int(ticks[start + n - 1]) + later) * NS_PER_TICK) + link_ns
        draft.add(
            sender,
            max(last_ns, 0),
            "imu_batch",
            source=ROLES[source],
            flags=flags,
            accel_fs_g=accel_fs,
            gyro_fs_dps=gyro_fs,
            sample_index=int(imu.index[start]),
            t_first_ticks_node=int(ticks[start]),
            period_ticks=period,
            t_sigma_ticks=sigma,
            temperature_cdegc=cdegc,
            count=n,
            samples=[
                {"gyro_lsb": row[:3], "accel_lsb": row[3:]} for row in counts[start : start + n]
            ],
        )


def cut(ticks: Int, anew: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """Cut samples into batches whose times come out exactly.

    Sample k of a batch is at first + (k period + 128) // 256, period in 1/256 ticks. A batch goes
    on for as long as one period, near the mean of all, gives every one of its times.

    Args:
        ticks: int64[n], ascending.
        anew: bool[n], where a batch must begin.

    Returns:
        (first row, rows, period) of each batch.
    """
    steps = np.diff(ticks)
    mean = float(np.median(steps)) if steps.size else 1.0
    near = steps[np.abs(steps - mean) < 0.5 * mean]
    mean = SUBTICKS_PER_TICK * (float(near.mean()) if near.size else mean)
    nominal = min(max(round(mean), 1), 0xFFFF_FFFF)
    low0, high0 = math.floor(nominal * (1 - PERIOD_SPAN)), math.ceil(nominal * (1 + PERIOD_SPAN))
    found: list[tuple[int, int, int]] = []
    listed, begins = ticks.tolist(), anew.tolist()
    start = 0
    half = SUBTICKS_PER_TICK // 2
    while start < len(listed):
        low, high, n = low0, high0, 1
        while n < BATCH_MAX and start + n < len(listed) and not begins[start + n]:
            whole = SUBTICKS_PER_TICK * (listed[start + n] - listed[start])
            next_low = max(low, -((half - whole) // n))
            next_high = min(high, -(-(whole + half) // n) - 1)
            if next_low > next_high:
                break
            low, high, n = next_low, next_high, n + 1
        found.append((start, n, min(max(nominal, low), high)))
        start += n
    return found
