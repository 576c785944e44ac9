# SPDX-License-Identifier: Apache-2.0
"""From a plan to a draft: the frames that two sound nodes would send, and the edges they make."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hil.synthesis.calibration import calibration
from hil.synthesis.clock import Clock
from hil.synthesis.draft import Draft
from hil.synthesis.estimator import REPORT_EVENTS, State, locked, states
from hil.synthesis.imu import imu
from hil.synthesis.plan import Plan
from hil.synthesis.radio import CONNECT_S, Events, events
from hil.wire.messages import ROLES, TARGETS, TICK_RATE_HZ, schema_hash

SETTLED_S = 0.3
UART_MS = 2


def draft(plan: Plan) -> Draft:
    """Everything that happens in a run without faults, except those that the plan itself has."""
    result = Draft()
    clocks = {role: Clock(plan, role) for role in ROLES}
    table, result.edges = events(plan)
    models = states(plan, table)
    _housekeeping(plan, result, clocks, table)
    _captures(plan, result, table)
    _pairs(plan, result, table)
    _models(result, models, table)
    _pulses(plan, result, clocks, models)
    imu(plan, result, clocks, models)
    calibration(plan, result, clocks)
    _wrap(plan, result)
    return result


def _every(period_s: float, plan: Plan, start_s: float) -> Iterator[float]:
    """Instants, true us, from ``start_s`` to the end of the run."""
    count = int((plan.duration_s - start_s) / period_s) + 1
    return (1e6 * (start_s + period_s * i) for i in range(count))


def _housekeeping(plan: Plan, out: Draft, clocks: dict[str, Clock], table: Events) -> None:
    for role, number in ROLES.items():
        boot_us = plan.node(role).start_offset_us
        for true_us in _every(2.0, plan, 0.1):
            out.add(
                role,
                true_us * 1e3,
                "hello",
                protocol_version=1,
                role=number,
                target=TARGETS["sim"],
                schema_hash=schema_hash(),
                build_id=plan.build_id[role],
                device_id=0x1000 + number,
                reset_reason=0,
                tick_rate_hz=TICK_RATE_HZ,
                conn_interval_us=plan.conn_interval_us,
                uptime_ms=int((true_us - boot_us) / 1e3),
            )
        received = table.l_ok if role == "leader" else table.f_ok
        for true_us in _every(1.0, plan, CONNECT_S + 0.5):
            seen = table.true_us <= true_us
            ticks = int(clocks[role].ticks(true_us))
            out.add(
                role,
                true_us * 1e3,
                "link_stats",
                t_ticks_node=ticks,
                connected=1,
                phy=plan.phy,
                rssi_dbm=-50,
                mtu=247,
                conn_interval_us=plan.conn_interval_us,
                events=int(np.sum(seen)),
                crc_errors=int(np.sum(seen & ~received)),
                disconnects=0,
                batches_sent=0,
                batches_received=0,
                batches_lost=0,
                batches_late=0,
                tx_dropped=0,
                bad_payloads=0,
            )
            out.add(
                role,
                true_us * 1e3 + 1e6,
                "system",
                t_ticks_node=ticks,
                cpu_load_permille=200,
                stack_free_min_b=512,
                heap_used_b=0,
                heap_peak_b=0,
                uart_dropped=0,
                timer_wraps=ticks >> 32,
            )
            out.text(role, true_us * 1e3 + 2e6, f"t_us,{int(true_us)},role,{role}")


def _captures(plan: Plan, out: Draft, table: Events) -> None:
    for role, tx, rx, ok in (
        ("leader", table.l_tx, table.l_rx, table.l_ok),
        ("follower", table.f_tx, table.f_rx, table.f_ok),
    ):
        # A late stamp can only be told once it has been taken.
        sent_ns = (table.true_us + 1500.0 + max(plan.capture_late_us)) * 1e3
        for i in np.flatnonzero(ok):
            out.add(
                role,
                sent_ns[i],
                "sync_capture",
                event=int(table.event[i]),
                generation=int(table.generation[i]),
                tx_end_ticks_node=int(tx[i]),
                rx_end_ticks_node=int(rx[i]),
            )


def _pairs(plan: Plan, out: Draft, table: Events) -> None:
    delay_us = REPORT_EVENTS * plan.conn_interval_us + 300
    for i in np.flatnonzero(table.paired):
        out.add(
            "leader",
            (table.true_us[i] + delay_us) * 1e3,
            "sync_pair",
            event=int(table.event[i]),
            generation=int(table.generation[i]),
            flags=1,
            tx_end_ticks_leader=int(table.l_tx[i]),
            rx_end_ticks_leader=int(table.l_rx[i]),
            tx_end_ticks_follower=int(table.f_tx[i]),
            rx_end_ticks_follower=int(table.f_rx[i]),
        )


def _models(out: Draft, models: list[State], table: Events) -> None:
    for m in models:
        out.add(
            "leader",
            m.true_us * 1e3,
            "sync_state",
            t_ref_ticks_leader=m.t_ref,
            offset_ticks=round(m.offset * 256),
            skew=round(m.skew * 1e12),
            residual_rms_ticks=round(m.rms * 256),
            offset_sigma_ticks=round(m.rms * 512 / math.sqrt(m.pairs)),
            window_us=2_000_000,
            pairs_used=m.pairs,
            pairs_dropped=0,
            state=m.state,
            generation=m.generation,
        )


def _pulses(plan: Plan, out: Draft, clocks: dict[str, Clock], models: list[State]) -> None:
    first = next((m for m in models if m.state == 2), None)
    edges: dict[str, list[int]] = {role: [] for role in ROLES}
    if first is not None:
        rng = np.random.default_rng(plan.seed + 1)
        period = round(plan.pulse_period_s * TICK_RATE_HZ)
        index = math.ceil((first.t_ref + SETTLED_S * TICK_RATE_HZ) / period)
        while True:
            scheduled = index * period
            true_us = float(clocks["leader"].true_us(scheduled))
            if true_us > (plan.duration_s - 0.05) * 1e6:
                break
            model = locked(models, true_us - plan.pulse_lead_s * 1e6)
            compare = {"leader": scheduled}
            if model is not None:
                error = plan.pulse_error_ticks * int(rng.choice((-1, 1)))
                compare["follower"] = round(model.follower_ticks(scheduled)) + error
            for role, ticks in compare.items():
                edges[role].append(clocks[role].compare_edge_ns(ticks))
                out.add(
                    role,
                    (true_us + UART_MS * 1e3) * 1e3,
                    "pulse",
                    index=index,
                    scheduled_ticks_leader=scheduled,
                    compare_ticks_node=ticks,
                    captured_ticks_node=0,
                    flags=0,
                )
            index += 1
    for role in ROLES:
        out.edges[f"{role}.pulse"] = np.array(edges[role], dtype=np.int64)


def _wrap(plan: Plan, out: Draft) -> None:
    """Cut the nodes' own stamps to the bits that the plan's TIMER is extended to."""
    if plan.timer_bits >= 64:
        return
    mask = (1 << plan.timer_bits) - 1
    for role in ROLES:
        for frame in out.frames[role]:
            for field, value in frame.values.items():
                if field.endswith("_ticks_node"):
                    frame.values[field] = value & mask
