# SPDX-License-Identifier: Apache-2.0
"""The emulated processor's outputs against the host core's, bit by bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.core import Estimator
from hil.divergence import Divergence
from hil.parity import Batch
from hil.pil import layout
from hil.pil.emulator import TargetRun
from hil.reference.params import Params

ESTIMATED, ALIGNING = (layout.STATUS.index(name) for name in ("ESTIMATED", "ALIGNING"))
_BITS = {2: np.uint16, 4: np.uint32, 8: np.uint64}


@dataclass(frozen=True)
class Comparison:
    """How host and target agree.

    Attributes:
        steps: compared, those with an output on either side.
        divergent: of them with any difference.
        first: where it begins; ``None`` when there is none.
    """

    steps: int
    divergent: int
    first: Divergence | None


def host_outputs(samples: Batch, params: Params | None = None) -> NDArray[np.void]:
    """Outputs of the host core in float over the same samples.

    Raises:
        ValueError: the core refuses a sample.
    """
    core = Estimator(params or Params(), np.float32)
    return core.run(samples.leader, samples.follower, samples.arrival).outputs


def compare(host: NDArray[np.void], target: TargetRun) -> Comparison:
    """Every field of every step.

    Two NaNs are equal: IEEE 754 leaves their sign and payload to the processor.

    Raises:
        ValueError: the host has a field that the target does not send.
    """
    names = [name for name in host.dtype.names or () if name != "step"]
    missing = set(names) - set(layout.OUTPUT.names or ())
    if missing:
        raise ValueError(f"the target does not send {sorted(missing)}: see hil.pil.layout")
    n = len(target.outputs)
    differs = np.zeros(n, bool)
    first: Divergence | None = None
    estimated = np.zeros(n, bool)
    estimated[host["step"]] = True
    ours = np.zeros(n, host.dtype)
    ours[host["step"]] = host
    # The host core raises what it refuses: where it went on without an output, it was aligning.
    status = np.where(estimated, ESTIMATED, ALIGNING).astype(np.uint32)
    columns = [("status", status, target.outputs["status"])]
    columns += [(name, ours[name], target.outputs[name]) for name in names]
    for name, one, other in columns:
        a = np.ascontiguousarray(one).reshape(n, -1)
        b = np.ascontiguousarray(other.astype(a.dtype)).reshape(n, -1)
        unequal = _bits(a) != _bits(b)
        if a.dtype.kind == "f":
            unequal &= ~(np.isnan(a) & np.isnan(b))
        differs |= unequal.any(axis=1)
        if unequal.any():
            step, at = (int(i) for i in np.argwhere(unequal)[0])
            if first is None or step < first.step:
                first = Divergence(
                    step,
                    f"{name}[{at}]" if a.shape[1] > 1 else name,
                    int(_bits(a)[step, at]),
                    int(_bits(b)[step, at]),
                    float(a[step, at]),
                    float(b[step, at]),
                )
    return Comparison(
        int((estimated | (target.outputs["status"] == ESTIMATED)).sum()), int(differs.sum()), first
    )


def _bits(values: NDArray[np.generic]) -> NDArray[np.unsignedinteger]:
    return values.view(_BITS[values.dtype.itemsize])
