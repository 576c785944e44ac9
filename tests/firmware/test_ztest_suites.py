# SPDX-License-Identifier: Apache-2.0
"""Zephyr's own test suites of the firmware, built for the simulated board and run there.

Each folder in ``firmware/tests`` is one suite. The parts that are plain C are also tested on the
host, in ``tests/unit``.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SUITES = sorted(path.parent.name for path in (ROOT / "firmware" / "tests").glob("*/testcase.yaml"))
BUILD_LIMIT_S = 900
RUN_LIMIT_S = 300


def tail(text: str, lines: int = 60) -> str:
    return "\n".join(text.splitlines()[-lines:])


@pytest.mark.timeout(BUILD_LIMIT_S + RUN_LIMIT_S)
@pytest.mark.parametrize("suite", SUITES)
def test_suite(suite: str, build_environment: dict[str, str]) -> None:
    folder = ROOT / "build" / "ztest" / suite
    source = ROOT / "firmware" / "tests" / suite
    built = subprocess.run(
        [
            *(sys.executable, "-m", "west", "build", "--board", "nrf52_bsim"),
            *("--build-dir", str(folder), "--pristine", "auto", str(source)),
        ],
        cwd=build_environment["ZEPHYR_BASE"],
        env={**os.environ, **build_environment},
        capture_output=True,
        text=True,
        timeout=BUILD_LIMIT_S,
        check=False,
    )
    assert built.returncode == 0, tail(built.stdout + built.stderr)
    # No radio is needed, so no radio simulator either.
    ran = subprocess.run(
        [str(folder / "zephyr" / "zephyr.exe"), "-nosim", "-no-color"],
        capture_output=True,
        text=True,
        timeout=RUN_LIMIT_S,
        check=False,
    )
    output = ran.stdout + ran.stderr
    passed = re.findall(r"^.* - PASS - \[(\S+)\]", output, re.MULTILINE)
    failed = re.findall(r"^.* - FAIL - \[(\S+)\]", output, re.MULTILINE)
    assert "PROJECT EXECUTION SUCCESSFUL" in output, f"failed: {failed}\n{tail(output)}"
    assert passed, "the suite ran no test"
    assert ran.returncode == 0
    assert failed == []
