# SPDX-License-Identifier: Apache-2.0
"""The reference on real recordings with optical truth: the BROAD benchmark.

D. Laidig et al., BROAD -- A Benchmark for Robust Inertial Orientation Estimation, Data 6(7),
2021. One IMU in a hand, no bar: no lever arm, no follower, no round trip. Its sensor is noisier
than the LSM6DSOX at this rate and is calibrated, so noise and stillness thresholds are its own.
"""

from __future__ import annotations

import importlib
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
        accel_noise_mps2_rthz=6e-3,
        gyro_noise_radps_rthz=1.5e-4,
        accel_bias_sigma_mps2=0.01,
        accel_walk_mps2_rts=1e-5,
        accel_scale_sigma=0.0,
        zupt_accel_var=4e-3,
        zupt_gyro_var=4e-5,
        bound_sigma_mps=0.3,
    )


def attitude(trial: Trial, chosen: Params | None = None) -> FloatArray:
    """(n, 4) attitude of the estimator at the samples' times; NaN while it aligns."""
    estimator = Estimator(chosen or params(trial.rate_hz))
    delay = round(estimator.leader.prefilter.delay_samples)
    q = np.full((len(trial.accel_mps2), 4), np.nan)
    for k, (accel, gyro) in enumerate(zip(trial.accel_mps2, trial.gyro_radps, strict=True)):
        output = estimator.step(Sample(k / trial.rate_hz, accel, gyro))
        if output is not None:
            q[k - delay] = output.q
    return q


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
