# SPDX-License-Identifier: Apache-2.0
"""Parts of the processor in the loop that need neither compiler nor emulator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil.core import Estimator, Samples
from hil.errors import RigError
from hil.parity import Batch
from hil.pil import kinds, layout
from hil.pil.compare import compare
from hil.pil.cycles import Cost, Instruction, block_cost, cycles
from hil.pil.emulator import TargetRun, instructions
from hil.pil.feed import encode
from hil.pil.kinds import by_kind
from hil.pil.samples import simulated
from hil.pil.stack import step_bound_bytes
from hil.pil.trace import parse
from hil.reference.params import Params

STEP = "_ZN2bv9EstimatorIfE4stepEv"


def target_run(host: np.ndarray, steps: int) -> TargetRun:
    """What a perfect target would send."""
    outputs = np.zeros(steps, layout.OUTPUT)
    outputs["status"] = 1
    outputs["status"][host["step"]] = 0
    for name in set(host.dtype.names) - {"step"}:
        outputs[name][host["step"]] = host[name]
    zeros = np.zeros(steps, np.int64)
    return TargetRun(outputs, zeros, zeros, 0, 0)


def host_rows() -> np.ndarray:
    rows = np.zeros(4, Estimator(dtype=np.float32).dtype)
    rows["step"] = [2, 3, 4, 5]
    rows["gate"] = np.nan
    rows["v"] = np.arange(12).reshape(4, 3)
    return rows


def test_the_target_sends_every_field_of_the_host_core() -> None:
    host = Estimator(dtype=np.float32).dtype
    for name in set(host.names or ()) - {"step"}:
        assert layout.OUTPUT[name].shape == host[name].shape, name


def test_members_are_aligned_to_their_size() -> None:
    for dtype in (layout.HEADER, layout.STEP, layout.SAMPLE, layout.OUTPUT, layout.SUMMARY):
        for field in dtype.names:
            base, offset = dtype.fields[field]
            assert offset % base.base.itemsize == 0, field
        assert dtype.itemsize % 8 == 0


def test_equal_outputs_are_equal_and_nans_have_no_sign() -> None:
    host = host_rows()
    run = target_run(host, 6)
    run.outputs["gate"][host["step"]] = -np.nan
    assert run.outputs["gate"].view(np.uint32)[5] != host["gate"].view(np.uint32)[3]
    found = compare(host, run)
    assert (found.steps, found.divergent, found.first) == (4, 0, None)


def test_one_bit_is_a_divergence_with_step_and_field() -> None:
    host = host_rows()
    run = target_run(host, 6)
    run.outputs["v"].view(np.uint32)[4, 2] ^= 1
    run.outputs["flags"][5] = 1
    found = compare(host, run)
    assert found.divergent == 2
    assert found.first is not None
    assert (found.first.step, found.first.field) == (4, "v[2]")
    assert found.first.host_bits ^ found.first.target_bits == 1
    assert "step 4, v[2]" in str(found.first)


@pytest.mark.parametrize(("step", "status"), [(1, 0), (4, 1), (0, 3)])
def test_an_output_on_one_side_only_is_a_divergence(step: int, status: int) -> None:
    host = host_rows()
    run = target_run(host, 6)
    run.outputs["status"][step] = status
    found = compare(host, run)
    assert found.first is not None
    assert (found.first.step, found.first.field) == (step, "status")


def test_negative_zero_is_not_zero() -> None:
    host = host_rows()
    run = target_run(host, 6)
    run.outputs["v"][2, 0] = -0.0
    assert compare(host, run).divergent == 1


@pytest.mark.parametrize("name", ["no update, no follower", kinds.FULL])
def test_each_step_is_of_one_kind(name: str) -> None:
    rng = np.random.default_rng(5)
    outputs = np.zeros(3000, layout.OUTPUT)
    outputs["flags"] = rng.integers(0, 2**16, 3000) & rng.integers(0, 2**16, 3000)
    outputs["status"] = rng.integers(0, 2, 3000)
    run = TargetRun(outputs, np.ones(3000, np.int64), rng.integers(0, 3, 3000), 0, 0)
    *parts, everything = by_kind(run)
    assert sum(part.steps for part in parts) == 3000
    assert everything.steps == int((outputs["status"] == 0).sum())
    assert next(part for part in parts if part.name == name).steps > 0


def test_ticks_to_instructions_survive_the_rounding_of_the_clock() -> None:
    exact = np.arange(1, 5000)
    for slip in (-1, 0, 1):
        ticks = np.floor(exact * 6.4).astype(np.int64) + slip
        np.testing.assert_array_equal(instructions(ticks), exact)


@pytest.mark.parametrize(
    ("mnemonic", "operands", "expected"),
    [
        ("movs", "r0, #1", 1),
        ("vmul.f32", "s0, s1, s2", 2),
        ("vdiv.f32", "s0, s1, s2", 15),
        ("vsqrt.f32", "s0, s1", 15),
        ("vfma.f32", "s0, s1, s2", 4),
        ("vmov", "r0, r1, s2, s3", 2),
        ("vldr", "s0, [r1]", 2),
        ("vldr", "d0, [r1]", 3),
        ("ldrd", "r0, r1, [r2]", 3),
        ("push.w", "{r4, r5, r6, lr}", 5),
        ("vpush", "{d8, d9, d10}", 7),
        ("vldmia", "r3!, {s12-s15}", 5),
        ("pop", "{r4, pc}", 6),
        ("udiv", "r0, r1, r2", 12),
        ("bne", "#0x10", 4),
        ("bic.w", "r0, r0, #1", 1),
        ("bl", "#0x10", 4),
    ],
)
def test_cycles_are_the_manuals(mnemonic: str, operands: str, expected: int) -> None:
    assert cycles(mnemonic, operands) == expected


def test_a_block_waits_for_the_flash() -> None:
    """Four words of cheap code: 8 cycles of work, 3 a word and one word more to fetch."""
    assert block_cost([Instruction("movs", "r0, #1", 2)] * 8) == Cost(8, 8, 15, 18)
    dear = [Instruction("vdiv.f32", "s0, s0, s0", 4)] * 2
    assert block_cost(dear) == Cost(2, 30, 30, 36)
    constant = [Instruction("vldr", "s0, [pc, #0x10]", 4)]
    assert block_cost(constant) == Cost(1, 2, 6, 8)


LOG = f"""\
----------------
IN: main
0x00000010:  2001       movs     r0, #1
0x00000012:  f000 f806  bl       #0x22

