# SPDX-License-Identifier: Apache-2.0
"""The commands that are struck: real ones, each on a copy of what it would change."""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from struct import unpack_from

from hil.build import find_babblesim, find_workspace, manifest
from hil.build.sources import SOURCE_FOLDERS
from hil.errors import BuildError
from hil.recording import load
from tests.bench.virtual.world import Port, World
from tests.kills import strike

ROOT = Path(__file__).parents[2]
CLEAN = ROOT / "fixtures/recordings/clean-7ms5"
LOG_S = 3.0
LINKED_B = 16_000_000
"""About what a link of an image and what goes with it write."""
TREE = "HIL_KILLS_TREE"
SCENARIO = """name = "struck"
duration_s = 6
seed = 3
[motion]
lift = "squat"
seed = 21
"""


@dataclass
class Command:
    """A command of ``hil``.

    Attributes:
        arguments: given the folder to write to, what comes after ``hil``.
        records: its ``.mcap`` files are recordings, readable at any time; else they are outputs.
        disk: the folder that may be full or read-only, given the one to write to; None: none.
        room_b: what a run writes there, when that is not the size of its outputs.
        tree, images: as :mod:`tests.kills.entry` takes them.
        half: sentences about what is taken for whole beside the outputs, and is not.
        reference: name -> content of the outputs of a run that nobody stopped.
    """

    name: str
    arguments: Callable[[Path], Sequence[str | Path]]
    records: bool = False
    disk: Callable[[Path], Path] | None = lambda out: out
    room_b: int | None = None
    tree: str = "-"
    images: str = "-"
    environment: Mapping[str, str] | None = None
    locks: Callable[[], list[Path]] = list
    half: Callable[[], list[str]] = list
    took_s: float = 0.0
    reference: Mapping[str, bytes] | None = None

    def run(
        self, out: Path, scratch: Path, kind: str | None = None, after_s: float = 0.0
    ) -> strike.Struck:
        return strike.run(
            [
                *(sys.executable, "-m", "tests.kills.entry", self.tree, self.images),
                *map(str, self.arguments(out)),
            ],
            {**(self.environment or {**os.environ, "PYTHONPATH": str(ROOT)}),
             "TMPDIR": str(scratch), "GITHUB_STEP_SUMMARY": ""},
            ROOT if self.environment is None else out,
            kind,
            after_s,
        )  # fmt: skip

    def is_whole(self, name: str, data: bytes) -> bool:
        """As the run that nobody stopped made it, but for times and durations in it."""
        assert self.reference is not None
        if name.endswith(".json"):
            # Of what a tuner keeps, the name tells the inputs, hil's sources among them.
            try:
                found = json.loads(data)
            except ValueError:
                return False
            return name not in self.reference or set(found) == set(json.loads(self.reference[name]))
        if name not in self.reference:
            return False
        wanted = self.reference[name]
        tail = wanted[-8:] if name.endswith((".html", ".xml", ".svg", ".md")) else b""
        return data.endswith(tail) and abs(len(data) - len(wanted)) <= 0.02 * len(wanted) + 8


@contextmanager
def export(form: str, _: Path) -> Iterator[Command]:
    name = {"csv": "set", "parquet": "set", "hdf5": "set.hdf5"}.get(form, f"set.{form}")
    yield Command(
        f"export {form}", lambda out: ["export", CLEAN, "-o", out / name, "--format", form]
    )


@contextmanager
def report(_: Path) -> Iterator[Command]:
    two = [CLEAN, CLEAN.with_name("cal-boot")]
    yield Command("report", lambda out: ["report", *two, "-o", out / "report"])


@contextmanager
def tune(_: Path) -> Iterator[Command]:
    yield Command(
        "tune",
        lambda out: [
            *("tune", "zupt", CLEAN, CLEAN.with_name("imu-rest"), "--cells", "4", "--try", "1"),
            *("-o", out / "tune", "--keep", out / "kept"),
        ],
    )


@contextmanager
def log(_: Path) -> Iterator[Command]:
    """Two ports on which two boards go on talking."""
    spoken = {
        role: stream.data.tobytes()
        for role, stream in load(CLEAN / "recording.mcap").serial.items()
    }
    ports = {role: Port() for role in spoken}
    leaving = threading.Event()

    def talk() -> None:
        at = 0
        while not leaving.wait(0.02):
            for role, data in spoken.items():
                try:
                    os.write(ports[role].master, data[at : at + 1000])
                except BlockingIOError:
                    # Nobody listens.
                    continue
            at = (at + 1000) % 400_000

    talker = threading.Thread(target=talk, daemon=True)
    talker.start()
    named = [word for role, port in ports.items() for word in ("--port", f"{role}={port.path}")]
    try:
        yield Command(
            "log",
            lambda out: [
                *("log", *named, "-o", out / "log.mcap", "--duration", f"{LOG_S:g}s"),
                *("--rotate", "1s"),
            ],
            records=True,
        )
    finally:
        leaving.set()
        talker.join()
        for port in ports.values():
            port.close()


