# SPDX-License-Identifier: Apache-2.0
"""Become another program that cannot outlive its parent: ``PARENT_PID CORE ARGV...``.

Run as a script of its own, because the kernel's "die with your parent" has to be asked for in the
child, and running Python code between fork and exec is not safe in a process with threads.
``CORE`` is the CPU to be pinned to, or ``-``.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1
EXIT_CANNOT_EXECUTE = 127


def die_with_parent(parent_pid: int) -> None:
    """Let the kernel kill this process when the thread that started it ends."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        sys.exit(f"prctl: {os.strerror(ctypes.get_errno())}")
    if os.getppid() != parent_pid:
        # The parent died before the request was in place.
        sys.exit(EXIT_CANNOT_EXECUTE)


def main(parent_pid: int, core: str, argv: list[str]) -> None:
    die_with_parent(parent_pid)
    if core != "-":
        os.sched_setaffinity(0, {int(core)})
    # Python ignores SIGPIPE; other programs expect the default.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    try:
        os.execv(argv[0], argv)  # noqa: S606 (an argument list, no shell)
    except OSError as error:
        print(f"{argv[0]}: {error.strerror}", file=sys.stderr)
        sys.exit(EXIT_CANNOT_EXECUTE)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], sys.argv[3:])
