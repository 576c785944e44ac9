# SPDX-License-Identifier: Apache-2.0
"""A whole simulated run with stand-ins for the simulator and the images: what is recorded, what is
said when a part fails, and that nothing is left behind.

The stand-ins keep the real ones' interface: the same command line, the shared folder, the serial
line with its log of times, the log of the pins.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from hil.backends.sim import SimBackend
from hil.build import BabbleSim, GitState, Manifest
from hil.build.manifest import describe
from hil.errors import RecordingError, RigError
from hil.recording import Recording, load
from hil.scenario import Scenario, from_mapping
from hil.simulator.session import shared_folder

PHY = """
import os, pathlib, sys, time
options = dict(a.lstrip("-").partition("=")[::2] for a in sys.argv[1:])
shared = pathlib.Path(os.environ["FAKE_SHARED"]) / options["s"]
shared.mkdir(parents=True)
(shared / "2G4.d0.dtp").touch()
until = time.monotonic() + 60
while len(list(shared.glob("left.*"))) < int(options["D"]):
    if time.monotonic() > until:
        sys.exit("the stand-in was forgotten")
    time.sleep(0.01)
for path in shared.iterdir():
    path.unlink()
shared.rmdir()
"""

NODE = """
import os, pathlib, signal, struct, sys, time
options = dict(a.lstrip("-").partition("=")[::2] for a in sys.argv[1:])
fate = os.environ.get("FAKE_FATE_" + options["d"], "")
shared = pathlib.Path(os.environ["FAKE_SHARED"]) / options["s"]
print("booting device", options["d"], flush=True)
while not shared.is_dir():
    time.sleep(0.01)
