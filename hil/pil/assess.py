# SPDX-License-Identifier: Apache-2.0
"""One set of samples on the emulated processor: everything that is asked of it, with limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.budget import Conditions, line
from hil.build.sources import estimator_hash, project_root
from hil.core import ESTIMATOR_SHA256
from hil.errors import RigError
from hil.measure import Limits, Measurement
from hil.parity import Batch, first_steps
from hil.pil import kinds, trace
from hil.pil.compare import Comparison, compare, host_outputs
from hil.pil.cycles import CLOCK_HZ, Cost
from hil.pil.emulator import TargetRun, run
from hil.pil.image import Image, Progress, quiet
from hil.pil.program import heap_functions
from hil.pil.stack import step_bound_bytes
from hil.reference.params import Params

RATE_HZ: Final = 416.0
TRACED_STEPS: Final = 900
"""Enough for the alignment, the dwell of the detector and every kind of update."""
STEP_CALL_INSTRUCTIONS: Final = 32
"""Between two readings of the clock, less the step itself: at most so many."""
STALE: Final = (
    "the installed host core is not built from the estimator's present sources: "
    "python -m pip install -e . builds it anew"
)


@dataclass(frozen=True)
class Model:
    """Cycles per instruction, from the traced steps after the alignment."""

    steps: int
    cached: float
    uncached: float
    serial: float


def load(mean_instructions: float, cycles_per_instruction: float) -> float:
    """Share of the processor that steps at 416 Hz take."""
    return mean_instructions * cycles_per_instruction * RATE_HZ / CLOCK_HZ


@dataclass(frozen=True)
class Assessment:
    """What a set of samples showed.

    Attributes:
        heap_functions: allocators in the linked program.
        stale_core: the host core was built from other sources than the target's program, so that
            a comparison says nothing.
    """

    run: TargetRun
    comparison: Comparison
    model: Model
    stack_bound_bytes: int
    heap_functions: Sequence[str]
    stale_core: bool

    @property
    def mean_instructions(self) -> float:
        """Of a step after the alignment."""
        return float(self.run.instructions[kinds.estimated(self.run)].mean())

    @property
    def mean_instructions_at_rest(self) -> float | None:
        """Of a step with a zero-velocity update; ``None`` when the bar never rested."""
        at_rest = self.run.instructions[kinds.at_rest(self.run)]
        return float(at_rest.mean()) if len(at_rest) else None


def assess(
    image: Image, samples: Batch, params: Params | None = None, *, progress: Progress = quiet
) -> Assessment:
    """Run, compare and count.

    Args:
        samples: longer than the estimator's alignment.

    Raises:
        RigError: no QEMU, a failed run, counts that contradict each other, or no step after the
            alignment.
        ValueError: the samples do not fit together, or the core refuses one of them.
    """
    params = params or Params()
    host = host_outputs(samples, params)
    target = run(image, samples, params, progress=progress)
    if not kinds.estimated(target).any():
        raise RigError("no step after the alignment", "give a longer set of samples")
    traced = first_steps(samples, min(TRACED_STEPS, len(target.instructions)))
    costs = trace.step_costs(image, traced, params)
    agree(target.instructions, costs)
    return Assessment(
        target,
        compare(host, target),
        _model(costs, kinds.estimated(target)),
        step_bound_bytes(image.elf.parent),
        heap_functions(image.elf),
        estimator_hash(project_root()) != ESTIMATOR_SHA256,
    )


def agree(counted: NDArray[np.int64], costs: Sequence[Cost]) -> None:
    """The virtual clock and the log of executed blocks must tell the same numbers.

    Raises:
        RigError: they do not differ by one and the same short call.
    """
    traced = np.array([cost.instructions for cost in costs])
    call = counted[: len(traced)] - traced
    if call.min() != call.max() or not 0 < call[0] <= STEP_CALL_INSTRUCTIONS:
        raise RigError(
            "the virtual clock and the executed blocks disagree on the number of instructions: "
            f"by {call.min()} to {call.max()} a step"
        )


def _model(costs: Sequence[Cost], estimated: NDArray[np.bool_]) -> Model:
    counted = [cost for cost, shown in zip(costs, estimated, strict=False) if shown] or costs
    total = sum(counted, Cost())
    n = total.instructions
    return Model(len(counted), total.cached / n, total.uncached / n, total.serial / n)


def _limits(line_id: str) -> Limits:
    """Of a line of the error budget that does not depend on the radio."""
    return line(line_id).limits(Conditions(conn_interval_us=0.0))


def measurements(found: Assessment) -> list[Measurement]:
    """The same as measurements; a kind of step that did not occur is unset."""
    target, model = found.run, found.model
    steps = int(kinds.estimated(target).sum())
    full = target.instructions[kinds.members(target, kinds.FULL)]
    longest = int(target.instructions[kinds.estimated(target)].max())
    first = found.comparison.first
    on = f"on {steps} steps, Cortex-M4F emulated by QEMU"
    return [
        Measurement(
            "pil.divergent_steps",
            found.comparison.divergent,
            "1",
            _limits("E1"),
            "E1",
            f"every output bit by bit against the host core {on}"
            + (f"; first at {first}" if first else "")
            + (f"; {STALE}" if found.stale_core else ""),
        ),
        Measurement(
            "pil.full_step_instructions_max",
            float(full.max()) if len(full) else None,
            "instructions",
            _limits("E2"),
            "E2",
            f"prefilter, prediction, rigid-body update, detector; {len(full)} such steps {on}",
        ),
        Measurement(
            "pil.longest_step_cycles",
            longest * model.serial,
            "cycles",
            _limits("E3"),
            "E3",
            f"{longest} instructions at {model.serial:.2f} cycles each, "
            f"model from {model.steps} traced steps",
            details={"instructions": longest, "cached_cycles": longest * model.cached},
        ),
        Measurement(
            "pil.load",
            load(found.mean_instructions, model.uncached),
            "1",
            _limits("E4"),
            "E4",
            f"{found.mean_instructions:.0f} instructions a step, {model.uncached:.2f} cycles each, "
            "416 steps a second, 64 MHz",
            details={
                "cached": load(found.mean_instructions, model.cached),
                "serial": load(found.mean_instructions, model.serial),
                "at_rest": {
                    "cached": load(rest, model.cached),
                    "uncached": load(rest, model.uncached),
                    "serial": load(rest, model.serial),
                }
                if (rest := found.mean_instructions_at_rest) is not None
                else {},
            },
        ),
        Measurement(
            "pil.step_stack_bound",
            found.stack_bound_bytes,
            "B",
            _limits("E5"),
            "E5",
            "deepest path through the compiler's call graph; painted stack of the run: "
            f"{target.step_stack_bytes} B",
        ),
        Measurement(
            "pil.heap_functions",
            len(found.heap_functions),
            "1",
            _limits("E6"),
            "E6",
            "allocators among the symbols of the linked program",
        ),
    ]