@contextmanager
def flash(folder: Path) -> Iterator[Command]:
    with World(folder / "w") as world:
        bench = world.bench_file()
        images = world.images()
        yield Command(
            "bench flash",
            lambda _: ["bench", "flash", "--always", "--file", bench],
            disk=None,
            images=str(images),
            environment=world.environment,
            locks=lambda: [bench.with_name(f".{bench.name}.lock")],
        )


def tree_at(folder: Path) -> Path:
    """A checkout of its own, so that nobody else's builds are stopped.

    Below the folder that the environment names, images built by an earlier run are used again.
    """
    tree = Path(os.environ.get(TREE, folder.parent)) / folder.name / "tree"
    for name in SOURCE_FOLDERS:
        shutil.rmtree(tree / name, ignore_errors=True)
        # With their times, so that only what changed is compiled anew.
        shutil.copytree(ROOT / name, tree / name, symlinks=True)
    return tree


def _workspace() -> bool:
    try:
        find_babblesim(find_workspace())
    except BuildError:
        return False
    return True


def half_images(folder: Path) -> list[str]:
    """What ``hil`` would run as the image in ``folder``, and is not one.

    A whole ELF file ends with its table of sections, and ours holds its build id (ELF-32, TIS).
    """
    made = manifest.load(folder)
    if made is None or not made.is_intact():
        return []
    found = []
    for kind in made.files:
        image = made.file(kind).read_bytes()
        (table,), (size, count) = unpack_from("<I", image, 32), unpack_from("<HH", image, 46)
        if len(image) != table + size * count:
            found.append(f"half an image is taken for whole: {kind}, {len(image)} bytes")
        if int(made.build_id, 16).to_bytes(8, "little") not in image:
            found.append(f"an image of another build: {kind} is not {made.build_id}")
    return found


@contextmanager
def build(folder: Path) -> Iterator[Command]:
    tree = tree_at(folder)
    image = tree / "build/firmware/sim/follower"

    def arguments(_: Path) -> list[str]:
        # A source that changed since: some compiling and a link, not all of Zephyr.
        main = tree / "firmware/apps/follower/src/main.c"
        main.write_text(main.read_text() + f"/* {time.monotonic_ns()} */\n")
        return ["build", "--role", "follower", "--target", "sim"]

    yield Command(
        "build",
        arguments,
        disk=lambda _: image,
        room_b=LINKED_B,
        tree=str(tree),
        locks=lambda: [image.with_name(".follower.lock")],
        half=lambda: half_images(image),
    )


@contextmanager
def record(folder: Path) -> Iterator[Command]:
    scenario = folder / "struck.toml"
    scenario.write_text(SCENARIO)
    yield Command(
        "record",
        lambda out: ["record", scenario, "-o", out / "run"],
        records=True,
        tree=str(tree_at(folder)),
    )


HERE = {
    "log": log,
    "flash": flash,
    "report": report,
    "tune": tune,
    **{f"export-{form}": (lambda folder, form=form: export(form, folder))
       for form in ("csv", "hdf5", "npz", "mcap", "parquet")},
}  # fmt: skip
WITH_WORKSPACE = {"build": build, "record": record}


@contextmanager
def all_of(folder: Path, names: Sequence[str] = ()) -> Iterator[list[Command]]:
    """The commands of these names, or all that this machine can run, ready to be struck."""
    makers = {**HERE, **(WITH_WORKSPACE if _workspace() else {})}
    with ExitStack() as stack:
        made = []
        for name in names or makers:
            own = folder / name
            own.mkdir()
            made.append(stack.enter_context(makers[name](own)))
        yield made


def measure(command: Command, folder: Path) -> None:
    """Run it to its end once: how long it takes, and what it writes.

    Raises:
        AssertionError: it failed, so that nothing could be learned from stopping it.
    """
    out, scratch = folder / "out", folder / "tmp"
    for place in (out, scratch):
        place.mkdir(parents=True)
    if command.tree != "-" and command.reference is None:
        # The first time all of Zephyr is compiled.
        command.run(folder / "first", scratch)
    struck = command.run(out, scratch)
    assert struck.status in (0, 1), f"hil {command.name}: {struck.said[-2000:]}"
    command.took_s = struck.took_s
    command.reference = {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in out.rglob("*")
        if path.is_file()
    }
    shutil.rmtree(folder)
