# SPDX-License-Identifier: Apache-2.0
"""The reference on real recordings with optical truth: the BROAD benchmark.

``python -m hil.reference.broad FOLDER`` prints inclination and vertical velocity for the trials.

D. Laidig et al., BROAD -- A Benchmark for Robust Inertial Orientation Estimation, Data 6(7),
2021. One IMU in a hand, no bar: no lever arm, no follower, no round trip. Its sensor is noisier
than the LSM6DSOX at this rate and is calibrated, so noise and stillness thresholds are its own.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.reference.attitude import FloatArray, from_gravity, tilt_between
from hil.reference.estimator import Estimator, Sample
from hil.reference.madgwick import madgwick_step
from hil.reference.params import Params


@dataclass(frozen=True)
class Trial:
    """One trial: n samples at ``rate_hz``.

    Attributes:
        accel_mps2, gyro_radps: (n, 3), sensor frame.
        q_true: (n, 4) sensor to ENU, NaN where the cameras lost it.
        p_true_m: (n, 3), ENU.
        counts: (n,) True in the phase over which errors are to be taken.
    """

    rate_hz: float
    accel_mps2: FloatArray
    gyro_radps: FloatArray
    q_true: FloatArray
    p_true_m: FloatArray
    counts: NDArray[np.bool_]


def load(folder: str | Path, trial: str) -> Trial:
    """Read trial ``"14"`` and so on from ``folder``/broad.

    Raises:
        FileNotFoundError: no such trial there.
    """
    h5py = importlib.import_module("h5py")  # an extra: only these recordings need it
    found = sorted((Path(folder) / "broad").glob(f"{trial}_*.hdf5"))
    if not found:
        raise FileNotFoundError(f"no trial {trial}_*.hdf5 in {Path(folder) / 'broad'}")
    with h5py.File(found[0]) as file:
        return Trial(
            float(file.attrs["sampling_rate"]),
            file["imu_acc"][:],
            file["imu_gyr"][:],
            file["opt_quat"][:],
            file["opt_pos"][:],
            file["movement"][:],
        )


def params(rate_hz: float) -> Params:
    """Parameters for the benchmark's IMU: noise from its own resting phases."""
    return Params(
        rate_hz=rate_hz,
        lever_leader_m=np.zeros(3),
        lever_follower_m=np.zeros(3),
        rotation_follower=np.eye(3),
        round_trip=False,
        hold_span_s=0.0,
        accel_noise_mps2_rthz=6e-3,
        gyro_noise_radps_rthz=1.5e-4,
        accel_bias_sigma_mps2=0.01,
        accel_walk_mps2_rts=1e-5,
        accel_scale_sigma=0.0,
        zupt_accel_var=4e-3,
        zupt_gyro_var=4e-5,
        bound_sigma_mps=0.3,
        tilt_sigma_still_rad=2e-4,
        zaru_sigma_radps=1.2e-3,
        gravity_sigma_mps2=0.05,
    )


def estimate(trial: Trial, chosen: Params | None = None) -> tuple[FloatArray, FloatArray]:
    """(n, 4) attitude and (n,) vertical velocity, m/s, of the estimator at the samples' times.

    Causal, but stamped without the prefilter's delay; NaN while it aligns.
    """
    estimator = Estimator(chosen or params(trial.rate_hz))
    delay = round(estimator.leader.prefilter.delay_samples)
    q = np.full((len(trial.accel_mps2), 4), np.nan)
    velocity = np.full(len(q), np.nan)
    for k, (accel, gyro) in enumerate(zip(trial.accel_mps2, trial.gyro_radps, strict=True)):
        output = estimator.step(Sample(k / trial.rate_hz, accel, gyro))
        if output is not None:
            q[k - delay] = output.q
            velocity[k - delay] = output.v[2]
    return q, velocity


def attitude(trial: Trial, chosen: Params | None = None) -> FloatArray:
    """(n, 4) attitude of the estimator at the samples' times; NaN while it aligns."""
    return estimate(trial, chosen)[0]


def madgwick(trial: Trial, gain_radps: float = 0.033) -> FloatArray:
    """(n, 4) attitude of the baseline with the gain of Madgwick's report."""
    q = from_gravity(trial.accel_mps2[:50].mean(axis=0))
    rows = np.empty((len(trial.accel_mps2), 4))
    for k, (accel, gyro) in enumerate(zip(trial.accel_mps2, trial.gyro_radps, strict=True)):
        q = madgwick_step(q, accel, gyro, 1.0 / trial.rate_hz, gain_radps)
        rows[k] = q
    return rows


def inclination_rmse_deg(q: FloatArray, trial: Trial) -> float:
    """Root mean square of the inclination error where truth is known and counts."""
    known = trial.counts & ~np.isnan(trial.q_true).any(axis=1) & ~np.isnan(q).any(axis=1)
    pairs = zip(q[known], trial.q_true[known], strict=True)
    errors = np.array([tilt_between(ours, true) for ours, true in pairs])
    return float(np.degrees(np.sqrt(np.mean(errors * errors))))


# Vertical velocity ---------------------------------------------------------------------------

SMOOTHING_S = 0.025
"""Standard deviation of the Gaussian that low-passes both sides alike: -3 dB at 5.3 Hz."""
WASHOUT_S = 1.0
"""Time constant of the high-pass that a bare integration needs, applied to both sides alike."""


