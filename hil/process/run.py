# SPDX-License-Identifier: Apache-2.0
"""Run a program to its end."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hil.errors import HilError, RigError
from hil.process.child import Child, describe_status

POLL_S = 0.1


@dataclass(frozen=True)
class Finished:
    """A program that ran to its end.

    Attributes:
        argv: what was run.
        status: exit status; negative for the signal that killed it.
        lines: standard output and error together, the last few thousand lines.
        wall_s: how long it took.
    """

    argv: tuple[str, ...]
    status: int
    lines: tuple[str, ...]
    wall_s: float

    @property
    def text(self) -> str:
        return "\n".join(self.lines)


def run(
    argv: Sequence[str | Path],
    *,
    name: str,
    timeout_s: float,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    on_line: Callable[[str], None] | None = None,
    check: bool = True,
    error: type[HilError] = RigError,
    mend: str = "",
) -> Finished:
    """Run ``argv`` to its end and return what it said.

    Args:
        timeout_s: the whole process group is killed after this long.
        on_line: called with each line of output as it comes.
        check: False leaves a non-zero exit status to the caller.
        error: type of what is raised.
        mend: what the user can do when it fails or is not there.

    Raises:
        HilError: as ``error``: no such program, too slow, or a non-zero exit status; the message
            ends with the program's own last words.
    """
    start_s = time.monotonic()
    with Child(argv, name=name, cwd=cwd, env=env, error=error, mend=mend) as child:
        while (line := _next_line(child, start_s + timeout_s, error, mend)) is not None:
            if on_line is not None:
                on_line(line)
        status = _wait(child, start_s + timeout_s, error, mend)
        if check and status != 0:
            raise error(
                f"{name} failed ({describe_status(status)}); its last words:\n{child.last_words()}",
                mend,
            )
        return Finished(child.argv, status, tuple(child.lines), time.monotonic() - start_s)


def _next_line(child: Child, deadline_s: float, error: type[HilError], mend: str) -> str | None:
    """The next line of output, or None at its end, watching the time."""
    while True:
        try:
            return child.next_line(POLL_S)
        except TimeoutError:
            # Asking ends what a dead program left behind, which may hold the output open.
            if child.exit_status() is None and time.monotonic() > deadline_s:
                raise _too_slow(child, error, mend) from None


def _wait(child: Child, deadline_s: float, error: type[HilError], mend: str) -> int:
    try:
        return child.wait(max(deadline_s - time.monotonic(), POLL_S))
    except TimeoutError:
        raise _too_slow(child, error, mend) from None


def _too_slow(child: Child, error: type[HilError], mend: str) -> HilError:
    return error(
        f"{child.name} was still running when its time was up, and was ended; "
        f"its last words:\n{child.last_words()}",
        mend,
    )


def capture(argv: Sequence[str | Path], *, cwd: Path | None = None, timeout_s: float = 20.0) -> str:
    """What a program says, stripped; empty when it is not there, fails or takes too long.

    For facts that are good to have and that nothing depends on, such as a tool's version.
    """
    try:
        finished = run(argv, name=str(argv[0]), timeout_s=timeout_s, cwd=cwd, check=False)
    except RigError:
        return ""
    return finished.text.strip() if finished.status == 0 else ""
