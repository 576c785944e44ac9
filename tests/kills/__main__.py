# SPDX-License-Identifier: Apache-2.0
"""Stops commands at random times in random ways and looks at what is left.

``python -m tests.kills --count 200 --seed 1``; see docs/interruption.md. Exit status 1 when an
invariant did not hold.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.kills import commands, strike
from tests.kills.commands import Command
from tests.kills.invariants import ORPHAN, UNREADABLE, broken


@dataclass(frozen=True)
class Trial:
    command: str
    kind: str
    after_s: float
    status: int | None
    broken: Sequence[str]
    skipped: str = ""


def trial(command: Command, kind: str, dice: random.Random, folder: Path) -> Trial:
    """One command, struck once, in a new folder."""
    out, scratch = folder / "out", folder / "tmp"
    out.mkdir(parents=True)
    scratch.mkdir()
    after_s = dice.uniform(0.0, 1.05 * command.took_s)
    assert command.reference is not None
    size_b = command.room_b or sum(map(len, command.reference.values()))
    try:
        if kind in (strike.FULL, strike.READ_ONLY):
            assert command.disk is not None
            room_b = round(dice.uniform(0.0, 0.95) * size_b)
            with strike.disk(command.disk(out), kind, room_b):
                struck = command.run(out, scratch, kind)
                found = broken(command, kind, struck, out, scratch)
        else:
            struck = command.run(out, scratch, kind, after_s)
            found = broken(command, kind, struck, out, scratch)
    except PermissionError as error:
        return Trial(command.name, kind, after_s, None, (), f"cannot mount: {error}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return Trial(command.name, kind, after_s, struck.status, found)


def trials(count: int, seed: int, names: Sequence[str], folder: Path) -> list[Trial]:
    """``count`` trials over all commands and kinds; each command runs whole before and after."""
    dice = random.Random(seed)
    done = []
    with commands.all_of(folder, names) as ready:
        for command in ready:
            commands.measure(command, folder / "measure")
            print(f"hil {command.name}: {command.took_s:.1f} s", flush=True)
        pairs = [
            (command, kind)
            for kind in strike.KINDS
            for command in ready
            if command.disk or kind not in (strike.FULL, strike.READ_ONLY)
        ]
        chosen: list[tuple[Command, str]] = []
        while len(chosen) < count:
            chosen += dice.sample(pairs, min(len(pairs), count - len(chosen)))
        for number, (command, kind) in enumerate(chosen, 1):
            one = trial(command, kind, dice, folder / f"trial-{number}")
            done.append(one)
            verdict = "; ".join(one.broken) or one.skipped or "sound"
            print(
                f"{number:3} hil {one.command}, {kind} at {one.after_s:.2f} s, "
                f"status {one.status}: {verdict}",
                flush=True,
            )
        for command in {command.name: command for command, _ in chosen}.values():
            # After all that, it still does its work.
            commands.measure(command, folder / "measure")
    return done


def table(done: Sequence[Trial]) -> str:
    """Kinds by commands: how many held, of how many."""
    names = sorted({one.command for one in done})
    count = Counter((one.command, one.kind) for one in done if not one.skipped)
    bad = Counter((one.command, one.kind) for one in done if one.broken)
    lines = ["| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for kind in strike.KINDS:
        cells = [
            f"{count[n, kind] - bad[n, kind]}/{count[n, kind]}" if count[n, kind] else "–"
            for n in names
        ]
        lines.append(f"| {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("commands", nargs="*", help=", ".join((*commands.HERE, "build", "record")))
    options = parser.parse_args()
    begin_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hil-kills-") as folder:
        done = trials(options.count, options.seed, options.commands, Path(folder))
    print(table(done))
    bad = sum(bool(one.broken) for one in done)
    skipped = sum(bool(one.skipped) for one in done)
    said = [sentence for one in done for sentence in one.broken]
    orphans, unreadable = (sum(s.startswith(what) for s in said) for what in (ORPHAN, UNREADABLE))
    print(
        f"killed {len(done) - skipped}, sound {len(done) - skipped - bad}, orphans {orphans}, "
        f"unreadable {unreadable}; skipped {skipped}, seed {options.seed}, "
        f"{time.monotonic() - begin_s:.0f} s"
    )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
