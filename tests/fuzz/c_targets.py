# SPDX-License-Identifier: Apache-2.0
"""The targets in C: built with clang, libFuzzer, AddressSanitizer and UBSan."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import distribution
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
HERE: Final = Path(__file__).parent / "c"
FIRMWARE: Final = ROOT / "firmware"

SANITIZE: Final = (
    "-fsanitize=fuzzer,address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
)
FLAGS: Final = ("-g", "-O1", "-Wall", "-Wextra", *SANITIZE)
INSTALL: Final = "apt-get install --no-install-recommends clang libclang-rt-14-dev"


class NoClangError(Exception):
    """There is no clang with libFuzzer here; the text says how to get it."""


def build(target: str, folder: Path, firmware: Path = FIRMWARE) -> Path:
    """The program of ``c_frames`` or ``c_gatt`` from the sources under ``firmware``.

    Raises:
        NoClangError: no clang, or one without libFuzzer.
        subprocess.CalledProcessError: the sources do not compile.
    """
    if shutil.which("clang") is None or shutil.which("clang++") is None:
        raise NoClangError(f"{target} needs clang, which is not installed: {INSTALL}")
    folder.mkdir(parents=True, exist_ok=True)
    _check_runtime(target, folder)
    libraries = sorted(p for p in (firmware / "lib").iterdir() if p.is_dir())
    include = [HERE, HERE / "shim", *libraries, firmware / "drivers" / "lsm6dsox"]
    if target == "c_frames":
        include.append(ROOT / "tests" / "unit" / "c")
        frames = firmware / "lib" / "wire" / "framing.c"
        objects = [_compile(source, folder, include) for source in (HERE / "c_frames.c", frames)]
    else:
        sync = [firmware / "lib" / "timesync" / f"sync_{n}.c" for n in _SYNC]
        estimator = [
            firmware / "lib" / "fusion" / "fusion.cpp",
            *sorted((firmware / "lib" / "estimator").glob("*.cpp")),
            HERE / "gatt_estimator.cpp",
        ]
        plain = [HERE / "c_gatt.c", firmware / "lib" / "node" / "peer.c", *sync, *estimator]
        leader, follower = (firmware / "apps" / role / "src" for role in ("leader", "follower"))
        with ThreadPoolExecutor(2) as pool:
            objects = list(pool.map(lambda source: _compile(source, folder, include), plain))
        objects.append(_compile(HERE / "gatt_leader.c", folder, [leader, *include]))
        objects.append(_compile(HERE / "gatt_follower.c", folder, [follower, *include]))
    program = folder / target
    _run(["clang++", *SANITIZE, *map(str, objects), "-lm", "-o", str(program)])
    return program


_SYNC: Final = ("math", "pairing", "estimator", "wire")


def _compile(source: Path, folder: Path, include: Sequence[Path]) -> Path:
    """The object of one source; compiled anew only when it, a header or a flag has changed."""
    if source.suffix == ".cpp":
        eigen = str(distribution("cmeel-eigen").locate_file("cmeel.prefix/include/eigen3"))
        compiler = ["clang++", "-std=c++17", "-isystem", eigen]
    else:
        compiler = ["clang", "-std=c11"]
    command = [*compiler, *FLAGS, *(f"-I{path}" for path in include)]
    digest = hashlib.sha256(repr((compiler, FLAGS)).encode())
    # The application's own sources are included like headers.
    inputs = [
        p
        for place in include
        for p in place.glob("*.[ch]*")
        if "apps" in place.parts or p.suffix in (".h", ".hpp")
    ]
    for path in (source, *sorted(inputs)):
        digest.update(path.read_bytes())
    output = folder / f"{source.stem}-{digest.hexdigest()[:16]}.o"
    if not output.exists():
        unfinished = output.with_suffix(".part")
        _run([*command, "-c", str(source), "-o", str(unfinished)])
        unfinished.replace(output)
    return output


def _check_runtime(target: str, folder: Path) -> None:
    probe = folder / "probe.c"
    probe.write_text("int LLVMFuzzerTestOneInput(const char *d, long n) { return d && n < 0; }\n")
    done = subprocess.run(
        ["clang", *SANITIZE, str(probe), "-o", str(folder / "probe")],
        capture_output=True,
        check=False,
    )
    if done.returncode:
        raise NoClangError(f"{target} needs clang's libFuzzer and sanitizers: {INSTALL}")


def _run(command: list[str]) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True)