Trace 0: 0x7f00 [00800408/00000010/00000110/ff000200] main
----------------
IN: {STEP}
0x00000022:  2001       movs     r0, #1
0x00000024:  2001       movs     r0, #1
0x00000026:  4770       bx       lr

Trace 0: 0x7f01 [00800408/00000022/00000110/ff000200] {STEP}
Stopped execution of TB chain before 0x7f01 [00000022] {STEP}
Trace 0: 0x7f01 [00800408/00000022/00000110/ff000200] {STEP}
----------------
IN: main
0x00000016:  e7fb       b        #0x10

Trace 0: 0x7f02 [00800408/00000016/00000110/ff000200] main
Trace 0: 0x7f00 [00800408/00000010/00000110/ff000200] main
Trace 0: 0x7f01 [00800408/00000022/00000110/ff000200] {STEP}
Trace 0: 0x7f02 [00800408/00000016/00000110/ff000200] main
"""


def test_the_log_is_cut_into_steps() -> None:
    assert [step.instructions for step in parse(LOG.splitlines())] == [3, 3]


def graph(folder: Path, *lines: str) -> Path:
    (folder / "x.ci").write_text("\n".join(lines), encoding="utf-8")
    return folder


def node(name: str, size: str) -> str:
    return f'node: {{ title: "{name}" label: "{name}\\nx.cpp:1:2\\n{size}" }}'


def edge(caller: str, called: str) -> str:
    return f'edge: {{ sourcename: "{caller}" targetname: "{called}" label: "x.cpp:1:2" }}'


def test_the_stack_is_bounded_by_the_deepest_path(tmp_path: Path) -> None:
    found = step_bound_bytes(
        graph(
            tmp_path,
            node(f"/a/x.cpp:{STEP}", "100 bytes (static)"),
            node("_Za", "30 bytes (static)"),
            node("_Zb", "20 bytes (static)"),
            edge(STEP, "_Za"),
            edge(f"/a/x.cpp:{STEP}", "_Zb"),
            edge("_Zb", "memcpy"),
        )
    )
    assert found == 100 + 20 + 64


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ((node(STEP, "8 bytes (static)"), edge(STEP, STEP)), "calls itself"),
        ((node(STEP, "8 bytes (dynamic)"),), "no fixed size"),
        ((node(STEP, "8 bytes (static)"), edge(STEP, "__indirect_call")), "pointer"),
        ((node(STEP, "8 bytes (static)"), edge(STEP, "_Zunknown")), "knows no frame"),
        ((node("_Zother", "8 bytes (static)"),), "no call graph"),
    ],
)
def test_a_stack_without_a_bound_is_refused(
    tmp_path: Path, lines: tuple[str, ...], complaint: str
) -> None:
    with pytest.raises(RigError, match=complaint):
        step_bound_bytes(graph(tmp_path, *lines))


def few(n: int) -> Samples:
    return Samples(np.arange(1, n + 1) * 38462, np.zeros((n, 3)), np.zeros((n, 3)))


@pytest.mark.parametrize(
    ("arrival", "complaint"),
    [
        ([0] * 17, "17 follower samples on step 0"),
        ([1, 0], "never fall"),
        ([5], "never fall"),
        ([-1], "never fall"),
    ],
)
def test_samples_that_cannot_be_sent_are_refused(arrival: list[int], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        encode(Batch(few(3), few(len(arrival)), np.array(arrival)), Params())


def test_an_unknown_lift_is_refused_with_those_there_are() -> None:
    with pytest.raises(RigError, match="no lift 'sprint'") as caught:
        simulated("sprint", 1)
    assert "snatch" in caught.value.mend
