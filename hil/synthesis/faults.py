# SPDX-License-Identifier: Apache-2.0
"""Faults of a synthetic run. Each must be caught by a check; the tests hold the table of which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from hil.recording import Integrity
from hil.synthesis.calibration import CALIBRATION_FAULTS
from hil.synthesis.draft import Draft, Fate, Frame
from hil.synthesis.imu_faults import IMU_FAULTS
from hil.synthesis.plan import Plan
from hil.wire.messages import IMU_FLAGS, PULSE_FLAGS, SYNC_STATES, TICK_RATE_HZ

TICKS_PER_US: Final = TICK_RATE_HZ // 1_000_000
SECOND: Final = TICK_RATE_HZ


def _same_plan(plan: Plan) -> Plan:
    return plan


def _same_draft(_: Draft) -> None:
    return None


@dataclass(frozen=True)
class Fault:
    """What goes wrong, and where: in the nodes' behaviour, or in what they send."""

    meaning: str
    plan: Callable[[Plan], Plan] = _same_plan
    draft: Callable[[Draft], None] = _same_draft


def _fate(role: str, name: str, fate: Fate, which: slice) -> Callable[[Draft], None]:
    def change(draft: Draft) -> None:
        for frame in draft.of(role, name)[which]:
            frame.fate = fate

    return change


def _set(role: str, name: str, which: slice, /, **values: Any) -> Callable[[Draft], None]:
    def change(draft: Draft) -> None:
        for frame in draft.of(role, name)[which]:
            frame.values.update(values)

    return change


def _add(role: str, name: str, which: slice, /, **values: float) -> Callable[[Draft], None]:
    def change(draft: Draft) -> None:
        for frame in draft.of(role, name)[which]:
            for field, step in values.items():
                frame.values[field] = round(frame.values[field] + step)

    return change


def _without(
    role: str, name: str, wanted: Callable[[Frame], bool] = lambda _: True
) -> Callable[[Draft], None]:
    return lambda draft: draft.remove(role, lambda f: f.name == name and wanted(f))


def _both(*changes: Callable[[Draft], None]) -> Callable[[Draft], None]:
    def change(draft: Draft) -> None:
        for one in changes:
            one(draft)

    return change


def _swap_pairs(draft: Draft) -> None:
    """Give some pairs the follower's stamps of the event after."""
    pairs = draft.of("leader", "sync_pair")[500:521]
    for this, following in pairwise(pairs):
        for field in ("tx_end_ticks_follower", "rx_end_ticks_follower"):
            this.values[field] = following.values[field]


def _shift_pairs(draft: Draft) -> None:
    """Both the follower's own captures and the leader's pairs are late, in one direction."""
    late = 8 * TICKS_PER_US
    _add("follower", "sync_capture", slice(500, 520), rx_end_ticks_node=late)(draft)
    _add("leader", "sync_pair", slice(500, 520), rx_end_ticks_follower=late)(draft)


def _all_captures_late(draft: Draft) -> None:
    """Every capture of the follower is late by the same time: nothing but an edge can tell."""
    late = 2 * TICKS_PER_US
    stamps = ("tx_end_ticks_node", "rx_end_ticks_node")
    draft.each("follower", "sync_capture", lambda v: v.update({s: v[s] + late for s in stamps}))
    pair = ("tx_end_ticks_follower", "rx_end_ticks_follower")
    draft.each("leader", "sync_pair", lambda v: v.update({s: v[s] + late for s in pair}))
    draft.each(
        "leader", "sync_state", lambda v: v.update(offset_ticks=v["offset_ticks"] + late * 256)
    )
    draft.each(
        "follower", "pulse", lambda v: v.update(compare_ticks_node=v["compare_ticks_node"] + late)
    )
    draft.edges["follower.pulse"] = draft.edges["follower.pulse"] + late * 125 // 2


def _drop_outliers(draft: Draft) -> None:
    for frame in draft.of("leader", "sync_pair")[::10]:
        frame.values["flags"] = 0


