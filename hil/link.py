# SPDX-License-Identifier: Apache-2.0
"""The link suite: serial lines, radio link, node identity and health, and the recording itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hil.budget import Conditions, judged
from hil.calibration.measures import REFUSE_DPS
from hil.measure import Measurement
from hil.recording import Recording
from hil.streams import ROLES, decoded, frames, last_value, seen_t_ns_bench
from hil.wire.messages import FAULT_CODES, TARGETS, TICK_RATE_HZ, name_of
from hil.wire.messages import ROLES as ROLE_NUMBERS

SIM_TARGET: Final = TARGETS["sim"]
DELAYS_MIN: Final = 5
"""Through fewer points a line goes nearly anyhow."""


def measure(recording: Recording, conditions: Conditions) -> list[Measurement]:
    """All measurements of the link suite."""
    result = [
        *serial_lines(recording, conditions),
        *radio(recording, conditions),
        *recorded(recording, conditions),
    ]
    for role in ROLES:
        result += [
            hello(recording, role, conditions),
            restarts(recording, role, conditions),
            faults(recording, role, conditions),
            silence(recording, role, conditions),
            line_delay(recording, role, conditions),
        ]
    return result


def serial_lines(recording: Recording, c: Conditions) -> list[Measurement]:
    """Frames lost, corrupted, malformed or repeated on the serial lines; bytes of noise."""
    stats = {role: decoded(recording, role).stats for role in ROLES}
    total = sum(s.frames for s in stats.values())
    silent = [role for role in ROLES if stats[role].frames == 0]
    counts: dict[str, dict[str, int]] = {
        "link.frames_lost": {role: s.lost for role, s in stats.items()},
        "link.frame_crc_errors": {role: s.crc_errors for role, s in stats.items()},
        "link.frames_malformed": {
            role: s.unknown_types + s.bad_lengths for role, s in stats.items()
        },
        "link.frames_duplicated": {role: s.duplicated for role, s in stats.items()},
        "link.noise_bytes": {role: s.noise_bytes for role, s in stats.items()},
    }
    how = f"both serial streams, {total} frames; sequence numbers, CRC and lengths"
    if silent:
        how = f"no frame from the {' nor the '.join(silent)}"
    return [
        judged(
            name,
            math.nan if silent else float(sum(per_role.values())),
            "L2",
            c,
            how,
            details=per_role,
        )
        for name, per_role in counts.items()
    ]


def radio(recording: Recording, c: Conditions) -> list[Measurement]:
    """What the nodes themselves count about the BLE link and their queues."""
    stats = {role: frames(recording, role, "link_stats") for role in ROLES}
    system = {role: frames(recording, role, "system") for role in ROLES}

    def last(of: Mapping[str, Any], *fields: str) -> dict[str, float]:
        return {role: sum(last_value(of[role], f) for f in fields) for role in ROLES}

    crc, events = last(stats, "crc_errors"), last(stats, "events")
    how = "last {} frame of each node; no frame gives no number, which fails"
    result = [
        judged(
            "link.radio_crc_errors",
            sum(crc.values()),
            "L3",
            c,
            how.format("link_stats") + "; limit is per connection event of either node",
            scale=_finite(sum(events.values())),
            details={**crc, "events": sum(events.values())},
        )
    ]
    sources: tuple[tuple[str, Mapping[str, Any], tuple[str, ...], str], ...] = (
        ("link.tx_dropped", stats, ("tx_dropped",), "link_stats"),
        ("link.bad_payloads", stats, ("bad_payloads",), "link_stats"),
        ("link.batches_lost", stats, ("batches_lost",), "link_stats"),
        ("link.uart_dropped", system, ("uart_dropped",), "system"),
    )
    # Each disconnection that the run asked for leaves one gap in the follower's sample index.
    asked = {"link.batches_lost": sum(e.kind == "disconnect" for e in recording.events)}
    for name, of, fields, message in sources:
        per_role = last(of, *fields)
        total = sum(per_role.values())
        total = max(0.0, total - asked.get(name, 0)) if math.isfinite(total) else total
        result.append(judged(name, total, "L4", c, how.format(message), details=per_role))
    return result


def _finite(x: float) -> float:
    return x if math.isfinite(x) else 0.0


def recorded(recording: Recording, c: Conditions) -> list[Measurement]:
    """Whether the file holds the whole run."""
    integrity = recording.integrity
    problems = {"problems": list(integrity.problems)}
    return [
        judged(
            "link.recording_lost_blocks",
            float(integrity.lost_blocks),
            "R1",
            c,
            f"block numbers of {integrity.blocks} blocks read",
            details=problems,
        ),
        judged(
            "link.recording_cut",
            0.0 if integrity.complete else 1.0,
            "R1",
            c,
            "1 when the recording was not closed or does not end as it should",
            details=problems,
        ),
    ]


def hello(recording: Recording, role: str, c: Conditions) -> Measurement:
    """HELLO frames that do not name the role, target, schema and build that should be running."""
    name = f"node.{role}.hello_errors"
    sent = frames(recording, role, "hello")
    if sent.size == 0:
        return judged(name, math.nan, "L5", c, f"the {role} sent no HELLO")
    expected: dict[str, int] = {
        "role": ROLE_NUMBERS[role],
        "tick_rate_hz": TICK_RATE_HZ,
        "schema_hash": int(recording.provenance.schema_hash, 16),
    }
    manifest = recording.provenance.manifests.get(role, {})
    source = recording.provenance.source
    if source in ("sim", "synthetic"):
        expected["target"] = SIM_TARGET
    elif source == "bench":
        expected["target"] = TARGETS["nrf52840dk"]
    build_id = _number(manifest.get("build_id"))
    if build_id is not None:
        expected["build_id"] = build_id
    wrong = np.zeros(sent.size, dtype=bool)
    fields: dict[str, str] = {}
    for field, value in expected.items():
        differs = sent[field] != value
        wrong |= differs
        if np.any(differs):
            fields[field] = f"{int(sent[field][differs][0]):#x}, expected {value:#x}"
    how = f"{sent.size} HELLO frames against role, target, schema and tick rate"
    if build_id is not None:
        how += ", and the manifest's build id"
    elif source == "import":
        how += "; an imported run has no manifest, so the build id is not checked"
    else:
        wrong[:] = True
        fields["build_id"] = "the recording holds no manifest to check it against"
    return judged(name, float(np.sum(wrong)), "L5", c, how, details=fields)


def _number(value: Any) -> int | None:
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int):
        return value
    try:
        return int(str(value), 16)
    except ValueError:
        return None


def restarts(recording: Recording, role: str, c: Conditions) -> Measurement:
    """Boots beyond the first, less the resets that the run asked for."""
    sent = frames(recording, role, "hello")
    name = f"node.{role}.restarts"
    if sent.size == 0:
        return judged(name, math.nan, "L1", c, f"the {role} sent no HELLO")
    uptime = sent["uptime_ms"].astype(np.int64)
    planned = sum(e.kind == "reset" and e.node == role for e in recording.events)
    boots = int(np.sum(np.diff(uptime) < 0))
    return judged(
        name,
        float(max(0, boots - planned)),
        "L1",
        c,
        f"uptime in {sent.size} HELLO frames; {planned} resets were asked for",
        details={"reset_reason": int(sent["reset_reason"][-1])},
    )


def faults(recording: Recording, role: str, c: Conditions) -> Measurement:
    """FAULT frames of a node."""
    sent = frames(recording, role, "fault")
    made = [FAULT_CODES[name] for name in made_to_fault(recording, role)]
    of_scenario = np.isin(sent["code"], made)
    sent = sent[~of_scenario]
    heard = decoded(recording, role).stats.frames
    shown = [
        {
            "code": name_of(FAULT_CODES, f["code"]),
            "argument": int(f["argument"]),
            "detail": bytes(f["detail"]).split(b"\0")[0].decode("ascii", "replace"),
        }
        for f in sent[:8]
    ]
    return judged(
        f"node.{role}.faults",
        float(sent.size) if heard else math.nan,
        "L1",
        c,
        f"FAULT frames among {heard} frames of the {role}"
        + (f"; {int(of_scenario.sum())} more that the scenario is there for" if made else ""),
        details={"first": shown},
    )


def made_to_fault(recording: Recording, role: str) -> list[str]:
    """FAULT codes that a node must send because of what its scenario stored in its flash."""
    node = recording.provenance.scenario.get("nodes", {}).get(role, {})
    offset_dps = node.get("calibration", {}).get("gyro_offset_dps", [0.0, 0.0, 0.0])
    refused = float(np.linalg.norm(offset_dps)) > REFUSE_DPS
    return ["cal_bias_refused"] if refused else []


def silence(recording: Recording, role: str, c: Conditions) -> Measurement:
    """Longest time without a HELLO, which each node sends every two seconds, up to the end."""
    name = f"node.{role}.silence_s"
    sent = frames(recording, role, "hello")
    if sent.size == 0:
        return judged(name, math.nan, "L6", c, f"the {role} sent no HELLO")
    end_ns = max(
        (int(s.block_t_ns_bench[-1]) for s in recording.serial.values() if s.block_t_ns_bench.size),
        default=0,
    )
    if c.simulated:
        end_ns = max(end_ns, int(1e9 * recording.provenance.scenario.get("duration_s", 0.0)))
    seen = np.append(seen_t_ns_bench(recording, role, sent), end_ns)
    return judged(
        name,
        float(np.max(np.diff(seen), initial=0.0)) / 1e9,
        "L6",
        c,
        f"longest gap between {sent.size} HELLO frames, and from the last to the end of the run",
    )


def line_delay(recording: Recording, role: str, c: Conditions) -> Measurement:
    """How much the time from a SYSTEM frame's stamp to its arrival varies.

    The node's crystal runs on its own, so a line through the delays is taken out of each boot.
    What is left are bytes that came late, or a host's clock that jumped.
    """
    name = f"node.{role}.line_delay_s"
    sent = frames(recording, role, "system")
    if recording.provenance.source == "import":
        how = "an imported stream has no times of its own"
        return judged(name, None, "L8", c, how)
    sent_s = sent["t_ticks_node"].astype(np.float64) / TICK_RATE_HZ
    delay_s = seen_t_ns_bench(recording, role, sent) / 1e9 - sent_s
    boots = np.split(np.arange(sent_s.size), np.flatnonzero(np.diff(sent_s) <= 0) + 1)
    ranges = [
        float(np.ptp(delay_s[boot] - np.polyval(np.polyfit(sent_s[boot], delay_s[boot], 1), t)))
        for boot in boots
        if boot.size >= DELAYS_MIN
        for t in (sent_s[boot],)
    ]
    return judged(
        name,
        max(ranges, default=math.nan),
        "L8",
        c,
        f"range of arrival minus own stamp of {sent.size} SYSTEM frames, about a line for the "
        f"node's crystal, within each of {len(ranges)} boots",
    )
