# SPDX-License-Identifier: Apache-2.0
"""On the emulated Cortex-M4F, in instructions: the EKF's step, CRC, frames, and the FIFO's words.

``on_target/main.cpp`` runs the firmware's routines and what stands beside them in one program, and
checks that both come to the same. All are compiled as ``firmware/apps/common.conf`` has it: -O2.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.measure import Row
from hil import pil
from hil.build.sources import project_root
from hil.build.toolchain import CROSS_PREFIX, MEND_CROSS
from hil.errors import BuildError, HilError, RigError
from hil.parity import first_steps
from hil.pil import emulator, image
from hil.process import run, scratch

AIM: Final = 12_000
"""Instructions of the longest full step of the estimator."""
HAND_TUNED_AIM: Final = 2.0
STEPS: Final = 1_200
KNOWN: Final = 1_000
LIMIT_S: Final = 120.0
FIRMWARE: Final = ("lib/wire/framing.c", "drivers/lsm6dsox/lsm6dsox_decoder.c")
BESIDE: Final = (
    ("crc", "crc_table", "CRC-16 of 128 bytes on a Cortex-M4F", "byte-wise by a table of 512 B"),
    ("frame", "frame_hand", "COBS frame of 128 bytes, built", "by hand, CRC by table"),
    ("take", "take_hand", "COBS frame of 128 bytes, taken", "by hand, whole and in place"),
    ("fifo", "fifo_hand", "FIFO decode of 32 words", "by hand, no gaps or damage looked for"),
)
"""The firmware's routine, what it is held against, and their names in the table."""
NEXT: Final = {
    **dict.fromkeys(("crc", "frame", "take"), "the CRC by a table of 512 B comes next"),
    "fifo": "a profile of its short way comes next",
}
"""What to do about a routine that takes more than it may."""


def counts() -> dict[str, int]:
    """Instructions of each routine, by its name in the program.

    Raises:
        HilError: no compiler, no emulator, a routine that came to something else than its peer, or
            counts that cannot be trusted.
    """
    root = project_root()
    compiler = shutil.which(f"{CROSS_PREFIX}gcc"), shutil.which(f"{CROSS_PREFIX}g++")
    if None in compiler:
        raise BuildError("there is no compiler for the Cortex-M4F", MEND_CROSS)
    c, cpp = (str(one) for one in compiler)
    firmware = root / "firmware"
    own = Path(__file__).parent / "on_target" / "main.cpp"
    include = [
        part
        for place in ("lib/wire", "drivers/lsm6dsox", "lib/estimator", "pil")
        for part in ("-I", str(firmware / place))
    ]
    with scratch("target") as folder:
        objects = []
        for source in (*(firmware / one for one in FIRMWARE), firmware / "pil/startup.cpp", own):
            objects.append(folder / f"{source.stem}.o")
            command = (
                (c, *image.MACHINE, "-std=c11", "-O2", "-ffunction-sections")
                if source.suffix == ".c"
                else (cpp, *image.MACHINE, *image.CODE, *image.OPTIMISATION)
            )
            _compile((*command, *include, "-isystem", str(image.eigen())), source, objects[-1])
        elf = folder / "target.elf"
        run(
            (
                *(cpp, *image.MACHINE, *image.LINK, "-T", str(firmware / "pil" / image.SCRIPT)),
                *(*map(str, objects), *image.LIBRARIES, "-o", str(elf)),
            ),
            name="linking for the emulated processor",
            timeout_s=LIMIT_S,
            error=BuildError,
        )
        told = run(
            (
                *(emulator.QEMU, "-M", emulator.MACHINE, "-nodefaults", "-display", "none"),
                *("-net", "none", "-semihosting-config", "enable=on,target=native"),
                *("-kernel", elf, *emulator.COUNTED),
            ),
            name="routines on the emulated processor",
            timeout_s=LIMIT_S,
            cwd=folder,
            mend=emulator.MEND_QEMU,
        ).lines
    return read(told)


def read(lines: Sequence[str]) -> dict[str, int]:
    """What the program said: ``target: <name> <ticks>`` a line.

    Raises:
        RigError: a block of known length was counted otherwise.
    """
    found = {
        words[1]: round(int(words[2]) / emulator.TICKS_PER_INSTRUCTION)
        for words in map(str.split, lines)
        if len(words) == 3 and words[0] == "target:"
    }
    if found.pop("known", 0) != KNOWN:
        raise RigError(
            f"a block of {KNOWN} instructions was counted otherwise",
            "this QEMU's virtual time does not count instructions: use version 7.2 or later",
        )
    return found


def _compile(command: tuple[str, ...], source: Path, target: Path) -> None:
    run(
        (*command, "-c", str(source), "-o", str(target)),
        name=f"compiling {source.name}",
        timeout_s=LIMIT_S,
        error=BuildError,
        mend=MEND_CROSS,
    )


def rows() -> list[Row]:
    aim = f"{AIM:,} instructions at most"
    try:
        counted = counts()
        found = pil.assess(pil.build(), first_steps(pil.simulated("bench", 3), STEPS))
    except HilError as error:
        text = str(error).splitlines()[0]
        return [Row("EKF step on a Cortex-M4F", "not measured", text, None, None, aim, None)]
    judged = {one.name: one for one in pil.measurements(found)}
    longest = int(judged["pil.full_step_instructions_max"].value or 0)
    step = Row(
        work="EKF step on a Cortex-M4F",
        ours=f"{longest:,} instructions at most, {found.mean_instructions:,.0f} on average",
        peer=f"dense Eigen predict alone: {counted['predict_dense']:,}",
        ratio=counted["predict_dense"] / longest,
        limit=None,
        aim=aim,
        met=longest <= AIM,
        lacking="" if longest <= AIM else f"{longest / AIM:.2f} times",
    )
    return [step, *(_beside(counted, *one) for one in BESIDE)]


def _beside(counted: dict[str, int], own: str, peer: str, work: str, how: str) -> Row:
    times = counted[own] / counted[peer]
    return Row(
        work=work,
        ours=f"{counted[own]:,} instructions",
        peer=f"{how}: {counted[peer]:,}",
        ratio=1 / times,
        limit=None,
        aim=f"within {HAND_TUNED_AIM:g}x of hand-tuned",
        met=times <= HAND_TUNED_AIM,
        lacking="" if times <= HAND_TUNED_AIM else f"{times:.2f} times: {NEXT[own]}",
    )
