# SPDX-License-Identifier: Apache-2.0
"""Instructions of the host's C++ against committed counts: what a busy machine cannot blur.

``python -m tests.unit.test_instructions`` writes ``fixtures/instructions.json`` anew. The counts
are of one compiler; with another there is nothing to hold them against, and the test is skipped.
The target's counts are held by test_pil.py.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest

from tests.unit.native import cached

ROOT = Path(__file__).parents[2]
EXPECTED = ROOT / "fixtures" / "instructions.json"
ESTIMATOR, WIRE = ROOT / "firmware" / "lib" / "estimator", ROOT / "hil" / "wire" / "native"
TOLERANCE = 0.02
WORK = {"step": 10_000, "decode": 10}
"""Repetitions; the count is that of so many more on top of as many."""
PER = {"step": "a step of both sensors", "decode": "1,000 frames of 36 bytes"}


def compiler() -> str:
    told = subprocess.run(["g++", "--version"], capture_output=True, text=True, check=True)
    return told.stdout.splitlines()[0]


def built(folder: Path) -> Path:
    """The program, compiled from the sources that the core is made of, with its options."""
    eigen = distribution("cmeel-eigen").locate_file("cmeel.prefix/include/eigen3")
    options = ("-std=c++17", "-O2", "-ffp-contract=off")
    objects = []
    for source in (
        *sorted(ESTIMATOR.glob("*.cpp")),
        WIRE / "streams.cpp",
        ROOT / "tests" / "unit" / "c" / "instructions.cpp",
    ):
        objects.append(folder / f"{source.stem}.o")
        subprocess.run(
            [
                *(*cached("g++"), *options, f"-I{ESTIMATOR}", f"-I{WIRE}"),
                *("-isystem", str(eigen), "-c", str(source), "-o", str(objects[-1])),
            ],
            check=True,
        )
    program = folder / "instructions"
    subprocess.run(["g++", *map(str, objects), "-o", str(program)], check=True)
    return program


def counted(program: Path, work: str) -> int:
    """Instructions of one repetition of ``work``."""

    def total(times: int) -> int:
        told = subprocess.run(
            [
                *("valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"),
                *(str(program), work, str(times)),
            ],
            capture_output=True,
            text=True,
            check=True,
        ).stderr
        found = re.search(r"Collected : (\d+)", told)
        assert found, told
        return int(found[1])

    once = WORK[work]
    return round((total(2 * once) - total(once)) / once)


@pytest.fixture(scope="module")
def expected() -> dict[str, Any]:
    if shutil.which("valgrind") is None or shutil.which("g++") is None:
        pytest.skip("needs valgrind and g++: ci/debian-packages test")
    known: dict[str, Any] = json.loads(EXPECTED.read_text(encoding="utf-8"))
    if compiler() != known["compiler"]:
        pytest.skip(f"the counts are of {known['compiler']}")
    return known


@pytest.fixture(scope="module")
def program(expected: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("instructions"))


@pytest.mark.parametrize("work", WORK)
def test_no_more_instructions_than_before(
    program: Path, expected: dict[str, Any], work: str
) -> None:
    found, known = counted(program, work), expected["instructions"][work]
    assert abs(found / known - 1) <= TOLERANCE, (
        f"{PER[work]} takes {found:,} instructions, not {known:,}: "
        "if it is meant, python -m tests.unit.test_instructions"
    )


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as _folder:
        _program = built(Path(_folder))
        _counts = {work: counted(_program, work) for work in WORK}
    EXPECTED.write_text(
        json.dumps({"compiler": compiler(), "instructions": _counts}, indent=2) + "\n",
        encoding="utf-8",
    )
    print(_counts)
