# SPDX-License-Identifier: Apache-2.0
"""The estimator on an emulated Cortex-M4F: equal bits, and what a step costs there."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hil import pil
from hil.build.toolchain import MEND_CROSS
from hil.errors import BuildError, RecordingError, RigError
from hil.measure import Verdict
from hil.motion import lifts
from hil.parity import Batch, batch, first_steps
from hil.pil import emulator, image, kinds, layout
from hil.pil.assess import Assessment, agree, assess, measurements
from hil.pil.cycles import Cost
from hil.pil.feed import encode
from hil.reference.params import Params
from hil.reference.study import simulate

RECORDINGS = Path(__file__).parents[2] / "fixtures" / "recordings"
STEPS = 1200
ALIGNMENT_STEPS = 209
SLOPPY_STEPS = 400
"""Enough to miss the bits, from the first step after alignment on, and each limit."""
SLOPPY = ("-Os", "-ffp-contract=fast", "-DEIGEN_STRONG_INLINE=inline")
"""What the firmware's options keep away: calls where Eigen counts on inlining, fused sums."""

pytestmark = pytest.mark.skipif(
    shutil.which(image.COMPILER) is None or shutil.which(emulator.QEMU) is None,
    reason=f"needs {image.COMPILER} and {emulator.QEMU}. {MEND_CROSS}\n{emulator.MEND_QEMU}",
)


@cache
def samples() -> Batch:
    """A rest and the beginning of a repetition: every kind of step."""
    lift = lifts.bench(3, reps=1, rests=True)
    return first_steps(batch(*simulate(lift, 3)), STEPS)


@cache
def built(optimisation: tuple[str, ...] = image.OPTIMISATION) -> pil.Image:
    return pil.build(optimisation=optimisation)


@cache
def assessed() -> Assessment:
    return assess(built(), samples())


def verdicts(found: Assessment) -> dict[str, Verdict]:
    return {one.name: one.verdict for one in measurements(found)}


def test_every_output_has_the_host_cores_bits() -> None:
    found = assessed()
    assert not found.stale_core, "the host core is of other sources: pip install -e ."
    assert found.comparison.first is None
    assert found.comparison.steps == STEPS - ALIGNMENT_STEPS


def test_a_recording_comes_to_the_same_bits() -> None:
    """What the leader was fed in a run, and what it was started with."""
    fed, params = pil.recorded(RECORDINGS / "imu-rest")
    found = assess(built(), first_steps(fed, 800), params)
    assert found.comparison.first is None
    assert found.comparison.steps > 500


def test_a_recording_without_an_imu_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no recording at"):
        pil.recorded(tmp_path)


def test_the_firmwares_build_keeps_every_limit() -> None:
    found = assessed()
    present = {kind.name for kind in kinds.by_kind(found.run) if kind.steps}
    assert present == {kind.name for kind in kinds.by_kind(found.run)}
    assert set(verdicts(found).values()) <= {Verdict.PASS, Verdict.MARGINAL}


def test_another_build_breaks_bits_and_limits() -> None:
    found = assess(built(SLOPPY), first_steps(samples(), SLOPPY_STEPS))
    first = found.comparison.first
    assert first is not None
    assert first.step >= ALIGNMENT_STEPS
    assert first.host_bits != first.target_bits
    bad = {name for name, verdict in verdicts(found).items() if verdict is Verdict.FAIL}
    assert {
        "pil.divergent_steps",
        "pil.full_step_instructions_max",
        "pil.longest_step_cycles",
        "pil.load",
    } <= bad


@pytest.mark.parametrize("step", [600, 1100])
def test_one_flipped_bit_of_the_input_is_found_at_its_step(step: int) -> None:
    data = bytearray(encode(samples(), Params()))
    data[leader_sample(step) + layout.SAMPLE.fields["accel_mps2"][1] + 1] ^= 0x10
    content = emulator.run_bytes(built(), bytes(data), STEPS)
    outputs = np.frombuffer(content, layout.OUTPUT, STEPS)
    run = dataclasses.replace(assessed().run, outputs=outputs)
    found = pil.compare(pil.host_outputs(samples()), run)
    assert found.first is not None
    assert found.first.step == step
    assert f"step {step}" in str(found.first)


