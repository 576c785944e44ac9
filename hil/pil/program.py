# SPDX-License-Identifier: Apache-2.0
"""What is in a linked program."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from hil.build.toolchain import CROSS_PREFIX, MEND_CROSS
from hil.errors import BuildError
from hil.process import run

_ALLOCATORS: Final = (
    *("malloc", "calloc", "realloc", "free", "aligned_alloc", "posix_memalign", "_sbrk"),
    *("_malloc_r", "_calloc_r", "_realloc_r", "_free_r", "_sbrk_r"),
)
_OPERATORS: Final = ("_Znw", "_Zna", "_Zdl", "_Zda")
"""How the names of operator new and delete begin, with and without brackets."""


def symbols(program: Path) -> list[str]:
    """Names of everything that was linked.

    Raises:
        BuildError: the file is no program, or nm is missing.
    """
    listed = run(
        (f"{CROSS_PREFIX}nm", program),
        name="listing symbols",
        timeout_s=20,
        error=BuildError,
        mend=MEND_CROSS,
    )
    return [line.split()[-1] for line in listed.lines if line.strip()]


def heap_functions(program: Path) -> list[str]:
    """Those symbols of a program that allocate or free memory."""
    return [s for s in symbols(program) if s in _ALLOCATORS or s.startswith(_OPERATORS)]
