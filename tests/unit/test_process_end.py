# SPDX-License-Identifier: Apache-2.0
"""However a program of ours ends, nothing that it started or made for itself outlives it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.process import scratch
from hil.process.guard import running
from hil.process.pool import pool
from tests.unit.test_process import gone, until

SESSION = '''
import sys
from hil.process import run
# A grandchild in a process group of its own, as ninja gives each compiler.
CODE = """
import os, time
if os.fork() == 0:
    os.setpgid(0, 0)
    print(os.getppid(), os.getpid(), flush=True)
time.sleep(1000)
"""
run([sys.executable, "-c", CODE], name="x", timeout_s=1000,
    on_line=lambda line: print(line, flush=True))
'''


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_grandchildren_in_groups_of_their_own_end_with_the_owner(number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SESSION],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as owner:
        assert owner.stdout is not None
        pids = [int(word) for word in owner.stdout.readline().split()]
        assert len(set(pids)) == 2
        owner.send_signal(number)
        owner.wait(20)
    assert all(gone(pid) for pid in pids)


COMMAND = """
import sys, time
from pathlib import Path
from hil.process import end_in_order, scratch
end_in_order()
with scratch("test", Path(sys.argv[1])) as folder:
    (folder / "file").touch()
    print("ready", flush=True)
    time.sleep(1000)
"""


@pytest.mark.parametrize(
    ("number", "status"),
    [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGKILL, -9), (signal.SIGINT, -2)],
)
def test_scratch_folders_go_and_the_exit_status_tells_the_signal(
    tmp_path: Path, number: signal.Signals, status: int
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", COMMAND, str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as command:
        assert command.stdout is not None
        command.stdout.readline()
        assert len(list(tmp_path.iterdir())) == 1
        command.send_signal(number)
        assert command.wait(20) == status
    until(lambda: not list(tmp_path.iterdir()))


def test_nohup_is_respected() -> None:
    code = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from hil.process import end_in_order; end_in_order()\n"
        "import os; os.kill(os.getpid(), signal.SIGHUP); print('on')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "on\n"


def test_a_scratch_folder_is_private_and_gone_after_the_block() -> None:
    with scratch("test") as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
        assert folder.name.startswith("hil-test-")
    assert not folder.exists()


POOLED = """
import os, time
from hil.process.pool import pool
def work(_):
    os.write(1, b"%d\\n" % os.getpid())
    time.sleep(1000)
if __name__ == "__main__":
    with pool(2) as workers:
        list(workers.map(work, range(2)))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_their_owner_in_the_middle_of_their_work(
    number: signal.Signals, tmp_path: Path
) -> None:
    program = tmp_path / "pooled.py"
    program.write_text(POOLED)
    with subprocess.Popen(
        [sys.executable, str(program)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as owner:
        assert owner.stdout is not None
        workers = [int(owner.stdout.readline()) for _ in range(2)]
        begin_s = time.monotonic()
        owner.send_signal(number)
        owner.wait(20)
        assert time.monotonic() - begin_s < 15
    assert all(gone(pid) for pid in workers)


def test_a_pool_gives_results_in_order() -> None:
    with pool(2) as workers:
        assert list(workers.map(abs, [-1, 2, -3])) == [1, 2, 3]


def test_the_processes_of_a_session_are_found() -> None:
    with subprocess.Popen(["sleep", "100"], start_new_session=True) as sleeper:
        assert running(sleeper.pid) == [sleeper.pid]
        sleeper.kill()
    assert running(sleeper.pid) == []
    assert os.getpid() in running(os.getsid(0))
