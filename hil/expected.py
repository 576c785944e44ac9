# SPDX-License-Identifier: Apache-2.0
"""Expected outputs of the estimator: what today's core makes of the recordings in ``fixtures/``.

``python -m hil.expected`` writes one table per recording to ``fixtures/expected``;
``--check`` compares instead and fails on any difference. So every numerical change of the
estimator shows as a change of committed text, and is looked at. The core uses nothing but
+ - x / and square roots, in an order that does not depend on the machine, so twelve digits of
float64 are the same everywhere.
"""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hil.fusion.inputs import runs
from hil.fusion.replay import host_steps
from hil.library import find
from hil.recording import Recording, load
from hil.wire.messages import TICK_RATE_HZ

PERIOD_S = 0.5
COLUMNS = (
    ("centre_velocity_mps", 3),
    ("centre_height_m", 1),
    ("q", 4),
    ("b_a", 3),
    ("b_g", 3),
    ("variance", 15),
    ("q_madgwick", 4),
    ("flags", 1),
)


def main(arguments: list[str] | None = None) -> int:
    """Write or check; 0 when all is as expected."""
    parser = argparse.ArgumentParser(
        prog="python -m hil.expected",
        description="Write, or check, what the estimator makes of the recordings.",
        epilog="Example: python -m hil.expected --check",
    )
    parser.add_argument("--check", action="store_true", help="compare, and fail on a difference")
    parser.add_argument("--fixtures", type=Path, default=Path("fixtures"), metavar="FOLDER")
    options = parser.parse_args(arguments)
    expected: Path = options.fixtures / "expected"
    changed = 0
    for path in find(options.fixtures / "recordings"):
        text = table(load(path))
        if not text:
            continue
        file = expected / f"{path.parent.name}.csv"
        if options.check:
            changed += _differs(file, text)
        else:
            expected.mkdir(exist_ok=True)
            file.write_text(text, encoding="ascii")
            print(f"wrote {file}")
    if changed:
        print(
            f"{changed} tables differ: if the change is meant, run python -m hil.expected and "
            "look at the diff",
            file=sys.stderr,
        )
    return 1 if changed else 0


def table(recording: Recording) -> str:
    """CSV with a row every half second of every start of the estimator; empty without one."""
    lines = list(_rows(recording))
    return "" if not lines else "\n".join([",".join(_header()), *lines, ""])


def _header() -> list[str]:
    names = ["start", "t_s_leader"]
    for name, count in COLUMNS:
        names += [name] if count == 1 else [f"{name}_{k}" for k in range(count)]
    return names


def _rows(recording: Recording) -> Iterator[str]:
    for start, run in enumerate(runs(recording)):
        steps = host_steps(run, np.float64)
        t_s = steps["t_ticks"] / TICK_RATE_HZ
        if t_s.size == 0:
            continue
        at = np.searchsorted(t_s, np.arange(t_s[0], t_s[-1], PERIOD_S))
        for k in at.tolist():
            values = np.concatenate(
                [np.atleast_1d(steps[name][k]).astype(np.float64) for name, _ in COLUMNS]
            )
            yield ",".join([str(start), f"{t_s[k]:.7f}", *(f"{v:.12g}" for v in values)])


def _differs(file: Path, text: str) -> bool:
    have = file.read_text(encoding="ascii") if file.exists() else ""
    if have == text:
        return False
    diff = difflib.unified_diff(have.splitlines(), text.splitlines(), str(file), "now", n=0)
    for line in list(diff)[:6]:
        print(line[:200], file=sys.stderr)
    return True


if __name__ == "__main__":
    raise SystemExit(main())
