# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks``: every row, each module in a process of its own, and the table.

``--only NAME`` measures one module; ``--keep`` writes the table into docs/performance.md.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance.md"
OUTPUT = ROOT / "build" / "bench" / "bench.json"
BEGIN, END = "<!-- bench: begin -->", "<!-- bench: end -->"
TIMEOUT_S = 240.0
"""For one module: a machine that takes longer has something else to do."""
MODULES = (
    *("decode", "load", "replay", "sweep", "edges", "sync"),
    *("report", "simulated", "target", "cli", "memory"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point. Returns 0 when every module ran, whether or not its rows meet their aims."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--only", choices=MODULES, action="append", help="may be repeated")
    parser.add_argument("--keep", action="store_true", help=f"write the table into {PAGE.name}")
    parser.add_argument("--one", choices=MODULES, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.one:
        print(json.dumps([asdict(row) for row in import_module(f"benchmarks.{args.one}").rows()]))
        return 0
    known: dict[str, list[dict[str, Any]]] = {}
    failed: list[str] = []
    if args.only and OUTPUT.exists():
        known = json.loads(OUTPUT.read_text(encoding="utf-8"))["rows"]
    for name in args.only or MODULES:
        start = time.monotonic()
        try:
            told = subprocess.run(
                [sys.executable, "-m", "benchmarks", "--one", name],
                cwd=ROOT,
                stdout=subprocess.PIPE,
                text=True,
                check=True,
                timeout=TIMEOUT_S,
            ).stdout
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            print(f"{name}: {error}", file=sys.stderr)
            failed.append(name)
            continue
        known[name] = json.loads(told.splitlines()[-1])
        document = {"machine": machine(), "rows": {n: known[n] for n in MODULES if n in known}}
        OUTPUT.parent.mkdir(parents=True, exist_ok=True)
        OUTPUT.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        print(f"{name}: {time.monotonic() - start:.0f} s", file=sys.stderr)
        for row in known[name]:
            print(f"  {row['work']}: {row['ours']} | {row['peer']} | {_met(row)}", flush=True)
    if args.keep and known:
        page = PAGE.read_text(encoding="utf-8")
        before, after = page.split(BEGIN)[0], page.split(END)[1]
        PAGE.write_text(f"{before}{BEGIN}\n\n{table(document)}\n{END}{after}", encoding="utf-8")
    return 1 if failed else 0


def machine() -> str:
    """The processor, its number, memory, system and the versions that matter."""
    cpu = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
            if line.startswith("model name")
        ),
        platform.machine(),
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return (
        f"{cpu}, {len(os.sched_getaffinity(0))} processors, {memory:.0f} GiB; "
        f"{platform.system()} {platform.release()}, Python {platform.python_version()}, "
        f"NumPy {version('numpy')}, PyArrow {version('pyarrow')}; load {os.getloadavg()[2]:.1f}"
    )


def table(document: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        f"Measured on: {document['machine']}.\n",
        "| work | ours | beside it | times the peer | share of the limit | aim | met |",
        "|---|---|---|---|---|---|---|",
    ]
    for rows in document["rows"].values():
        for row in rows:
            ratio = f"{row['ratio']:.3g}" if row["ratio"] else "–"
            limit = f"{row['limit']:.1%}" if row["limit"] else "–"
            cells = row["work"], row["ours"], row["peer"], ratio, limit, row["aim"], _met(row)
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _met(row: dict[str, Any]) -> str:
    if row["met"] is None:
        return "not measured"
    return "yes" if row["met"] else f"no: {row['lacking'] or 'see below'}"


if __name__ == "__main__":
    sys.exit(main())
