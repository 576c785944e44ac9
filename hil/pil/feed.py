# SPDX-License-Identifier: Apache-2.0
"""Samples and parameters to the bytes of the target's input file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.core import MAX_FOLLOWER_SAMPLES, Samples, as_dict, default_params
from hil.parity import Batch
from hil.pil import layout
from hil.reference.params import Params

_FNV_OFFSET, _FNV_PRIME = 2166136261, 16777619


def encode(samples: Batch, params: Params) -> bytes:
    """The input file for a batch.

    Args:
        samples: as :meth:`hil.core.Estimator.run` takes them: SI units, times in ticks of the
            leader's 16 MHz clock, ``arrival`` the index of the leader sample on whose step each
            follower sample is in.

    Raises:
        ValueError: the arrays do not fit together, or more follower samples than a step may have.
    """
    leader, follower = _records(samples.leader), _records(samples.follower)
    arrival = np.asarray(samples.arrival, dtype=np.int64)
    if arrival.shape != (len(follower),):
        raise ValueError(f"arrival has shape {arrival.shape}: give one step per follower sample")
    if len(arrival) and (
        arrival[0] < 0 or arrival[-1] >= len(leader) or (np.diff(arrival) < 0).any()
    ):
        raise ValueError("arrival: give indices of leader samples that never fall")
    counts = np.bincount(arrival, minlength=len(leader))
    if counts.size and counts.max() > MAX_FOLLOWER_SAMPLES:
        raise ValueError(
            f"{counts.max()} follower samples on step {counts.argmax()}, at most "
            f"{MAX_FOLLOWER_SAMPLES}: spread them over the next steps"
        )
    words, names = _parameters(as_dict(params))
    header = np.zeros((), layout.HEADER)
    header["magic"], header["version"] = layout.INPUT_MAGIC, layout.VERSION
    header["parameter_words"], header["parameter_names"] = len(words) // 4, names
    header["steps"], header["followers"] = len(leader), len(follower)
    parts = [header.tobytes(), words]
    first = 0
    for own, count in zip(leader, counts, strict=True):
        step = np.zeros((), layout.STEP)
        step["followers"] = count
        parts += [step.tobytes(), own.tobytes(), follower[first : first + count].tobytes()]
        first += int(count)
    return b"".join(parts)


def _records(samples: Samples) -> NDArray[np.void]:
    """Rounded to float as the core's Python binding rounds them: to nearest."""
    t, accel, gyro, clipped, t_sigma = samples.columns()
    rows = np.zeros(len(t), layout.SAMPLE)
    rows["t_ticks"] = t
    rows["clipped"] = clipped
    # A number too large for a float is the core's to refuse, not NumPy's to warn of.
    with np.errstate(over="ignore"):
        rows["accel_mps2"], rows["gyro_radps"], rows["t_sigma_s"] = accel, gyro, t_sigma
    return rows


def _parameters(values: dict[str, Any]) -> tuple[bytes, int]:
    """One word per number, in the core's order, and the hash of their names and sizes."""
    words, digest = [], _FNV_OFFSET
    for name in default_params():
        value = values[name]
        numbers: Sequence[Any] = value if isinstance(value, list) else [value]
        words += [_word(number) for number in numbers]
        for byte in (*name.encode(), len(numbers)):
            digest = ((digest ^ byte) * _FNV_PRIME) & 0xFFFFFFFF
    return b"".join(words), digest


def _word(value: float) -> bytes:
    """Integers and truth values as they are, everything else as a float."""
    return np.array(value, "<i4" if isinstance(value, int) else "<f4").tobytes()