line = os.open(options["hil_uart"], os.O_RDWR | os.O_NOCTTY)
times = open(options["hil_uart_times"], "wb", buffering=0)
pins = open(options["gpio_out_file"], "w", buffering=1)
pins.write("time(microsecond),port,pin,level\\n")
total = 0
for ms in range(100, 4001, 100):
    data = (b"node %s at %d ms\\n" % (options["d"].encode(), ms)) * 20
    if fate != "swallow" or ms < 2000:
        while data:
            n = os.write(line, data)
            data, total = data[n:], total + n
    else:
        total += len(data)
    times.write(struct.pack("<QQ", total, ms * 1000))
    pins.write("%d,1,3,%d\\n%d,1,2,1\\n" % (ms * 1000, ms // 100 % 2, ms * 1000 + 7))
    if ms == 1000:
        if fate == "crash":
            print("ASSERTION FAIL @ main.c:42", flush=True)
            os.kill(os.getpid(), signal.SIGSEGV)
        if fate == "exit":
            sys.exit("cannot go on")
        if fate == "leave":
            break
        if fate == "spin":
            print("entering the loop", flush=True)
            while True:
                pass
        if fate == "wait":
            print("waiting for a lock", flush=True)
            time.sleep(1000)
    if fate == "slow":
        time.sleep(0.5)
(shared / ("left." + options["d"])).touch()
"""


@dataclass(frozen=True)
class Bench:
    """Stand-ins in a folder."""

    folder: Path
    images: Mapping[str, Manifest]

    def run(self, stall_limit_s: float = 20.0) -> Recording:
        backend = SimBackend(self.folder, self.images, stall_limit_s=stall_limit_s)
        return backend.run(SCENARIO, self.folder / "run.mcap", lambda share, what: None)


SCENARIO: Scenario = from_mapping(
    {
        "name": "stand-in",
        "duration_s": 4,
        "nodes": {"leader": {"drift_ppm": 13.7, "start_offset_us": 1000}},
    },
    "test",
)


def script(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{sys.executable}\n{text}")
    path.chmod(0o755)


def make_bench(folder: Path) -> Bench:
    script(folder / "bsim" / "bin" / "bs_2G4_phy_v1", PHY)
    script(folder / "image" / "zephyr.exe", NODE)
    images = {
        role: Manifest(
            role=role,
            target="sim",
            board="nrf52_bsim",
            build_id="00" * 8,
            inputs_sha256="",
            created_utc="",
            files={"exe": describe(folder / "image", folder / "image" / "zephyr.exe")},
            zephyr_version="4.1.0",
            toolchain="none",
            git=GitState("", "unknown"),
            folder=folder / "image",
        )
        for role in ("leader", "follower")
    }
    return Bench(folder, images)


def patch(folder: Path, set_attribute: Callable[[object, str, object], None]) -> None:
    """Let the stand-ins be found; the shared folder is theirs alone."""
    from hil import build  # noqa: PLC0415
    from hil.simulator import session  # noqa: PLC0415

    simulator = BabbleSim(folder / "bsim", folder / "bsim" / "components")
    set_attribute(build, "find_workspace", lambda explicit: None)
    set_attribute(build, "find_babblesim", lambda workspace: simulator)
    set_attribute(session, "shared_folder", lambda sim_id: folder / "shared" / sim_id)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setenv("FAKE_SHARED", str(tmp_path / "shared"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "shared").mkdir()
    (tmp_path / "tmp").mkdir()
    patch(tmp_path, monkeypatch.setattr)
    return make_bench(tmp_path)


def running(folder: Path) -> list[str]:
    """Command lines of living processes that were started from ``folder``."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            text = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if str(folder) in text and f"/proc/{os.getpid()}/" not in str(path):
            found.append(text)
    return found


def open_terminals() -> int:
    return sum(
        os.readlink(f"/proc/self/fd/{fd}").startswith(("/dev/pts/", "/dev/ptmx"))
        for fd in os.listdir("/proc/self/fd")
        if os.path.islink(f"/proc/self/fd/{fd}")
    )


def assert_nothing_left(folder: Path) -> None:
    deadline_s = time.monotonic() + 10
    while left := [
        *running(folder / "image"),
        *running(folder / "bsim"),
        *(folder / "shared").iterdir(),
        *(folder / "tmp").iterdir(),
    ]:
        assert time.monotonic() < deadline_s, f"left behind: {left}"
        time.sleep(0.05)


def test_a_run_from_start_to_end(bench: Bench) -> None:
    terminals = open_terminals()
    shown: list[tuple[float, str]] = []
    backend = SimBackend(bench.folder, bench.images)
    recording = backend.run(
        SCENARIO, bench.folder / "run.mcap", lambda share, what: shown.append((share, what))
    )
    assert recording.integrity.complete
    for device, role in enumerate(("leader", "follower")):
        text = bytes(recording.serial[role].data)
        assert text == b"".join(
            b"node %d at %d ms\n" % (device, ms) * 20 for ms in range(100, 4001, 100)
        )
        t_ns, level = recording.edges.select(f"{role}.pulse")
        assert level.tolist() == [1, 0] * 20
        expected = recording.truth[role].true_us([ms * 1e3 for ms in range(100, 4001, 100)]) * 1e3
        assert abs(t_ns - expected).max() < 1
        assert recording.serial[role].t_ns_bench([0])[0] == t_ns[0]
    assert [event.kind for event in recording.events] == ["rig", "end"]
    assert shown[-1][0] == 1.0
    assert [share for share, _ in shown] == sorted(share for share, _ in shown)
    assert open_terminals() == terminals
    assert_nothing_left(bench.folder)


def test_provenance_is_enough_to_repeat_the_run(bench: Bench) -> None:
    provenance = bench.run().provenance
    assert provenance.source == "sim"
    assert from_mapping(provenance.scenario, "recording") == SCENARIO
    assert {role: m["build_id"] for role, m in provenance.manifests.items()} == {
        "leader": "00" * 8,
        "follower": "00" * 8,
    }
    assert provenance.tools["Zephyr"] == "4.1.0"
    assert "Simulated radio" in provenance.notes
    assert str(bench.folder) not in json.dumps(provenance.to_mapping())


@pytest.mark.parametrize(
    ("fate", "says"),
    [
        ("crash", ["follower node died", "1.000 s", "SIGSEGV", "ASSERTION FAIL @ main.c:42"]),
        ("exit", ["follower node died", "exit status 1", "cannot go on"]),
        ("leave", ["follower node ended by itself", "1.000 s of 4 s", "booting device 1"]),
        ("spin", ["follower node hangs", "never rests", "entering the loop"]),
        ("wait", ["follower node hangs", "waits for something", "waiting for a lock"]),
        ("swallow", ["serial line lost bytes", "of the follower"]),
    ],
)
def test_a_part_that_fails_is_named_with_its_last_output(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, fate: str, says: list[str]
) -> None:
    monkeypatch.setenv("FAKE_FATE_1", fate)
    monkeypatch.setattr("hil.simulator.session.DRAIN_LIMIT_S", 0.5)
    with pytest.raises(RigError) as caught:
        bench.run(stall_limit_s=4.0)
    for part in says:
        assert part in caught.value.message
    assert_nothing_left(bench.folder)
    kept = load(bench.folder / "run.mcap")
    assert not kept.integrity.complete
    assert bytes(kept.serial["follower"].data).startswith(b"node 1 at 100 ms\n")


def test_a_simulator_that_does_not_start_is_named(bench: Bench) -> None:
    script(bench.folder / "bsim" / "bin" / "bs_2G4_phy_v1", "import sys; sys.exit('no library')")
    with pytest.raises(RigError, match="radio simulator died") as caught:
        bench.run()
    assert "no library" in caught.value.message
    assert_nothing_left(bench.folder)


@pytest.mark.parametrize("change", ["deleted", "built by somebody else"])
def test_an_image_that_is_not_the_one_that_was_built_does_not_run(
    bench: Bench, change: str
) -> None:
    image = bench.folder / "image" / "zephyr.exe"
    if change == "deleted":
        image.unlink()
    else:
        script(image, NODE + "\n")
    with pytest.raises(RigError, match=r"leader image .* is not the one that was built") as caught:
        bench.run()
    assert caught.value.mend == "hil build --role leader --target sim"
    assert not (bench.folder / "run.mcap").exists()


def test_an_existing_recording_is_not_touched(bench: Bench) -> None:
    (bench.folder / "run.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError):
        bench.run()
    assert (bench.folder / "run.mcap").read_bytes() == b"precious"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_when_the_run_is_killed(bench: Bench, number: signal.Signals) -> None:
    code = (
        "import importlib.util, sys; from pathlib import Path\n"
        "spec = importlib.util.spec_from_file_location('stand_ins', sys.argv[1])\n"
        "stand_ins = importlib.util.module_from_spec(spec)\n"
        "sys.modules['stand_ins'] = stand_ins\n"
        "spec.loader.exec_module(stand_ins)\n"
        "folder = Path(sys.argv[2])\n"
        "stand_ins.patch(folder, setattr)\n"
        "stand_ins.make_bench(folder).run()\n"
    )
    environment = {**os.environ, "FAKE_FATE_0": "slow", "FAKE_FATE_1": "slow"}
    with subprocess.Popen(
        [sys.executable, "-c", code, __file__, str(bench.folder)],
        env=environment,
        stderr=subprocess.DEVNULL,
    ) as run:
        deadline_s = time.monotonic() + 20
        while not list((bench.folder / "tmp").glob("*/follower.times")):
            assert time.monotonic() < deadline_s
            assert run.poll() is None
            time.sleep(0.05)
        assert len(running(bench.folder / "image")) == 2
        run.send_signal(number)
        run.wait(10)
    assert_nothing_left(bench.folder)
    assert load(bench.folder / "run.mcap").serial


def test_the_shared_folder_is_the_one_of_babblesim() -> None:
    assert shared_folder("abc").parts[:2] == ("/", "tmp")
    assert shared_folder("abc").name == "abc"
    assert shared_folder("abc").parent.name.startswith("bs_")
