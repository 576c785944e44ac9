# SPDX-License-Identifier: Apache-2.0
"""Starting other programs: what they say is kept, what they leave behind is ended."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hil.errors import BuildError, RigError
from hil.process import Child, Guard, capture, run

ROOT = Path(__file__).parents[2]


def gone(pid: int, limit_s: float = 5.0) -> bool:
    """True when the process ends, or is a zombie that only waits for its parent, in time."""
    deadline_s = time.monotonic() + limit_s
    while time.monotonic() < deadline_s:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state in "ZX":
            return True
        time.sleep(0.02)
    return False


def until(happens: Callable[[], bool], limit_s: float = 10.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not happens():
        assert time.monotonic() < deadline_s, "did not happen in time"
        time.sleep(0.02)


def test_output_arrives_line_by_line_in_order() -> None:
    seen: list[str] = []
    finished = run(
        ["bash", "-c", "echo one; echo two >&2; printf 'three\\rfour\\nno newline'"],
        name="talker",
        timeout_s=10,
        on_line=seen.append,
    )
    assert seen == ["one", "two", "three", "four", "no newline"]
    assert finished.lines == tuple(seen)
    assert finished.status == 0


def test_output_is_streamed_while_the_program_runs(tmp_path: Path) -> None:
    """The callback can let the program go on: it would wait for ever if output came at the end."""
    flag = tmp_path / "flag"
    finished = run(
        ["bash", "-c", f"echo ready; until [ -e {flag} ]; do sleep 0.02; done; echo done"],
        name="waiter",
        timeout_s=10,
        on_line=lambda line: flag.touch() if line == "ready" else None,
    )
    assert finished.lines == ("ready", "done")


def test_bytes_that_are_not_text_do_not_break_the_reader() -> None:
    assert run(["printf", "\\xff\\xfe\\n"], name="p", timeout_s=10).lines == ("\ufffd\ufffd",)


def test_a_failed_program_shows_its_own_last_words() -> None:
    with pytest.raises(BuildError) as caught:
        run(
            ["bash", "-c", "echo before; echo 'cannot find -lfoo' >&2; exit 27"],
            name="the linker",
            timeout_s=10,
            error=BuildError,
            mend="apt-get install libfoo",
        )
    assert "the linker failed (exit status 27)" in caught.value.message
    assert caught.value.message.endswith("    before\n    cannot find -lfoo")
    assert "apt-get install libfoo" in str(caught.value)


def test_a_program_killed_by_a_signal_is_told_by_its_name() -> None:
    with pytest.raises(RigError, match="killed by SIGSEGV"):
        run(["bash", "-c", "kill -SEGV $$"], name="crasher", timeout_s=10)


def test_the_caller_can_take_the_exit_status_himself() -> None:
    assert run(["bash", "-c", "exit 3"], name="x", timeout_s=10, check=False).status == 3


def test_a_missing_program_is_named_with_the_mend() -> None:
    with pytest.raises(BuildError) as caught:
        run(["no-such-tool"], name="x", timeout_s=1, error=BuildError, mend="install it")
    assert "'no-such-tool'" in str(caught.value)
    assert "install it" in str(caught.value)


def test_a_missing_working_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="there is no folder"):
        run(["true"], name="x", timeout_s=1, cwd=tmp_path / "gone")


def test_shell_lines_are_refused() -> None:
    with pytest.raises(TypeError, match="never a shell line"):
        run("echo hello", name="x", timeout_s=1)


def test_too_slow_ends_the_whole_group() -> None:
    seen: list[str] = []
    with pytest.raises(RigError, match="time was up") as caught:
        run(
            ["bash", "-c", "sleep 1000 & echo $!; echo busy; wait"],
            name="sleeper",
            timeout_s=0.5,
            on_line=seen.append,
        )
    assert "busy" in str(caught.value)
    assert gone(int(seen[0]))


def test_what_a_program_leaves_running_is_ended_with_it() -> None:
    """The forgotten grandchild also holds the output open, which must not delay the end."""
    start_s = time.monotonic()
    finished = run(["bash", "-c", "sleep 1000 & echo $!"], name="x", timeout_s=60)
    assert time.monotonic() - start_s < 10
    assert gone(int(finished.lines[0]))


def test_an_exception_in_the_block_ends_the_program() -> None:
    with pytest.raises(KeyError), Child(["sleep", "1000"], name="sleeper") as child:  # noqa: PT012
        pid = child.pid
        raise KeyError
    assert gone(pid)


def test_a_polite_stop_lets_the_program_finish(tmp_path: Path) -> None:
    mark = tmp_path / "farewell"
    script = f"trap 'touch {mark}; exit 0' TERM; echo ready; while :; do sleep 0.05; done"
    with Child(["bash", "-c", script], name="polite") as child:
        assert child.next_line(10) == "ready"
        assert child.stop() == 0
    assert mark.exists()


EVERY_BYTE = "import sys; [sys.stdout.buffer.write(bytes(range(256))) for _ in range(4096)]"


def test_binary_output_is_passed_on_byte_for_byte_apart_from_what_the_program_says() -> None:
    got = bytearray()
    code = EVERY_BYTE + "; print('done', file=sys.stderr)"
    with Child([sys.executable, "-c", code], name="x", on_bytes=got.extend) as child:
        assert child.next_line(10) == "done"
        assert child.wait(10) == 0
        child.stop()
    assert got == bytes(range(256)) * 4096
    assert list(child.lines) == ["done"]


def test_binary_output_is_streamed_and_a_program_can_be_told_to_end() -> None:
    got: list[bytes] = []
    with Child(["cat"], name="cat", on_bytes=got.append, hold_input=True) as child:
        child.send(b"\x00\xff")
        until(lambda: b"".join(got) == b"\x00\xff")
        child.send(b"\n")
        until(lambda: b"".join(got) == b"\x00\xff\n")
        child.stop()


def test_a_sink_that_fails_is_told_and_does_not_hang_the_program() -> None:
    def refuse(_: bytes) -> None:
        raise OSError("disk full")

    with Child([sys.executable, "-c", EVERY_BYTE], name="x", on_bytes=refuse) as child:
        assert child.wait(10) == 0
        child.stop()
    assert str(child.refusal) == "disk full"


def test_a_program_without_input_cannot_be_told_anything() -> None:
    with Child(["sleep", "10"], name="x") as child, pytest.raises(TypeError, match="input"):
        child.send(b"q")


def test_pinning_to_a_core() -> None:
    core = max(os.sched_getaffinity(0))
    code = "import os; print(os.sched_getaffinity(0))"
    with Child([sys.executable, "-c", code], name="x", core=core) as child:
        assert child.next_line(10) == f"{{{core}}}"


def test_every_program_has_a_group_of_its_own() -> None:
    code = "import os; print(os.getpgrp() == os.getpid() != os.getppid())"
    assert run([sys.executable, "-c", code], name="x", timeout_s=10).lines == ("True",)


OWNER = """
import sys
from hil.process import run
run(["bash", "-c", "sleep 1000 & echo $! $$; wait"], name="x", timeout_s=1000,
    on_line=lambda line: print(line, flush=True))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_the_program_does_not_outlive_its_owner(number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", OWNER], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as owner:
        assert owner.stdout is not None
        _, shell = (int(part) for part in owner.stdout.readline().split())
        owner.send_signal(number)
        owner.wait(10)
    assert gone(shell)


GUARDED = """
import subprocess, sys, time
from pathlib import Path
from hil.process import Guard
with Guard() as guard:
    folder = Path(sys.argv[1])
    guard.watch_folder(folder)
    folder.mkdir()
    (folder / "file").touch()
    sleeper = subprocess.Popen(["sleep", "1000"], start_new_session=True)
    guard.watch_session(sleeper.pid)
    print(sleeper.pid, flush=True)
    time.sleep(1000)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_the_guard_cleans_up_after_a_killed_owner(tmp_path: Path, number: signal.Signals) -> None:
    folder = tmp_path / "shared"
    with subprocess.Popen(
        [sys.executable, "-c", GUARDED, str(folder)], stdout=subprocess.PIPE, text=True
    ) as owner:
        assert owner.stdout is not None
        sleeper = int(owner.stdout.readline())
        assert folder.is_dir()
        owner.send_signal(number)
        owner.wait(10)
    assert gone(sleeper)
    until(lambda: not folder.exists())


def test_the_guard_deletes_folders_on_a_normal_end_and_is_gone(tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    with Guard() as guard:
        guard.watch_folder(folder)
        folder.mkdir()
        process = guard._process
        assert process is not None
        assert process.poll() is None
    assert not folder.exists()
    assert process.poll() == 0


def test_capture_gives_facts_or_nothing() -> None:
    assert capture(["echo", " fact "]) == "fact"
    assert capture(["no-such-tool"]) == ""
    assert capture(["bash", "-c", "echo nonsense; exit 1"]) == ""


def starts_programs(node: ast.AST) -> bool:
    match node:
        case ast.Import(names=names):
            return any(alias.name.partition(".")[0] == "subprocess" for alias in names)
        case ast.ImportFrom(module=str(module)):
            return module.partition(".")[0] == "subprocess"
        case ast.Attribute(value=ast.Name(id="os"), attr=name):
            return name in ("system", "popen", "fork") or name.startswith(
                ("spawn", "exec", "posix")
            )
    return False


def test_programs_are_started_nowhere_else() -> None:
    for path in sorted((ROOT / "hil").rglob("*.py")):
        if path.is_relative_to(ROOT / "hil" / "process"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            assert not starts_programs(node), f"{path}:{node.lineno} starts programs itself"


@pytest.mark.parametrize(
    "text", ["import subprocess", "from subprocess import run", "os.system('x')"]
)
def test_the_search_for_starters_can_find_them(text: str) -> None:
    assert any(starts_programs(node) for node in ast.walk(ast.parse(text)))
