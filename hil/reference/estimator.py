# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N803, N806 (matrices carry the capital letters of the equations)
"""The step loop: what runs when, on which sample. docs/estimator.md, section 4, in code.

One call of :meth:`Estimator.step` per leader sample; follower samples ride along when they have
arrived, with their time already on the leader's clock. Time only ever comes in with samples.
The four phases spread the updates, so that no step pays for all of them.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hil.reference import hold, rigid_body, round_trip, zupt
from hil.reference.attitude import (
    FloatArray,
    angle_between,
    cross,
    from_gravity,
)
from hil.reference.madgwick import madgwick_step
from hil.reference.params import Params
from hil.reference.prefilter import Butterworth2, MovingAverage, Prefilter
from hil.reference.state import A_, G_, T_, V_, Nav, correct, nis, predict

MAX_FOLLOWER_SAMPLES = 16
"""Most follower samples on one step: one full IMU batch of the protocol."""
MAX_RESIDUALS = 4
"""Most follower samples compared with the leader on one step; what is left of a batch can wait."""
MAX_GAP_S = 0.05


class Flag(enum.IntFlag):
    """What happened on a step; the bits of ``flags`` in the EKF frame."""

    ALIGNED = 1
    STILL = 2
    ZUPT = 4
    ZUPT_GATED = 8
    GRAVITY = 16
    RIGID = 32
    RIGID_GATED = 64
    FOLLOWER_LOST = 128
    ROUND_TRIP = 256
    ROUND_TRIP_GATED = 512
    ANCHOR = 1024
    CLIPPED = 2048
    IMPACT = 4096
    GAP = 8192
    BOUND = 16384
    FOLLOWER_REFUSED = 32768


@dataclass(frozen=True)
class Sample:
    """One raw sample in SI units, sensor frame.

    Attributes:
        t_s: sample time on the leader's clock.
        accel_mps2, gyro_radps: (3,).
        clipped: any axis at the end of its range.
        t_sigma_s: standard deviation of ``t_s`` against the leader's clock (follower only).
    """

    t_s: float
    accel_mps2: FloatArray
    gyro_radps: FloatArray
    clipped: bool = False
    t_sigma_s: float = 0.0


@dataclass(frozen=True)
class Output:
    """The estimate after one step.

    Attributes:
        t_s: time the state refers to: the sample's, less the prefilter's delay.
        centre_velocity_mps, centre_height_m: of the bar's centre.
        nis, gate, innovation: of the last update on this step; NaN, 0 and zeros if none ran.
        divergence_rad: angle between the EKF's attitude and the Madgwick baseline's.
    """

    t_s: float
    p: FloatArray
    v: FloatArray
    q: FloatArray
    b_a: FloatArray
    b_g: FloatArray
    variance: FloatArray
    centre_velocity_mps: FloatArray
    centre_height_m: float
    innovation: FloatArray
    nis: float
    gate: float
    flags: Flag
    q_madgwick: FloatArray
    divergence_rad: float


def _finite(sample: Sample) -> bool:
    return bool(
        math.isfinite(sample.t_s)
        and np.isfinite(sample.accel_mps2).all()
        and np.isfinite(sample.gyro_radps).all()
        and math.isfinite(sample.t_sigma_s)
    )


@dataclass
class Channel:
    """Front end of one sensor: rotation to the bar frame, prefilter, clip memory."""

    rotation: FloatArray
    prefilter: Prefilter
    delay_s: float
    clip_hold: int
    clip_left: int = 0

    @classmethod
    def of(cls, params: Params, rotation: FloatArray) -> Channel:
        prefilter: Prefilter
        if params.prefilter_iir:
            prefilter = Butterworth2(params.cutoff_hz, params.rate_hz)
        else:
            prefilter = MovingAverage(params.average_length)
        delay = prefilter.delay_samples
        return cls(rotation, prefilter, delay * params.dt_s, math.ceil(2.0 * delay) + 1)

    def __call__(self, sample: Sample) -> tuple[float, FloatArray, FloatArray, bool]:
        """Filtered (t_s, force, rate, clipped): clipped for as long as the filter remembers."""
        both = np.concatenate(
            [self.rotation @ sample.accel_mps2, self.rotation @ sample.gyro_radps]
        )
        y = self.prefilter(both)
        if sample.clipped:
            self.clip_left = self.clip_hold
        clipped = self.clip_left > 0
        self.clip_left = max(self.clip_left - 1, 0)
        return sample.t_s - self.delay_s, y[:3], y[3:], clipped


@dataclass
class Alignment:
    """Sums over the first ``align_s`` seconds."""

    count: int = 0
    t_first_s: float = 0.0
    force: FloatArray = field(default_factory=lambda: np.zeros(3))
    rate: FloatArray = field(default_factory=lambda: np.zeros(3))
    force2: float = 0.0
    rate2: float = 0.0
    follower_count: int = 0
    follower_rate: FloatArray = field(default_factory=lambda: np.zeros(3))


class Estimator:
    """State and step of the whole estimator."""

    def __init__(self, params: Params) -> None:
        self.params = params
        self.nav = Nav()
        self.leader = Channel.of(params, params.rotation_leader)
        self.follower = Channel.of(params, params.rotation_follower)
        self.detector = zupt.Detector.of(params)
        self.sums = rigid_body.Averager(fresh_force=params.rigid_fast, fresh_rate=params.rigid_fast)
        self.trip = round_trip.RoundTrip()
        self.hold = hold.Hold()
        self.history: deque[rigid_body.Past] = deque(maxlen=rigid_body.HISTORY)
        self.waiting: deque[rigid_body.Arrival] = deque(maxlen=2 * MAX_FOLLOWER_SAMPLES)
        self.alignment = Alignment()
        self.aligned = False
        self.q_madgwick = np.array([1.0, 0.0, 0.0, 0.0])
        self.a_world = np.zeros(3)
        self.force_last = np.zeros(3)
        self.rate_last = np.zeros(3)
        self.turned = np.zeros(3)
        self.turned_seen = np.zeros(3)
        self.turned_far = np.zeros(3)
        self.turned_fresh = np.zeros(3)
        self.turned2_max = 0.0
        self.away2_max = 0.0
        self.turned_over = False
        self.t_last_s = -math.inf
        self.t_follower_s = -math.inf
        self.t_bound_s = 0.0
        self.steps = 0
        self.last: tuple[FloatArray, float, float] = (np.zeros(3), math.nan, 0.0)

    def step(self, leader: Sample, followers: Sequence[Sample] = ()) -> Output | None:
        """One leader sample and the follower samples that arrived since the last.

        A follower sample that is not finite, not later than the one before, or more than
        ``MAX_GAP_S`` ahead of the leader is left out and flagged: one bad packet must not cost
        the leader's own step.

        Returns:
            The estimate, or ``None`` while aligning.

        Raises:
            ValueError: a leader value is not finite, leader time does not increase, or there
                are too many follower samples at once. The state is what it was before.
        """
        p = self.params
        if len(followers) > MAX_FOLLOWER_SAMPLES:
            raise ValueError(
                f"{len(followers)} follower samples on one step: give at most "
                f"{MAX_FOLLOWER_SAMPLES}, and the rest on the next steps"
            )
        if not _finite(leader):
            raise ValueError(f"leader sample at {leader.t_s} s is not finite: leave it out")
        if leader.t_s - self.leader.delay_s <= self.t_last_s:
            raise ValueError(
                f"leader time {leader.t_s - self.leader.delay_s} s does not follow "
                f"{self.t_last_s} s"
            )
        t, force, rate, clipped = self.leader(leader)
        refused = self._take_followers(followers, leader.t_s)
        if not self.aligned:
            self._align(t, force, rate)
            self.t_last_s, self.force_last, self.rate_last = t, force, rate
            return None

        dt = t - self.t_last_s
        turn = 0.5 * (self.rate_last + rate)
        flags, extra = self._inflation(force, turn, dt, clipped)
        flags |= Flag.ALIGNED | refused
        self.a_world = predict(
            p, self.nav, a_before=self.a_world, force=force, rate=turn, dt=dt, extra=extra
        )
        self._remember(t, force, rate)
        self.q_madgwick = madgwick_step(
            self.q_madgwick, force, rate - self.nav.b_g, dt, p.madgwick_gain
        )
        self.t_last_s, self.force_last, self.rate_last = t, force, rate

        self.last = (np.zeros(3), math.nan, 0.0)
        flags |= self._rigid_residuals(t)
        still = self._detect(t, force, rate)
        phase = self.steps % 4
        if still:
            flags |= Flag.STILL
            flags |= self._still_updates(phase, rate, dt)
            self._rest()
        else:
            self.detector.refused_s = 0.0
        flags |= self._rigid_updates(phase)

        n = self.nav
        v_centre, h_centre = self._centre(rate)
        if p.round_trip and round_trip.boundary(
            p, n, self.trip, t, h_m=h_centre, v_mps=float(v_centre[2])
        ):
            flags |= self._round_trip(t)
        # On odd phases, which have no rigid-body update.
        if (
            not still
            and self.turned_over
            and p.hold_span_s > 0.0
            and self.hold.steady(p, t, float(v_centre[2]))
            and phase % 2
        ):
            flags |= self._hold()
        # Half a sample of room: where the rate divides the period, rounding must not decide.
        due_s = p.bound_period_s - 0.5 * p.dt_s
        if p.bound_period_s > 0.0 and t - self.t_bound_s >= due_s:
            self.t_bound_s = t
            flags |= self._bound()
        self.steps += 1
        return self._output(t, rate, flags)

    def _output(self, t: float, rate: FloatArray, flags: Flag) -> Output:
        innovation, nis_last, gate = self.last
        n = self.nav
        v_centre, h_centre = self._centre(rate)
        return Output(
            t,
            n.p,
            n.v,
            n.q,
            n.b_a,
            n.b_g,
            np.diag(n.P).copy(),
            v_centre,
            h_centre,
            innovation,
            nis_last,
            gate,
            flags,
            self.q_madgwick,
            angle_between(n.q, self.q_madgwick),
        )

    def _centre(self, rate: FloatArray) -> tuple[FloatArray, float]:
        """Velocity (3,) and height of the bar's centre: the leader's, less the lever arm's."""
        R, r = self.nav.R, self.params.lever_leader_m
        velocity = self.nav.v - R @ cross(rate - self.nav.b_g, r)
        return velocity, float(self.nav.p[2] - (R @ r)[2])

    def _inflation(
        self, force: FloatArray, turn: FloatArray, dt: float, clipped: bool
    ) -> tuple[Flag, tuple[float, float, float]]:
        """Variances that this step adds to velocity, attitude and accelerometer bias.

        Scale errors act on the attitude through the *net* turn since the last rest: turned
        back, they undo themselves, so variance is added only where the turn sets a record.
        On the accelerometer they act through the side from which it sees gravity. The filter
        calls that bias, learns it, and must be ready to unlearn it when the bar turns on. The error
        grows with the turn itself, not with its square root: along one way its variance grows
        with the square of the turn, as far as the turn sets a record. Where the bar turns back
        by more than ``turn_step_rad``, a new way begins.
        """
        p, flags = self.params, Flag(0)
        q_v, q_theta, q_a = 0.0, 0.0, 0.0
        if clipped:
            flags |= Flag.CLIPPED
            q_v += (p.clip_sigma_mps2 * dt) ** 2
            q_theta += (p.clip_sigma_radps * dt) ** 2
        jump = force - self.force_last
        jump2 = float(jump @ jump)
        if jump2 > p.gravity_mps2**2:
            flags |= Flag.IMPACT
            q_v += p.impact_share**2 * jump2 * dt * dt
        if dt > MAX_GAP_S:
            flags |= Flag.GAP
            q_v += (p.gravity_mps2 * dt) ** 2
        self.turned = self.turned + dt * (turn - self.nav.b_g)
        turned2 = float(self.turned @ self.turned)
        if turned2 > self.turned2_max:
            q_theta += p.gyro_scale_sigma**2 * (turned2 - self.turned2_max)
            self.turned2_max = turned2
        away = self.turned - self.turned_seen
        away2 = float(away @ away)
        back = self.turned - self.turned_far
        if away2 > max(self.away2_max, p.turn_step_rad**2):
            q_a = (away2 - self.away2_max) * (p.accel_scale_sigma * p.gravity_mps2) ** 2
            self.away2_max = away2
            self.turned_far = self.turned
        elif self.away2_max > 0.0 and float(back @ back) > p.turn_step_rad**2:
            self.turned_seen = self.turned_far
            self.away2_max = 0.0
        rate = turn - self.nav.b_g
        if float(rate @ rate) > p.hold_turn_radps**2:
            self.turned_over = True
        afresh = self.turned - self.turned_fresh
        if float(afresh @ afresh) > p.turn_fresh_rad**2:
            self.sums.fresh_force = p.rigid_fast
            self.turned_fresh = self.turned
        return flags, (q_v, q_theta, q_a)

    def _rest(self) -> None:
        """A rest is where the net turn starts anew."""
        self.turned = np.zeros(3)
        self.turned_seen = np.zeros(3)
        self.turned_far = np.zeros(3)
        self.turned_fresh = np.zeros(3)
        self.turned2_max = 0.0
        self.away2_max = 0.0
        self.turned_over = False
        self.hold.clear()

    # Front end -------------------------------------------------------------------------------

    def _take_followers(self, followers: Sequence[Sample], now_s: float) -> Flag:
        flags = Flag(0)
        for sample in followers:
            if (
                not _finite(sample)
                or sample.t_s > now_s + MAX_GAP_S
                or sample.t_s - self.follower.delay_s <= self.t_follower_s
            ):
                flags |= Flag.FOLLOWER_REFUSED
                continue
            t, force, rate, clipped = self.follower(sample)
            self.t_follower_s = t
            self.detector.follower.push(force, rate)
            if not self.aligned:
                self.alignment.follower_count += 1
                self.alignment.follower_rate += rate
            elif not clipped:
                self.waiting.append(rigid_body.Arrival(t, force, rate, sample.t_sigma_s))
        return flags

    def _align(self, t: float, force: FloatArray, rate: FloatArray) -> None:
        """Attitude from the mean force, gyroscope bias from the mean rate if all is still."""
        p, a = self.params, self.alignment
        if a.count == 0:
            a.t_first_s = t
        a.count += 1
        a.force += force
        a.rate += rate
        a.force2 += float(force @ force)
        a.rate2 += float(rate @ rate)
        self.detector.leader.push(force, rate)
        # Half a sample of room: where the rate divides the span, rounding must not decide.
        if t - a.t_first_s < p.align_s - 0.5 * p.dt_s:
            return
        f, w = a.force / a.count, a.rate / a.count
        still = (
            a.force2 / a.count - float(f @ f) < 3.0 * p.zupt_accel_var
            and a.rate2 / a.count - float(w @ w) < p.zupt_gyro_var
        )
        n = self.nav
        n.q = from_gravity(f)
        self.q_madgwick = n.q
        diagonal = np.zeros(15)
        diagonal[A_] = p.accel_bias_sigma_mps2**2
        diagonal[V_] = (p.velocity_sigma_still_mps if still else p.velocity_sigma_moving_mps) ** 2
        diagonal[G_] = (p.gyro_bias_sigma_still_radps if still else p.gyro_bias_sigma_radps) ** 2
        n.P = np.diag(diagonal)
        if still:
            n.b_g = w
            if a.follower_count > 0:
                self.detector.gyro_bias_follower = a.follower_rate / a.follower_count
        self._correlate_tilt(still)
        self.a_world = n.R @ f - np.array([0.0, 0.0, p.gravity_mps2])
        self.t_bound_s = t
        self.aligned = True

    def _correlate_tilt(self, still: bool) -> None:
        """A levelled attitude carries the horizontal bias as tilt: dtheta = e_z x R b_a / g.

        Levelling turns R until R (f - b_a) looks vertical with b_a taken as zero, so tilt and
        bias errors start fully correlated; leaving that out would let the filter believe that
        it can tell them apart.
        """
        p, n = self.params, self.nav
        # R db_a horizontal = g (dtheta_y, -dtheta_x)
        R = n.R
        to_tilt = np.zeros((3, 3))
        to_tilt[0] = -R[1] / p.gravity_mps2
        to_tilt[1] = R[0] / p.gravity_mps2
        spread = n.P[A_, A_]
        n.P[T_, A_] = to_tilt @ spread
        n.P[A_, T_] = n.P[T_, A_].T
        n.P[T_, T_] = to_tilt @ spread @ to_tilt.T
        extra = p.tilt_sigma_still_rad if still else p.tilt_sigma_moving_rad
        for i in (0, 1):
            n.P[T_.start + i, T_.start + i] += extra**2

    def _remember(self, t: float, force: FloatArray, rate: FloatArray) -> None:
        """Append to the history; the angular acceleration of the sample before is now known."""
        h = self.history
        if len(h) >= 2:
            before, middle = h[-2], h[-1]
            alpha = (rate - before.rate) / (t - before.t_s)
            h[-1] = rigid_body.Past(middle.t_s, middle.force, middle.rate, alpha)
            h.append(rigid_body.Past(t, force, rate, alpha))
        else:
            h.append(rigid_body.Past(t, force, rate, np.zeros(3)))

    # Updates ---------------------------------------------------------------------------------

    def _gated(
        self,
        H: FloatArray,
        innovation: FloatArray,
        R: FloatArray,
        gate: float,
        R_applied: FloatArray | None = None,
    ) -> bool:
        """Correct if the innovation passes its gate; keeps both for the output.

        The gate uses ``R``, the correction ``R_applied`` where that is given.
        """
        value = nis(self.nav, H, innovation, R)
        shown = np.zeros(3)
        shown[: len(innovation)] = innovation
        self.last = (shown, value, gate)
        if value > gate:
            return False
        correct(self.nav, H, innovation, R if R_applied is None else R_applied)
        return True

    def _rigid_residuals(self, t: float) -> Flag:
        p = self.params
        if t - self.t_follower_s > p.follower_timeout_s:
            self.sums.clear()
            self.waiting.clear()
            self.detector.follower.clear()
            return Flag.FOLLOWER_LOST
        # The newest entry's angular acceleration is provisional until its successor is in.
        newest = self.history[-2].t_s if len(self.history) > 2 else -math.inf
        for _ in range(MAX_RESIDUALS):
            if not self.waiting or self.waiting[0].t_s > newest:
                break
            arrival = self.waiting.popleft()
            found = rigid_body.at_time(self.history, arrival.t_s)
            if found is None:
                continue
            past, slope = found
            rigid_body.add_residual(
                p, self.nav, self.sums, leader=past, slope=slope, follower=arrival
            )
        return Flag(0)

    def _rigid_updates(self, phase: int) -> Flag:
        p, s = self.params, self.sums
        if s.count < p.rigid_samples or phase % 2:
            return Flag(0)
        force = s.force_next
        s.force_next = not force
        measure = rigid_body.force_measurement if force else rigid_body.rate_measurement
        H, y, R = measure(p, self.nav, s)
        s.clear()
        spread2 = s.force_spread2 if force else s.rate_spread2
        if not self._gated(H, y, R, p.rigid_gate, R + spread2):
            return Flag.RIGID_GATED
        spread2 += p.rigid_forget * (float(y @ y) / 3.0 - spread2)
        if force:
            s.force_spread2 = spread2
            s.fresh_force = max(s.fresh_force - 1, 0)
        else:
            s.rate_spread2 = spread2
            s.fresh_rate = max(s.fresh_rate - 1, 0)
        return Flag.RIGID

    def _detect(self, t: float, force: FloatArray, rate: FloatArray) -> bool:
        """Count consecutive detections on both sensors; a lost follower has no vote."""
        p, d = self.params, self.detector
        d.leader.push(force, rate)
        now = zupt.window_is_still(p, d.leader, self.nav.b_g)
        if t - self.t_follower_s <= p.follower_timeout_s:
            now = now and zupt.window_is_still(p, d.follower, d.gyro_bias_follower)
        d.hits = d.hits + 1 if now else 0
        return d.hits >= p.zupt_dwell

    def _still_updates(self, phase: int, rate: FloatArray, dt: float) -> Flag:
        p, n = self.params, self.nav
        if self._gated(*zupt.velocity_measurement(p, n), p.zupt_gate):
            self.detector.refused_s = 0.0
            flags = Flag.ZUPT
        else:
            self.detector.refused_s += dt
            if self.detector.refused_s > p.zupt_force_s:
                # Stillness this long outweighs the filter's belief: reopen the velocity.
                self.trip.count = self.trip.next = 0
                for i in range(V_.start, V_.stop):
                    n.P[i, i] += p.velocity_sigma_moving_mps**2
            return Flag.ZUPT_GATED
        if phase == 1:
            correct(n, *zupt.gravity_measurement(p, n, self.detector.leader.mean_force))
            flags |= Flag.GRAVITY
        elif phase == 3:
            correct(n, *zupt.rate_measurement(p, n, rate))
        return flags

    def _round_trip(self, t: float) -> Flag:
        p, n, trip = self.params, self.nav, self.trip
        anchor = round_trip.associate(p, n, trip)
        if anchor < 0:
            round_trip.add_anchor(p, n, trip)
            return Flag.ANCHOR
        if self._gated(*round_trip.measurement(p, n, trip, anchor, t), p.round_trip_gate):
            trip.begin_descent()
            return Flag.ROUND_TRIP
        return Flag.ROUND_TRIP_GATED

    def _hold(self) -> Flag:
        """A bar turned over is caught, then held. One that surely moves does not pass the gate."""
        passed = self._gated(*hold.measurement(self.params, self.hold), self.params.hold_gate)
        self.hold.clear()
        return Flag.BOUND if passed else Flag(0)

    def _bound(self) -> Flag:
        """0 = v_xy + n: a bar does not travel sideways for long."""
        H = np.zeros((2, 15))
        H[0, V_.start] = H[1, V_.start + 1] = 1.0
        correct(self.nav, H, -self.nav.v[:2], np.full(2, self.params.bound_sigma_mps**2))
        return Flag.BOUND