def true_velocity(trial: Trial) -> FloatArray:
    """(n,) vertical velocity from the cameras, m/s; NaN where they lost the marker.

    The central difference of the optical height, low-passed: a millimetre of camera noise from
    one sample to the next would be 0.1 m/s. What is left of the truth's own error is some mm/s
    at rest and unknown in motion, so differences below 10 mm/s mean nothing.
    """
    height = trial.p_true_m[:, 2]
    velocity = np.full(len(height), np.nan)
    velocity[1:-1] = 0.5 * (height[2:] - height[:-2]) * trial.rate_hz
    return smoothed(velocity, trial.rate_hz)


def smoothed(values: FloatArray, rate_hz: float) -> FloatArray:
    """Gaussian low-pass without delay; NaN wherever a NaN lies within three deviations."""
    reach = int(np.ceil(3.0 * SMOOTHING_S * rate_hz))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (SMOOTHING_S * rate_hz)) ** 2)
    inside: FloatArray = np.convolve(values, weights / weights.sum(), mode="same")
    inside[:reach] = inside[len(inside) - reach :] = np.nan
    return inside


def high_passed(values: FloatArray, rate_hz: float) -> FloatArray:
    """First-order high-pass of ``WASHOUT_S``; starts anew after every NaN."""
    keep = WASHOUT_S / (WASHOUT_S + 1.0 / rate_hz)
    out, before, y = np.full(len(values), np.nan), np.nan, 0.0
    for k, x in enumerate(values):
        y = keep * (y + x - before) if np.isfinite(before) and np.isfinite(x) else 0.0
        out[k] = y if np.isfinite(x) else np.nan
        before = x
    return out


def integrated(trial: Trial, q: FloatArray, gravity_mps2: float = 9.80665) -> FloatArray:
    """(n,) vertical velocity by bare integration of the acceleration on the attitude ``q``.

    Nothing corrects it, so it drifts: compare it high-passed, see :func:`velocity_rmse_mps`.
    """
    row = np.stack(
        [
            2.0 * (q[:, 1] * q[:, 3] - q[:, 0] * q[:, 2]),
            2.0 * (q[:, 2] * q[:, 3] + q[:, 0] * q[:, 1]),
            q[:, 0] ** 2 - q[:, 1] ** 2 - q[:, 2] ** 2 + q[:, 3] ** 2,
        ],
        axis=1,
    )
    accel = np.nan_to_num(np.sum(row * trial.accel_mps2, axis=1) - gravity_mps2)
    velocity = np.cumsum(accel) / trial.rate_hz
    velocity[np.isnan(q).any(axis=1)] = np.nan
    return velocity


def velocity_rmse_mps(velocity: FloatArray, trial: Trial, *, washout: bool) -> float:
    """Root mean square error of a vertical velocity over the samples that count.

    Args:
        washout: high-pass both sides first, for a velocity that drifts by construction. The
            second after each gap in the truth, in which the two start anew, does not count.
    """
    true, ours = true_velocity(trial), smoothed(velocity, trial.rate_hz)
    both = np.isfinite(true) & np.isfinite(ours)
    true, ours = np.where(both, true, np.nan), np.where(both, ours, np.nan)
    counts = trial.counts & both
    if washout:
        true, ours = (high_passed(x, trial.rate_hz) for x in (true, ours))
        settle = int(3.0 * WASHOUT_S * trial.rate_hz)
        gaps = np.convolve(~both, np.ones(settle + 1))[: len(both)] > 0
        counts &= ~gaps
    error = ours[counts] - true[counts]
    return float(np.sqrt(np.mean(error * error)))


def figures(
    trial: Trial, estimated: tuple[FloatArray, FloatArray] | None = None
) -> dict[str, tuple[float, float]]:
    """By method: inclination RMSE, deg, and vertical velocity RMSE, m/s.

    ``estimator`` is the filter's own velocity against the truth as it is; the others are the same
    high-passed integration on three attitudes. VQF is there if it is installed.

    Args:
        estimated: what to judge, as :func:`estimate` gives it; left out, the reference runs.
    """
    q, own = estimated or estimate(trial)
    attitudes = {"integration on this attitude": q, "integration on Madgwick's": madgwick(trial)}
    try:
        vqf = importlib.import_module("vqf")
    except ModuleNotFoundError:
        pass
    else:
        batch = vqf.VQF(1.0 / trial.rate_hz).updateBatch(
            np.ascontiguousarray(trial.gyro_radps), np.ascontiguousarray(trial.accel_mps2)
        )
        attitudes["integration on VQF-6D's"] = batch["quat6D"]
    rows = {
        "estimator": (
            inclination_rmse_deg(q, trial),
            velocity_rmse_mps(own, trial, washout=False),
        )
    }
    for name, attitude_ in attitudes.items():
        rows[name] = (
            inclination_rmse_deg(attitude_, trial),
            velocity_rmse_mps(integrated(trial, attitude_), trial, washout=True),
        )
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures of the trials."""
    parser = argparse.ArgumentParser(prog="python -m hil.reference.broad", description=__doc__)
    parser.add_argument("folder", help="the folder that holds broad/*.hdf5")
    parser.add_argument("--trials", nargs="+", default=["14", "15", "24"])
    options = parser.parse_args(argv)
    for name in options.trials:
        for method, (inclination, velocity) in figures(load(options.folder, name)).items():
            print(f"trial {name}  {method:30} {inclination:5.2f} deg  {1e3 * velocity:6.1f} mm/s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
