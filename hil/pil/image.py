# SPDX-License-Identifier: Apache-2.0
"""The program for the emulated processor: estimator, harness and linker script to one ELF file.

The estimator is compiled source by source with the options of its Zephyr library
(``firmware/lib/estimator/CMakeLists.txt``), so that the instructions counted are those of the
firmware. Nothing provides ``_sbrk``: a program that wants a heap does not link.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from hil.build.sources import project_root
from hil.build.toolchain import CROSS_PREFIX, MEND_CROSS
from hil.errors import BuildError
from hil.pil import layout
from hil.process import capture, run

COMPILER = f"{CROSS_PREFIX}g++"
MACHINE = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
CODE = (
    *("-std=c++17", "-fno-exceptions", "-fno-rtti", "-fno-strict-aliasing"),
    *("-ffunction-sections", "-fdata-sections", "-Wall", "-Wextra", "-Wdouble-promotion"),
    *("-DEIGEN_NO_DEBUG", "-fcallgraph-info=su"),
)
OPTIMISATION = ("-O2", "-ffp-contract=off")
"""What decides the number of instructions and the bits."""
LINK = ("-nostdlib", "-nostartfiles", "-Wl,--gc-sections")
LIBRARIES = ("-lm", "-lc", "-lgcc")
COMPILE_LIMIT_S = 300.0

SCRIPT = "mps2_an386.ld"

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Image:
    """A linked program.

    Attributes:
        elf: the file.
        optimisation: the options that decide the number of instructions and the bits.
        compiler: first line of what it says of itself.
    """

    elf: Path
    optimisation: tuple[str, ...]
    compiler: str


def quiet(share: float, what: str) -> None:
    """A progress that shows nothing."""


def build(
    *,
    optimisation: Sequence[str] = OPTIMISATION,
    link: Sequence[str] = (),
    folder: Path | None = None,
    progress: Progress = quiet,
) -> Image:
    """Compile and link, unless the same sources were built with the same options before.

    Args:
        optimisation: compiler options in place of the firmware's own.
        link: further options for the linker.
        folder: where builds are kept; ``build/pil`` of the checkout by default.
        progress: told the share that is done, 0..1, and what is being done.

    Raises:
        BuildError: no compiler, no Eigen, no sources, or the compiler said no.
    """
    root = project_root()
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise BuildError(f"there is no compiler {COMPILER} for the Cortex-M4F", MEND_CROSS)
    version = capture([compiler, "--version"]).partition("\n")[0]
    places = (root / "firmware" / "lib" / "estimator", root / "firmware" / "pil")
    flags = (*MACHINE, *CODE, *optimisation, "-isystem", str(eigen()))
    target = (folder or root / "build" / "pil") / _digest(places, (version, *flags))
    if not target.is_dir():
        # Only a build that came to its end gets the final name, whoever else builds the same.
        fresh = target.with_name(f"{target.name}.{os.getpid()}")
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir(parents=True)
        _compile((compiler, *flags), places, fresh, progress)
        with contextlib.suppress(OSError):
            fresh.rename(target)
        shutil.rmtree(fresh, ignore_errors=True)
    elf = target / (f"pil-{_hash(link)}.elf" if link else "pil.elf")
    if not elf.is_file():
        _link((compiler, *MACHINE, *LINK, *link), places[1] / SCRIPT, elf)
    return Image(elf, tuple(optimisation), version)


def _compile(
    command: Sequence[str], places: Sequence[Path], target: Path, progress: Progress
) -> None:
    """Every source in ``places`` to an object in ``target``."""
    (target / "pil_format.hpp").write_text(layout.header(), encoding="utf-8")
    include = [part for place in (*places, target) for part in ("-I", str(place))]
    sources = sorted(path for place in places for path in place.glob("*.cpp"))

    def compile_one(source: Path) -> str:
        argv = (*command, *include, "-c", str(source), "-o", str(target / f"{source.stem}.o"))
        run(
            argv,
            name=f"compiling {source.name}",
            timeout_s=COMPILE_LIMIT_S,
            error=BuildError,
            mend=f"if a standard header is missing: {MEND_CROSS}",
        )
        return source.name

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for n, name in enumerate(pool.map(compile_one, sources)):
            progress((n + 1) / (len(sources) + 1), name)


def _link(command: Sequence[str], script: Path, elf: Path) -> None:
    """All objects beside ``elf``."""
    fresh = elf.with_name(f"{elf.name}.{os.getpid()}")
    objects = [str(path) for path in sorted(elf.parent.glob("*.o"))]
    run(
        (*command, "-T", str(script), *objects, *LIBRARIES, "-o", str(fresh)),
        name="linking for the emulated processor",
        timeout_s=COMPILE_LIMIT_S,
        error=BuildError,
        mend="an undefined _sbrk means that something asks for a heap: use fixed sizes",
    )
    fresh.replace(elf)


def eigen() -> Path:
    """Folder of Eigen's headers.

    Raises:
        BuildError: the package is not installed.
    """
    try:
        found = distribution("cmeel-eigen")
    except PackageNotFoundError:
        raise BuildError(
            "there is no Eigen to compile the estimator with",
            "python -m pip install -e '.[build]'",
        ) from None
    return Path(str(found.locate_file("cmeel.prefix/include/eigen3")))


def _digest(folders: Sequence[Path], options: Sequence[str]) -> str:
    """Of everything that decides the objects."""
    content = [layout.header()]
    for path in sorted(path for folder in folders for path in folder.iterdir() if path.is_file()):
        content += [path.name, path.read_text(encoding="utf-8")]
    return _hash([*content, *options])


def _hash(parts: Sequence[str]) -> str:
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()[:16]
