# SPDX-License-Identifier: Apache-2.0
"""Every input that the fuzzers keep, and every one they once fell over, without a fuzzer."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.fuzz import c_targets, imports, recording, settings, wire

FUZZ = Path(c_targets.__file__).parent
BUILD = c_targets.ROOT / "build" / "fuzz"
CORPUS_BYTES_MAX = 300_000
TARGETS: dict[str, Callable[[bytes], None]] = {
    "wire": wire.run,
    "recording": recording.run,
    "imports": imports.run,
    "settings": settings.run,
}


def inputs(target: str) -> list[Path]:
    return sorted(p for kind in ("corpus", "findings") for p in (FUZZ / kind / target).glob("*"))


@pytest.mark.parametrize("target", TARGETS)
def test_a_python_target_takes_all_that_is_kept(target: str) -> None:
    kept = inputs(target)
    assert kept
    for path in kept:
        try:
            TARGETS[target](path.read_bytes())
        except Exception as error:
            pytest.fail(f"{path.relative_to(FUZZ)}: {type(error).__name__}: {error}")


@pytest.mark.parametrize("target", ["c_frames", "c_gatt"])
def test_a_c_target_takes_all_that_is_kept(target: str) -> None:
    program = BUILD / target / target
    if not program.exists():
        pytest.skip(f"{target} is not built: run `ci/fuzz 1 {target}`")
    done = subprocess.run(
        [str(program), *map(str, inputs(target))], capture_output=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-2000:]


def test_the_corpora_stay_small() -> None:
    size = sum(p.stat().st_size for p in (FUZZ / "corpus").rglob("*") if p.is_file())
    assert 0 < size < CORPUS_BYTES_MAX
