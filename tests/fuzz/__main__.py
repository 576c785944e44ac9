# SPDX-License-Identifier: Apache-2.0
"""Runs the fuzz targets: ``python -m tests.fuzz [SECONDS] [TARGET...]``; see docs/hardening.md."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from tests.fuzz import c_targets

HERE = Path(__file__).parent
BUILD = c_targets.ROOT / "build" / "fuzz"
INPUT_TIMEOUT_S = 20

PYTHON = {"wire": 2000, "recording": 8000, "imports": 5000, "settings": 5000}
"""Target -> longest input in bytes."""
C = {"c_frames": 2000, "c_gatt": 600}
LENGTH_MAX = {**PYTHON, **C}


@dataclass(frozen=True)
class Outcome:
    """``finding`` is the input that broke the target, or empty; ``failed`` says why none ran."""

    line: str
    finding: str = ""
    failed: str = ""


def command(target: str, firmware: Path) -> list[str]:
    """What runs ``target``; a C target is built first."""
    if target in C:
        return [str(c_targets.build(target, BUILD / target, firmware))]
    if find_spec("atheris") is None:
        raise c_targets.NoClangError(f"{target} needs atheris: pip install --editable '.[dev]'")
    return [sys.executable, "-m", "tests.fuzz.python_target", target]


def prepare(target: str, firmware: Path) -> list[str] | Outcome:
    """:func:`command`, or why there is none."""
    try:
        return command(target, firmware)
    except c_targets.NoClangError as error:
        return Outcome("", failed=str(error))
    except subprocess.CalledProcessError as error:
        return Outcome("", failed=f"{target} does not compile:\n{error.stderr[-2000:]}")


def run(target: str, program: list[str], seconds: int) -> Outcome:
    grown = BUILD / "corpus" / target
    found = BUILD / "found" / target
    shutil.rmtree(found, ignore_errors=True)
    for folder in (grown, found):
        folder.mkdir(parents=True, exist_ok=True)
    before = sum(1 for _ in grown.iterdir())
    kept = (HERE / "corpus" / target, HERE / "findings" / target)
    seeds = [folder for folder in kept if folder.is_dir()]
    argv = [
        *program,
        f"-max_total_time={seconds}",
        f"-timeout={INPUT_TIMEOUT_S}",
        "-rss_limit_mb=1500",
        f"-max_len={LENGTH_MAX[target]}",
        f"-artifact_prefix={found}/",
        *map(str, (grown, *seeds)),
    ]
    words = HERE / f"{target}.dict"
    argv += [f"-dict={words}"] if words.exists() else []
    log = BUILD / f"{target}.log"
    with log.open("wb") as out:
        # A target that hangs in native code does not even hear its own alarm.
        limit_s = seconds + 10 * INPUT_TIMEOUT_S
        try:
            code = subprocess.run(
                argv, stdout=out, stderr=out, cwd=c_targets.ROOT, timeout=limit_s, check=False
            ).returncode
        except subprocess.TimeoutExpired:
            code = -1
    return outcome(target, code, log, found, sum(1 for _ in grown.iterdir()) - before)


def outcome(target: str, code: int, log: Path, found: Path, growth: int) -> Outcome:
    text = log.read_text(errors="replace")
    runs = re.findall(r"^#(\d+)\s", text, re.M)
    coverage = re.findall(r"cov: (\d+)", text)
    figures = (
        f"{int(runs[-1]) if runs else 0:>9} runs  coverage {coverage[-1] if coverage else 0:>5}  "
        f"corpus +{growth:<5}"
    )
    findings = sorted(found.iterdir())
    if findings:
        return Outcome(f"{target:<10} {figures} FINDING", str(findings[0]))
    if code or not runs or not coverage:
        return Outcome(f"{target:<10} {figures} FAILED", failed=f"{target} ended badly: see {log}")
    return Outcome(f"{target:<10} {figures} no finding")


def main() -> int:
    parser = argparse.ArgumentParser(prog="ci/fuzz", description="Run the fuzz targets.")
    parser.add_argument("seconds", type=int, nargs="?", default=60, help="of each target (60)")
    parser.add_argument("target", nargs="*", help=f"some of {', '.join(LENGTH_MAX)}; else all")
    parser.add_argument("--firmware", type=Path, default=c_targets.FIRMWARE, help="sources in C")
    said = parser.parse_args()
    unknown = sorted(set(said.target) - set(LENGTH_MAX))
    if unknown:
        parser.error(f"no target is called {', '.join(unknown)}: there are {', '.join(LENGTH_MAX)}")
    targets = said.target or [*C, *PYTHON]
    os.environ.setdefault("PYTHONHASHSEED", "0")
    print(f"{len(targets)} targets at once, {said.seconds} s by the clock", flush=True)
    began = time.monotonic()
    bad: list[str] = []
    with ThreadPoolExecutor(len(targets)) as pool:
        # All are built before the first begins, or a compiler would take part of its time.
        programs = list(pool.map(lambda target: prepare(target, said.firmware), targets))
        running = {
            target: program
            if isinstance(program, Outcome)
            else pool.submit(run, target, program, said.seconds)
            for target, program in zip(targets, programs, strict=True)
        }
        for target, future in running.items():
            done = future if isinstance(future, Outcome) else future.result()
            if done.line:
                print(done.line, flush=True)
            if done.finding:
                bad.append(how_to_mend(target, done.finding))
            if done.failed:
                bad.append(done.failed)
    print(f"{time.monotonic() - began:.0f} s")
    for text in bad:
        print(f"\n{text}", file=sys.stderr)
    return 1 if bad else 0


def how_to_mend(target: str, finding: str) -> str:
    again = (
        f"build/fuzz/{target}/{target} {finding}"
        if target in C
        else f".venv/bin/python -m tests.fuzz.python_target {target} {finding}"
    )
    return (
        f"{target}: {finding}\n"
        f"  again:  {again}\n"
        f"  log:    build/fuzz/{target}.log\n"
        f"  mended: keep it as tests/fuzz/findings/{target}/<what it was>"
    )


if __name__ == "__main__":
    sys.exit(main())
