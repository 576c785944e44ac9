# SPDX-License-Identifier: Apache-2.0
"""What the user waits for before anything begins: ``hil --help``, and the plugin in pytest."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import Row
from benchmarks.report import child

PLUGIN = """
import time, pytest
start = time.process_time()
import hil.plugin
print(time.process_time() - start)
"""
"""What is imported for the plugin alone, pytest being there already."""


def rows() -> list[Row]:
    return [_help(), _plugin()]


def _help() -> Row:
    run = [str(Path(sys.executable).with_name("hil")), "--help"]
    bare = [sys.executable, "-c", "import typer"]
    ours_s, _ = min(child(run) for _ in range(7))
    peer_s, _ = min(child(bare) for _ in range(7))
    met = ours_s <= 0.15
    return Row(
        work="hil --help",
        ours=f"{1e3 * ours_s:.0f} ms",
        peer=f"Python importing Typer: {1e3 * peer_s:.0f} ms",
        ratio=peer_s / ours_s,
        limit=None,
        aim="150 ms",
        met=met,
        lacking=""
        if met
        else f"{1e3 * ours_s - 150:.0f} ms over: Typer's import is most of it; a help that "
        "needs no Typer comes next",
    )


def _plugin() -> Row:
    took = []
    with tempfile.TemporaryDirectory() as elsewhere:
        for _ in range(7):
            told = subprocess.run(
                [sys.executable, "-c", PLUGIN],
                cwd=elsewhere,
                capture_output=True,
                text=True,
                check=True,
            ).stdout
            took.append(1e3 * float(told))
    ours_ms = min(took)
    return Row(
        work="loading the plugin in another project's pytest",
        ours=f"{ours_ms:.1f} ms (median {statistics.median(took):.1f})",
        peer="none",
        ratio=None,
        limit=None,
        aim="20 ms",
        met=ours_ms <= 20,
        lacking="" if ours_ms <= 20 else f"{ours_ms - 20:.0f} ms over",
    )
