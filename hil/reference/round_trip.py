# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N806 (matrices carry the capital letters of the equations)
"""The round trip: at the bottom of each touch-and-go repetition the bar is back where it was.

Boundary detection is causal. Once the centre of the bar has come down by ``turn_travel_m`` from
its last high, the detector is armed; the last upward zero crossing of the estimated vertical
velocity is the candidate; once the bar rises faster than ``turn_speed_mps`` the candidate is
confirmed, some 30-50 ms late. A velocity error e moves the candidate by e / a, a
few ms, and the height there by e^2 / 2a, micrometres: the height does not care.

The first boundary sets an anchor: height is only ever relative, so from there on the height
error is *defined* relative to the height at which the bar turned. Its variance becomes the
spread of one turn and its correlations vanish. Each later boundary near an anchor measures

    0 = h(t_c) - h_anchor + n,   h = p_z - (R r_L)_z,

where the error at the crossing follows from the present one: dh(t_c) = dh - (t - t_c) dv_z.
A boundary far from every anchor, or reached over a descent of another length (which is short,
and so well measured, whatever the drift), is another kind of turn (the catch, the dip, the
floor). It becomes an anchor of its own; its variance at birth is carried in its R from then on.
When the height is less certain than half the distance that tells turns apart, a return to the
only anchor there is still counts, with ``height_doubt_m`` of spread added, if it is within
``height_far_m`` and ``doubt_gate``: that is what saves a set of slow eccentrics. The descent's
length is then as uncertain as the height, and is compared with that much room. With several
anchors, or beyond ``height_lost_m``, all are dropped.

A bar that comes down at 0.1 m/s seems to stand still once the velocity has drifted by as much, and
there is neither a descent nor a crossing. So in doubt no descent is asked for, and a rise
through ``turn_speed_mps`` at more than ``turn_accel_mps2`` counts as the turn itself, whose height
it misses by v^2 / 2a, millimetres. A correction moves height and velocity at once, which is no
motion: the detector begins anew after each.

Nothing is claimed about the velocity at the crossing, which is zero by the very definition of
the crossing; the velocity is informed through its correlation with the height.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hil.reference.attitude import FloatArray
from hil.reference.params import Params
from hil.reference.state import PZ, T_, V_, Nav

MAX_ANCHORS = 4


@dataclass
class RoundTrip:
    """Memory of the detector and the anchor."""

    armed: bool = False
    h_high_m: float = -1e9
    v_last_mps: float = 0.0
    h_last_m: float = 0.0
    t_last_s: float = 0.0
    t_cross_s: float = -1.0
    h_cross_m: float = 0.0
    travel_m: float = 0.0
    doubt: bool = False
    count: int = 0
    next: int = 0
    anchor_m: FloatArray = field(default_factory=lambda: np.zeros(MAX_ANCHORS))
    anchor_travel_m: FloatArray = field(default_factory=lambda: np.zeros(MAX_ANCHORS))
    anchor_variance: FloatArray = field(default_factory=lambda: np.zeros(MAX_ANCHORS))

    def begin_descent(self) -> None:
        """Watch for a descent from here on."""
        self.armed = False
        self.t_cross_s = -1.0
        self.h_high_m = -1e9


def in_doubt(params: Params, nav: Nav) -> bool:
    """Is the height too uncertain to tell turns apart?"""
    return bool(nav.P[PZ, PZ] > (0.5 * params.height_jump_m) ** 2)


def boundary(
    params: Params, nav: Nav, trip: RoundTrip, t_s: float, *, h_m: float, v_mps: float
) -> bool:
    """Feed height and vertical velocity of the centre; True when a boundary is confirmed."""
    doubt = trip.count == 1 and in_doubt(params, nav)
    confirmed = False
    trip.h_high_m = max(trip.h_high_m, h_m)
    if trip.h_high_m - h_m > params.turn_travel_m or (doubt and v_mps <= params.turn_speed_mps):
        trip.armed = True
    if trip.armed:
        if trip.v_last_mps <= 0.0 < v_mps:
            u = -trip.v_last_mps / (v_mps - trip.v_last_mps)
            trip.t_cross_s = trip.t_last_s + u * (t_s - trip.t_last_s)
            trip.h_cross_m = trip.h_last_m + u * (h_m - trip.h_last_m)
            trip.travel_m = trip.h_high_m - trip.h_cross_m
        if v_mps > params.turn_speed_mps:
            confirmed = trip.t_cross_s >= 0.0 and t_s - trip.t_cross_s <= params.turn_confirm_s
            if (
                not confirmed
                and doubt
                and v_mps - trip.v_last_mps > params.turn_accel_mps2 * (t_s - trip.t_last_s)
            ):
                trip.t_cross_s, trip.h_cross_m = t_s, h_m
                trip.travel_m = trip.h_high_m - h_m
                confirmed = True
            trip.armed = False
            trip.h_high_m = h_m
    trip.v_last_mps, trip.h_last_m, trip.t_last_s = v_mps, h_m, t_s
    return confirmed


def associate(params: Params, nav: Nav, trip: RoundTrip) -> int:
    """Index of the anchor that the candidate returns to; -1 when there is none.

    Drops all anchors when the height has become too uncertain to tell them apart.
    """
    sigma = float(np.sqrt(nav.P[PZ, PZ]))
    trip.doubt = in_doubt(params, nav)
    if sigma > params.height_lost_m or (trip.doubt and trip.count > 1):
        trip.count = trip.next = 0
    if trip.doubt and trip.count == 1:
        distance = abs(trip.anchor_m[0] - trip.h_cross_m)
        spread2 = nav.P[PZ, PZ] + params.height_doubt_m**2
        if (
            not _alike(params, trip, 0, 2.0 * sigma)
            or distance > params.height_far_m
            or distance**2 > params.doubt_gate * spread2
        ):
            trip.count = trip.next = 0
        return trip.count - 1
    best = -1
    for i in range(trip.count):
        distance = abs(trip.anchor_m[i] - trip.h_cross_m)
        if (
            distance <= params.height_jump_m
            and _alike(params, trip, i, 0.0)
            and (best < 0 or distance < abs(trip.anchor_m[best] - trip.h_cross_m))
        ):
            best = i
    return best


def _alike(params: Params, trip: RoundTrip, i: int, drift_m: float) -> bool:
    """Was anchor ``i`` reached over a descent of about the same length, give or take the drift?"""
    longer = max(trip.travel_m, float(trip.anchor_travel_m[i]))
    apart = abs(trip.travel_m - float(trip.anchor_travel_m[i]))
    return apart <= 0.05 + params.travel_share * longer + drift_m


def add_anchor(params: Params, nav: Nav, trip: RoundTrip) -> None:
    """The candidate becomes an anchor; the first one also becomes the origin of the height."""
    if trip.count == 0:
        nav.P[PZ, :] = 0.0
        nav.P[:, PZ] = 0.0
        nav.P[PZ, PZ] = params.height_sigma_m**2
        variance = 0.0
    else:
        variance = float(nav.P[PZ, PZ])
    trip.anchor_m[trip.next] = trip.h_cross_m
    trip.anchor_travel_m[trip.next] = trip.travel_m
    trip.anchor_variance[trip.next] = variance
    trip.count = min(trip.count + 1, MAX_ANCHORS)
    trip.next = (trip.next + 1) % MAX_ANCHORS


def measurement(
    params: Params, nav: Nav, trip: RoundTrip, anchor: int, t_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """H, innovation, R of one return to the height of ``anchor``."""
    s = nav.R @ params.lever_leader_m
    H = np.zeros((1, 15))
    H[0, PZ] = 1.0
    H[0, V_.stop - 1] = -(t_s - trip.t_cross_s)
    H[0, T_.start] = -s[1]
    H[0, T_.start + 1] = s[0]
    innovation = np.array([trip.anchor_m[anchor] - trip.h_cross_m])
    R = params.height_sigma_m**2 + trip.anchor_variance[anchor]
    if trip.doubt:
        R += params.height_doubt_m**2
    return H, innovation, np.array([R])
