# SPDX-License-Identifier: Apache-2.0
"""The firmware's plain C parts as shared libraries of the host, for the tests to call.

Where there is ccache, the slow compilers go through it: what was compiled before, from the same
text with the same options, is not compiled again.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Werror")
"""For code that also runs on the target."""
USUAL = ("-Wall", "-Wextra", "-O2")


def cached(compiler: str) -> tuple[str, ...]:
    """The compiler as the beginning of a command."""
    found = shutil.which("ccache")
    return (found, compiler) if found else (compiler,)


def shared_library(
    output: Path,
    sources: Iterable[Path],
    include: Iterable[Path],
    options: Iterable[str] = STRICT,
) -> ctypes.CDLL:
    """Compile ``sources`` as C11 to ``output`` and load it."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    assert compiler, "no C compiler found: install gcc or clang"
    subprocess.run(
        [
            *(*cached(compiler), "-std=c11", *options, "-shared", "-fPIC"),
            *(f"-I{folder}" for folder in include),
            *map(str, sources),
            *("-lm", "-o", str(output)),
        ],
        check=True,
    )
    return ctypes.CDLL(str(output))
