# SPDX-License-Identifier: Apache-2.0
"""The detector of repetitions with bare compilers: no warning, no heap, no exception."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.unit.native import cached

LIB = Path(__file__).resolve().parents[3] / "firmware" / "lib"
FLAGS = (
    *("-std=c++17", "-O2", "-ffp-contract=off", "-fno-exceptions", "-fno-rtti", "-Werror"),
    *("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Wpedantic"),
)
TARGET = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
ALLOCATORS = ("malloc", "calloc", "realloc", "_Znw", "_Zna", "__cxa_throw")


@pytest.mark.parametrize(
    ("compiler", "nm", "machine"),
    [("g++", "nm", ()), ("arm-none-eabi-g++", "arm-none-eabi-nm", TARGET)],
    ids=["host", "cortex-m4"],
)
def test_the_library_stands_alone(
    compiler: str, nm: str, machine: tuple[str, ...], tmp_path: Path
) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    made = tmp_path / "reps.o"
    source = LIB / "reps" / "reps.cpp"
    include = ("-I", LIB / "reps", "-I", LIB / "wire")
    subprocess.run(
        [*cached(compiler), *machine, *FLAGS, *include, "-c", source, "-o", made], check=True
    )
    wanted = subprocess.run(
        [nm, "--undefined-only", made], check=True, capture_output=True, text=True
    ).stdout.split()
    assert not [name for name in wanted if name.startswith(ALLOCATORS)]