def test_counts_are_the_same_every_time() -> None:
    again = pil.run(built(), samples())
    np.testing.assert_array_equal(again.instructions, assessed().run.instructions)
    assert again.outputs.tobytes() == assessed().run.outputs.tobytes()


def test_the_bound_on_the_stack_holds_and_is_not_idle() -> None:
    found = assessed()
    assert 0 < found.run.step_stack_bytes <= found.stack_bound_bytes
    assert found.stack_bound_bytes <= 1.5 * found.run.step_stack_bytes


def test_a_program_that_asks_for_a_heap_does_not_link() -> None:
    with pytest.raises(BuildError, match="_sbrk"):
        pil.build(link=("-Wl,-u,malloc",))


def header_word(name: str) -> int:
    return int(layout.HEADER.fields[name][1])


def leader_sample(step: int) -> int:
    """Offset of a step's leader sample in the input file."""
    words = int(np.frombuffer(encode(samples(), Params()), layout.HEADER, 1)["parameter_words"][0])
    before = int((samples().arrival < step).sum())
    return (
        layout.HEADER.itemsize
        + 4 * words
        + step * (layout.STEP.itemsize + layout.SAMPLE.itemsize)
        + before * layout.SAMPLE.itemsize
        + layout.STEP.itemsize
    )


def poked(offset: int, byte: int) -> Callable[[bytes], bytes]:
    return lambda data: data[:offset] + bytes([byte]) + data[offset + 1 :]


Harm = Callable[[bytes], bytes]
HOSTILE: dict[str, Callable[[], Harm]] = {
    "wrong magic": lambda: poked(0, 0),
    "another version": lambda: poked(header_word("version"), 99),
    "other parameters": lambda: poked(header_word("parameter_names"), 0x5A),
    "ends early": lambda: lambda data: data[:-1],
    "goes on after": lambda: lambda data: data + bytes(1),
    "too many follower": lambda: poked(leader_sample(7) - layout.STEP.itemsize, 17),
    "more follower samples than": lambda: poked(header_word("followers") + 1, 0),
    "fewer follower samples than": lambda: poked(header_word("followers") + 1, 0xFF),
    "neither 0 nor 1": lambda: poked(leader_sample(7) + layout.SAMPLE.itemsize - 4, 2),
    "rate_hz must be positive": lambda: poked(layout.HEADER.itemsize + 3, 0xC3),
}


@pytest.mark.parametrize("complaint", HOSTILE)
def test_hostile_input_is_refused_with_its_reason(complaint: str) -> None:
    data = HOSTILE[complaint]()(encode(samples(), Params()))
    with pytest.raises(RigError, match=complaint):
        emulator.run_bytes(built(), data, STEPS)


def test_a_missing_compiler_is_named_with_the_way_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(BuildError, match=re.escape(image.COMPILER)) as caught:
        pil.build()
    assert "apt-get install gcc-arm-none-eabi" in caught.value.mend


def test_a_missing_emulator_is_named_with_the_way_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = built()
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(RigError, match=emulator.QEMU) as caught:
        emulator.run_bytes(found, b"", 0)
    assert "apt-get install qemu-system-arm" in caught.value.mend


def test_the_command_says_which_lifts_there_are() -> None:
    built()
    result = subprocess.run(
        [sys.executable, "-c", "from hil.cli import main; main()", "pil", "sprint"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 2
    assert "no lift 'sprint'" in result.stderr
    assert "snatch" in result.stderr


def test_counts_that_contradict_each_other_are_refused() -> None:
    counted = np.array([113, 213, 314])
    agree(counted[:2], [Cost(100), Cost(200)])
    with pytest.raises(RigError, match="disagree"):
        agree(counted, [Cost(100), Cost(200), Cost(300)])
