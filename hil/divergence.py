# SPDX-License-Identifier: Apache-2.0
"""Where two runs of the estimator that should be equal in every bit first are not."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Divergence:
    """The first number that differs from the host core's.

    Attributes:
        step: index of the leader sample.
        field: output, with its component: ``v[2]``.
        host_bits, target_bits: patterns; those of a float are IEEE 754 single.
        host, target: the same as numbers.
    """

    step: int
    field: str
    host_bits: int
    target_bits: int
    host: float
    target: float

    def __str__(self) -> str:
        return (
            f"step {self.step}, {self.field}: host {self.host:.9g} ({self.host_bits:#010x}), "
            f"target {self.target:.9g} ({self.target_bits:#010x})"
        )
