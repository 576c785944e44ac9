# SPDX-License-Identifier: Apache-2.0
"""The target's program on QEMU: samples in, outputs and instruction counts out.

Counting: with ``-icount shift=8`` each instruction takes 256 ns of virtual time, and a reading of
SysTick ends the block of instructions that it is in, so that time is never ahead or behind. The
board's SysTick runs at 25 MHz: 6.4 ticks an instruction, which tells counts apart exactly. Each
run proves it on blocks of known length before its figures are believed. A Thumb ``IT``, and an
instruction whose condition does not hold, count as one each.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import RigError
from hil.parity import Batch
from hil.pil import layout
from hil.pil.feed import encode
from hil.pil.image import Image, Progress, quiet
from hil.process import run as run_program
from hil.process import scratch
from hil.reference.params import Params

QEMU: Final = "qemu-system-arm"
MACHINE: Final = "mps2-an386"
MEND_QEMU: Final = "apt-get install qemu-system-arm"
ICOUNT_SHIFT: Final = 8
SYSTICK_HZ: Final = 25_000_000
TICKS_PER_INSTRUCTION: Final = 2**ICOUNT_SHIFT * SYSTICK_HZ / 1e9
COUNTED: Final = ("-icount", f"shift={ICOUNT_SHIFT}")
LOGGED: Final = ("-d", "in_asm,exec,nochain", "-D")
"""Not counted as well: counting cuts blocks short, and the log would not say where."""
KNOWN_INSTRUCTIONS: Final = (1, 2, 3, 100, 1000)
"""Lengths of the blocks that a run is proved on; firmware/pil/main.cpp."""
START_LIMIT_S: Final = 60.0
STEP_LIMIT_S: Final = 0.02
"""A hundred times what a step takes on a quiet machine."""


@dataclass(frozen=True)
class TargetRun:
    """What the emulated processor gave.

    Attributes:
        outputs: (n,) structured, one row per leader sample: :data:`hil.pil.layout.OUTPUT`. Rows
            whose ``status`` is not ESTIMATED hold zeros.
        instructions: (n,) executed by each step, its call included.
        followers: (n,) follower samples on each step.
        step_stack_bytes: deepest stack of any step below its caller.
        estimator_bytes: memory of parameters, coefficients and state together.
    """

    outputs: NDArray[np.void]
    instructions: NDArray[np.int64]
    followers: NDArray[np.int64]
    step_stack_bytes: int
    estimator_bytes: int


def run(
    image: Image, samples: Batch, params: Params | None = None, *, progress: Progress = quiet
) -> TargetRun:
    """Run the estimator on the emulated Cortex-M4F.

    Args:
        samples: of both IMUs, simulated or from a recording; see :func:`hil.pil.feed.encode`.
        params: as for the core; defaults if left out.
        progress: told the share that is done, 0..1, and what is being done.

    Raises:
        RigError: no QEMU, the program refused its input, faulted or took too long, or the counts
            of instructions cannot be trusted.
        ValueError: the samples do not fit together.
    """
    steps = len(samples.leader.t_ticks)
    data = encode(samples, params or Params())
    content = run_bytes(image, data, steps, progress)
    followers = np.bincount(np.asarray(samples.arrival, np.int64), minlength=steps)
    return _read(content, steps, followers.astype(np.int64))


def run_bytes(
    image: Image,
    data: bytes,
    steps: int,
    progress: Progress = quiet,
    log: Path | None = None,
) -> bytes:
    """Run an input file of about ``steps`` steps and return the output file.

    Args:
        log: where QEMU shall write the blocks of instructions that it runs: slow, 100 KB a step.

    Raises:
        RigError: as :func:`run`.
    """

    if shutil.which(QEMU) is None:
        raise RigError(f"there is no emulator {QEMU} for the Cortex-M4F", MEND_QEMU)

    def on_line(line: str) -> None:
        words = line.split()
        if words[:2] == ["pil:", "step"] and words[-1].isdecimal():
            progress(int(words[-1]) / max(steps, 1), f"step {words[-1]} of {steps}")

    with scratch("pil") as folder:
        (folder / "input.bin").write_bytes(data)
        run_program(
            (
                *(QEMU, "-M", MACHINE, "-nodefaults", "-display", "none"),
                *("-net", "none"),
                *("-semihosting-config", "enable=on,target=native"),
                *("-kernel", image.elf),
                *(COUNTED if log is None else (*LOGGED, log)),
            ),
            name="the estimator on the emulated processor",
            timeout_s=START_LIMIT_S + STEP_LIMIT_S * steps,
            cwd=folder,
            on_line=on_line,
        )
        return (folder / "output.bin").read_bytes()


def instructions(clock_ticks: NDArray[np.integer]) -> NDArray[np.int64]:
    """Ticks of SysTick to instructions; the rounding takes off at most one tick each way."""
    return np.rint(np.asarray(clock_ticks) / TICKS_PER_INSTRUCTION).astype(np.int64)


def _read(content: bytes, steps: int, followers: NDArray[np.int64]) -> TargetRun:
    wanted = steps * layout.OUTPUT.itemsize + layout.SUMMARY.itemsize
    if len(content) != wanted:
        raise RigError(f"the output file has {len(content)} bytes, {steps} steps need {wanted}")
    outputs = np.frombuffer(content, layout.OUTPUT, steps)
    summary = np.frombuffer(content, layout.SUMMARY, 1, steps * layout.OUTPUT.itemsize)[0]
    if summary["magic"] != layout.OUTPUT_MAGIC or summary["steps"] != steps:
        raise RigError("the output file does not end as it should")
    known = tuple(instructions(summary["known_ticks"]).tolist())
    if known != KNOWN_INSTRUCTIONS:
        raise RigError(
            f"blocks of {KNOWN_INSTRUCTIONS} instructions were counted as {known}",
            "this QEMU's virtual time does not count instructions: use version 7.2 or later",
        )
    return TargetRun(
        outputs,
        instructions(outputs["clock_ticks"]),
        followers,
        int(summary["step_stack_bytes"]),
        int(summary["estimator_bytes"]),
    )
