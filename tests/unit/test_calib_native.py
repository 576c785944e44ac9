# SPDX-License-Identifier: Apache-2.0
"""The calibration maths with bare compilers: no warning, no heap, no exception, no Zephyr."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from importlib.metadata import distribution
from pathlib import Path

import pytest

from hil.core import ESTIMATOR_SHA256
from tests.unit.native import cached

ROOT = Path(__file__).resolve().parents[2]
CALIB = ROOT / "firmware" / "lib" / "calib"
SOURCES = [CALIB / "allan.cpp", CALIB / "fit.cpp"]
FLAGS = (
    *("-std=c++17", "-O1", "-ffp-contract=off", "-fno-exceptions", "-fno-rtti"),
    *("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"),
)
ALLOCATORS = {
    *("malloc", "calloc", "realloc", "aligned_alloc", "posix_memalign"),
    *("_Znwm", "_Znwj", "_Znam", "_Znaj", "_ZnwmSt11align_val_t"),
}


def compiled(compiler: str, target: tuple[str, ...], source: Path, folder: Path) -> Path:
    eigen = distribution("cmeel-eigen").locate_file("cmeel.prefix/include/eigen3")
    output = folder / f"{source.stem}.o"
    include = ("-isystem", str(eigen), "-I", CALIB)
    subprocess.run(
        [*cached(compiler), *target, *FLAGS, *include, "-c", source, "-o", output], check=True
    )
    return output


def wanted_symbols(nm: str, compiled_object: Path) -> set[str]:
    listing = subprocess.run(
        [nm, "--undefined-only", compiled_object], check=True, capture_output=True, text=True
    )
    return {line.split()[-1] for line in listing.stdout.splitlines()}


def hosts_compiler() -> str:
    found = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++")
    assert found, "no C++ compiler: install g++, or set CXX"
    return found


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.name)
def test_host(source, tmp_path):
    wanted = wanted_symbols("nm", compiled(hosts_compiler(), (), source, tmp_path))
    assert not wanted & ALLOCATORS
    assert not {s for s in wanted if s.startswith("__cxa_throw")}


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.name)
def test_cortex_m4(source, tmp_path):
    compiler = shutil.which("arm-none-eabi-g++")
    if compiler is None:
        pytest.skip("no arm-none-eabi-g++: apt-get install gcc-arm-none-eabi")
    target = ("-mcpu=cortex-m4", "-mthumb")
    wanted = wanted_symbols("arm-none-eabi-nm", compiled(compiler, target, source, tmp_path))
    assert not wanted & ALLOCATORS


def test_the_symbols_of_a_sinner_are_found(tmp_path):
    sinner = tmp_path / "sinner.cpp"
    sinner.write_text("int *f() { return new int; }\n")
    assert wanted_symbols("nm", compiled(hosts_compiler(), (), sinner, tmp_path)) & ALLOCATORS


@pytest.mark.parametrize("path", sorted(CALIB.glob("*.?pp")), ids=lambda path: path.name)
def test_the_maths_knows_no_zephyr(path):
    text = path.read_text(encoding="utf-8")
    assert not [h for h in ("<zephyr/", "<nrf", "<hal/", "<soc") if f"#include {h}" in text]


def test_the_estimators_hash_is_over_the_estimator_alone():
    """A recording that names its estimator must not age because a fit has changed."""
    files = sorted((ROOT / "firmware" / "lib" / "estimator").glob("*.?pp"))
    hashes = "".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
    assert hashlib.sha256(hashes.encode()).hexdigest() == ESTIMATOR_SHA256
