# SPDX-License-Identifier: Apache-2.0
"""Real commands stopped at random times; ``python -m tests.kills`` does it hundreds of times."""

from __future__ import annotations

import itertools
import os
import random
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.kills import commands, strike
from tests.kills.__main__ import trial
from tests.kills.commands import Command
from tests.kills.invariants import broken

SEED = 20_11
DICE = random.Random(SEED)
LOG = ("ctrl-c", "term-group", "kill", strike.CLOSED, strike.FULL)
CSV = ("int", "hup", "kill-group", strike.FULL, strike.READ_ONLY)


@pytest.fixture(scope="module", params=["log", "export-csv"])
def command(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Command]:
    folder = tmp_path_factory.mktemp("kills")
    with commands.all_of(folder, [request.param]) as (one,):
        commands.measure(one, folder / "measure")
        yield one


def test_whenever_a_command_is_stopped_nothing_is_left_and_nothing_is_half(
    command: Command, tmp_path: Path
) -> None:
    skipped = []
    for number, kind in enumerate(LOG if command.name == "log" else CSV):
        found = trial(command, kind, DICE, tmp_path / str(number))
        assert not found.broken, (SEED, found)
        skipped += [found.skipped] * bool(found.skipped)
    if skipped:
        pytest.skip(skipped[0])


BAD = """
import os, subprocess, sys, time
from pathlib import Path
out, how = Path(sys.argv[1]), sys.argv[2]
if how == "half":
    (out / "set.csv").write_text("t,")
elif how == "hidden":
    (out / ".set.csv.abcd").write_text("t,")
elif how == "scratch":
    Path(os.environ["TMPDIR"], "left").mkdir()
elif how == "recording":
    (out / "log.mcap").write_bytes(b"")
elif how == "orphan":
    subprocess.Popen(["sleep", "60"], start_new_session=True)
elif how == "lock":
    lock = open(out.parent / "lock", "w")
    import fcntl
    fcntl.flock(lock, fcntl.LOCK_EX)
    subprocess.Popen(["sleep", "20"], pass_fds=[lock.fileno()], env={}, start_new_session=True)
elif how == "traceback":
    raise OSError(28, "No space left on device")
"""


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("half", "not whole: set.csv"),
        ("hidden", "hidden file left"),
        ("scratch", "left in the folder for temporary files: left"),
        ("recording", "unreadable: log.mcap"),
        ("orphan", "process left"),
        ("lock", "is held"),
        ("traceback", "a traceback instead of an error"),
    ],
)
def test_each_invariant_can_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str, said: str
) -> None:
    monkeypatch.setattr("tests.kills.invariants.GONE_LIMIT_S", 0.3)
    out, scratch = tmp_path / "out", tmp_path / "tmp"
    out.mkdir()
    scratch.mkdir()
    program = tmp_path / "bad.py"
    program.write_text(textwrap.dedent(BAD))
    made = Command(
        "bad", lambda _: [], records=True, locks=lambda: [tmp_path / "lock"],
        reference={"set.csv": b"t,value\n" * 100},
    )  # fmt: skip
    struck = strike.run(
        [sys.executable, str(program), str(out), how],
        {**os.environ, "TMPDIR": str(scratch)},
        tmp_path,
        strike.FULL,
    )
    try:
        found = broken(made, strike.FULL, struck, out, scratch)
        assert len(found) == 1, found
        assert said in found[0]
    finally:
        for line in strike.marked(struck.mark):
            os.kill(int(line.partition(":")[0]), 9)


def test_a_command_that_ignores_the_signal_counts_as_hanging(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(strike, "END_LIMIT_S", 0.5)
    code = "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(60)"
    struck = strike.run([sys.executable, "-c", code], os.environ, tmp_path, "term", 1.0)
    assert struck.status is None


def test_closing_the_terminal_hangs_up_what_runs_on_it(tmp_path: Path) -> None:
    code = "import time; time.sleep(60)"
    struck = strike.run([sys.executable, "-c", code], os.environ, tmp_path, strike.CLOSED, 0.3)
    assert struck.status == -1
    assert struck.took_s < 30


def test_the_small_share_has_every_kind() -> None:
    assert set(itertools.chain(LOG, CSV)) == {*strike.KINDS} - {"term"}