def _lose_edges(draft: Draft) -> None:
    edges = draft.edges["follower.pulse"]
    draft.edges["follower.pulse"] = np.delete(edges, [edges.size // 2])


def _late_edges(draft: Draft) -> None:
    edges = draft.edges["follower.pulse"].copy()
    edges[edges.size // 2 :] += 3_000
    draft.edges["follower.pulse"] = edges


def _batches(draft: Draft, sender: str, source: int) -> list[Frame]:
    return [f for f in draft.of(sender, "imu_batch") if f.values["source"] == source]


STREAMS: Final = (("leader", 0), ("follower", 1), ("leader", 1))


def _swap_batches(draft: Draft) -> None:
    """Two neighbouring batches change places in each stream."""
    for sender, source in STREAMS:
        a, b = _batches(draft, sender, source)[50:52]
        a.values, b.values = b.values, a.values


def _repeat_batch(draft: Draft) -> None:
    """In each stream a batch is sent twice, with two sequence numbers."""
    for sender, source in STREAMS:
        frame = _batches(draft, sender, source)[40]
        draft.frames[sender].append(Frame(frame.t_ns + 1, frame.name, dict(frame.values)))


def _overrun(draft: Draft) -> None:
    for sender, source in STREAMS:
        _batches(draft, sender, source)[60].values["flags"] |= IMU_FLAGS["overrun_before"]


def _drop_batches(draft: Draft) -> None:
    for sender, source in STREAMS[:2]:
        lost = _batches(draft, sender, source)[30]
        draft.frames[sender] = [f for f in draft.frames[sender] if f is not lost]


def _copies(draft: Draft) -> list[Frame]:
    return _batches(draft, "leader", 1)


def _raw_times(draft: Draft) -> None:
    """The leader passes the follower's times on without converting them."""
    own = {f.values["sample_index"]: f.values for f in draft.of("follower", "imu_batch")}
    for frame in _copies(draft):
        frame.values["t_first_ticks_node"] = own[frame.values["sample_index"]]["t_first_ticks_node"]


def _stale_batches(draft: Draft) -> None:
    for frame in _copies(draft):
        frame.t_ns += 400_000_000


def _alter_sample(draft: Draft) -> None:
    frame = _copies(draft)[60]
    samples = [dict(s) for s in frame.values["samples"]]
    samples[3]["gyro_lsb"] = [0, 0, 0]
    frame.values["samples"] = samples


def _lose_copy(draft: Draft) -> None:
    lost = _copies(draft)[60]
    draft.remove("leader", lambda f: f is lost)


def _cut_role(role: str) -> Callable[[Draft], None]:
    def change(draft: Draft) -> None:
        end = max(f.t_ns for f in draft.frames[role])
        draft.remove(role, lambda f: f.t_ns > end - 5e9)

    return change


def _integrity(integrity: Integrity) -> Callable[[Draft], None]:
    def change(draft: Draft) -> None:
        draft.integrity = integrity

    return change


def _silent_mid_run(draft: Draft) -> None:
    _without("leader", "sync_state", lambda f: 7e9 < f.t_ns < 10e9)(draft)


def _noise(draft: Draft) -> None:
    draft.raw["leader"].append((3_000_000_000, b"\x81\x92\xa3\xb4"))


def _slow_lock(draft: Draft) -> None:
    for frame in draft.of("leader", "sync_state"):
        if frame.t_ns < 9e9:
            frame.values["state"] = SYNC_STATES["converging"]


def _unlock(draft: Draft) -> None:
    for frame in draft.of("leader", "sync_state"):
        if 8e9 < frame.t_ns < 10e9:
            frame.values["state"] = SYNC_STATES["holdover"]


def _fault_frame(draft: Draft) -> None:
    detail = list(b"imu silent".ljust(48, b"\0"))
    for role in draft.frames:
        draft.add(role, 5e9, "fault", t_ticks_node=5 * SECOND, code=18, argument=0, detail=detail)


def _restart(draft: Draft) -> None:
    for role in draft.frames:
        _set(role, "hello", slice(4, 5), uptime_ms=5)(draft)


def _bare_counter(plan: Plan) -> Plan:
    return replace(
        plan,
        timer_bits=32,
        leader=replace(plan.leader, timer_start_us=-262_000_000),
        follower=replace(plan.follower, timer_start_us=-264_000_000),
    )


FAULTS: Final[dict[str, Fault]] = {
    "wrong_skew_sign": Fault(
        "the estimator's skew has the wrong sign", plan=lambda p: replace(p, skew_sign=-1)
    ),
    "late_captures": Fault(
        "the follower's RX stamps are taken by software, 20 to 60 us late",
        plan=lambda p: replace(p, capture_late_us=(20, 27, 35, 44, 60)),
    ),
    "some_captures_late": Fault("20 RX stamps of the follower are 8 us late", draft=_shift_pairs),
    "all_captures_late": Fault(
        "all stamps of the follower are 2 us late", draft=_all_captures_late
    ),
    "swapped_pair": Fault("pairs hold the follower's stamps of another event", draft=_swap_pairs),
    "pairs_dropped": Fault("a tenth of the pairs is dropped as outliers", draft=_drop_outliers),
    "no_pairs": Fault("the leader reports no pair", draft=_without("leader", "sync_pair")),
    "few_pairs": Fault(
        "the leader pairs every other event only",
        draft=_without("leader", "sync_pair", lambda f: f.values["event"] % 2 == 0),
    ),
    "no_states": Fault("the leader reports no model", draft=_without("leader", "sync_state")),
    "states_pause": Fault("no model for three seconds", draft=_silent_mid_run),
    "never_locked": Fault("the model never locks", plan=lambda p: replace(p, lock_after_s=3600.0)),
    "slow_lock": Fault("the model takes eight seconds to lock", draft=_slow_lock),
    "lock_lost": Fault("two seconds of holdover", draft=_unlock),
    "model_jitter": Fault(
        "the reported offset jumps by 1 us to and fro",
        draft=_both(
            _add("leader", "sync_state", slice(0, None, 2), offset_ticks=8 * 256),
            _add("leader", "sync_state", slice(1, None, 2), offset_ticks=-8 * 256),
        ),
    ),
    "pulse_jitter": Fault(
        "the follower programs its pulses 1 us off", plan=lambda p: replace(p, pulse_error_ticks=16)
    ),
    "missing_pulses": Fault(
        "the follower leaves out three pulses",
        draft=_without("follower", "pulse", lambda f: f.values["index"] % 25 == 0),
    ),
    "no_pulses": Fault(
        "neither node reports a pulse",
        draft=_both(_without("leader", "pulse"), _without("follower", "pulse")),
    ),
    "late_pulses": Fault(
        "the follower is too late for ten pulses",
        draft=_set("follower", "pulse", slice(30, 40), flags=PULSE_FLAGS["late"]),
    ),
    "lost_edge": Fault("one pulse leaves no edge on the follower's pin", draft=_lose_edges),
    "late_edges": Fault("the follower's pin follows COMPARE by 3 us", draft=_late_edges),
    "coarse_analyser": Fault(
        "the analyser resolves 10 us only", draft=lambda d: setattr(d, "edge_resolution_ns", 1e4)
    ),
    "wrap_not_extended": Fault(
        "the 64-bit ticks are the bare 32-bit counter, which wraps during the run",
        plan=_bare_counter,
    ),
    "other_phy_delay": Fault(
        "the chain delay is that of 1M on a 2M link", plan=lambda p: replace(p, delay_us=9.0)
    ),
    "reconnect": Fault("the link is lost once", plan=lambda p: replace(p, reconnect_at_s=9.0)),
    "lost_frames": Fault(
        "three frames are lost on the line",
        draft=_fate("leader", "sync_pair", "lost", slice(60, 63)),
    ),
    "corrupted_frame": Fault(
        "a byte is changed on the line",
        draft=_fate("follower", "sync_capture", "corrupted", slice(70, 71)),
    ),
    "repeated_frame": Fault(
        "a frame arrives twice", draft=_fate("leader", "sync_pair", "repeated", slice(60, 61))
    ),
    "short_frame": Fault(
        "a frame is a byte too short", draft=_fate("leader", "sync_pair", "cut", slice(60, 61))
    ),
    "noise": Fault("bytes that are neither frame nor text", draft=_noise),
    "dropped_batch": Fault("each node leaves a batch out", draft=_drop_batches),
    "repeated_batch": Fault("a batch is sent twice", draft=_repeat_batch),
    "swapped_batches": Fault("two batches change places", draft=_swap_batches),
    "overrun": Fault("a FIFO overran before a batch", draft=_overrun),
    "no_batches": Fault("the follower's IMU is silent", draft=_without("follower", "imu_batch")),
    "wrong_period": Fault(
        "the reported period is 100 ppm off",
        draft=lambda d: d.each(
            "leader",
            "imu_batch",
            lambda v: v.update(period_ticks=round(v["period_ticks"] * 1.0001)),
        ),
    ),
    "wrong_rate": Fault(
        "the IMU runs a fifth slow",
        plan=lambda p: replace(p, leader=replace(p.leader, imu_rate_hz=166.0)),
    ),
    "batch_time_jitter": Fault(
        "some batch times are 10 us off",
        draft=_add("leader", "imu_batch", slice(90, None, 7), t_first_ticks_node=160),
    ),
    "copy_lost": Fault("a batch does not reach the leader", draft=_lose_copy),
    "copy_altered": Fault("a sample changes on its way to the leader", draft=_alter_sample),
    "copy_not_converted": Fault("the leader passes times on unconverted", draft=_raw_times),
    "copy_stale": Fault("batches wait 400 ms at the leader", draft=_stale_batches),
    "wrong_role": Fault(
        "the follower runs the leader's image", draft=_set("follower", "hello", slice(None), role=0)
    ),
    "wrong_build_id": Fault(
        "the leader runs another build", draft=_set("leader", "hello", slice(None), build_id=1)
    ),
    "wrong_schema": Fault(
        "the leader speaks another protocol table",
        draft=_set("leader", "hello", slice(None), schema_hash=1),
    ),
    "restart": Fault("both nodes boot again", draft=_restart),
    "fault_frame": Fault("both nodes report a fault", draft=_fault_frame),
    "follower_dies": Fault(
        "the follower falls silent five seconds early", draft=_cut_role("follower")
    ),
    "leader_dies": Fault("the leader falls silent five seconds early", draft=_cut_role("leader")),
    "radio_crc": Fault(
        "packets arrive corrupted on a channel that is meant to be ideal",
        draft=_set("leader", "link_stats", slice(5, None), crc_errors=12),
    ),
    "queue_full": Fault(
        "the link's queue overflowed",
        draft=_set("follower", "link_stats", slice(5, None), tx_dropped=2),
    ),
    "refused_payload": Fault(
        "the leader refused a payload",
        draft=_set("leader", "link_stats", slice(5, None), bad_payloads=1),
    ),
    "batches_lost": Fault(
        "the leader counts a gap",
        draft=_set("leader", "link_stats", slice(5, None), batches_lost=1),
    ),
    "line_full": Fault(
        "the node dropped frames before the line",
        draft=_set("follower", "system", slice(5, None), uart_dropped=7),
    ),
    "lost_blocks": Fault(
        "blocks are missing from the file", draft=_integrity(Integrity(True, (), 2, 100))
    ),
    "cut_file": Fault(
        "the file ends early", draft=_integrity(Integrity(False, ("cut after 1000 bytes",), 0, 90))
    ),
    **{
        name: Fault(meaning, draft=change)
        for name, (meaning, change) in (IMU_FAULTS | CALIBRATION_FAULTS).items()
    },
}
