# SPDX-License-Identifier: Apache-2.0
"""Logging from pseudo-terminals: two ports, unplugged, rotated, killed, a full disk, rubbish."""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.bench.ports import PortInfo
from hil.cli import app
from hil.errors import HilError, RecordingError, RigError
from hil.log import source as sources
from hil.log.capture import Log, capture
from hil.log.meter import Meter
from hil.log.parts import Parts, Rotation
from hil.log.source import named
from hil.log.text import tables_of_parts
from hil.recording import Provenance, Recording, load
from hil.wire.codec import decode, encode
from tests.unit.fake_line import Board, until

CLEAN = Path(__file__).parents[3] / "fixtures/recordings/clean-7ms5/recording.mcap"
SHADOW = "#shadow,t_us_node,ax_mps2\r\nshadow,10000,0.25\r\nshadow,20000,-0.5\r\n"


@pytest.fixture(scope="module")
def spoken() -> dict[str, bytes]:
    """What real firmware said, each role."""
    recording = load(CLEAN)
    return {role: recording.serial[role].data.tobytes() for role in recording.roles}


@pytest.fixture
def boards(tmp_path: Path) -> Iterator[dict[str, Board]]:
    made = {role: Board(tmp_path / role) for role in ("leader", "follower")}
    yield made
    for board in made.values():
        if board.master >= 0:
            os.close(board.master)


class Running:
    """A capture in a thread."""

    def __init__(
        self, boards: dict[str, Board], output: Path, rotation: Rotation | None = None
    ) -> None:
        self.log: Log | None = None
        self.error: Exception | None = None
        self._stop = ""
        self._ports = [f"{role}={board.link}" for role, board in boards.items()]
        self._thread = threading.Thread(target=self._run, args=(output, rotation or Rotation()))
        self._thread.start()
        until(lambda: self.log or self.error)

    def _run(self, output: Path, rotation: Rotation) -> None:
        def show(log: Log) -> None:
            self.log = log

        try:
            capture(named(self._ports), output, rotation, stop=lambda: self._stop, show=show)
        except HilError as error:
            self.error = error

    def bytes(self, role: str) -> int:
        assert self.log is not None
        return self.log.meters[role].bytes

    def end(self) -> Log:
        self._stop = "enough"
        self._thread.join(20)
        if self.error:
            raise self.error
        assert self.log is not None
        return self.log


def send(board: Board, data: bytes, piece: int = 4096) -> None:
    for at in range(0, len(data), piece):
        part = data[at : at + piece]
        while part:
            part = part[os.write(board.master, part) :]


def at_once(*jobs: Callable[[], None]) -> None:
    threads = [threading.Thread(target=job) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)


def joined(paths: list[Path], role: str) -> bytes:
    return b"".join(load(path).serial[role].data.tobytes() for path in paths)


def whole(paths: list[Path]) -> list[Recording]:
    found = [load(path) for path in paths]
    assert all(one.integrity.complete and not one.integrity.problems for one in found)
    return found


def test_two_ports_at_once_and_what_is_said_of_them(
    boards: dict[str, Board], tmp_path: Path, spoken: dict[str, bytes]
) -> None:
    running = Running(boards, tmp_path / "log.mcap")
    sent = {role: spoken[role][:150_000] for role in boards}
    at_once(*(lambda r=role: send(boards[r], sent[r]) for role in boards))
    until(lambda: all(running.bytes(role) == 150_000 for role in boards))
    log = running.end()
    (recording,) = whole(log.parts.paths)
    for role, data in sent.items():
        assert recording.serial[role].data.tobytes() == data
        # The decoder of whole streams, which was not used while logging.
        stats = decode(data).stats
        meter = log.meters[role]
        assert (meter.frames, meter.lost) == (stats.frames, stats.lost)
        assert (meter.damaged, meter.restarts) == (stats.crc_errors, stats.restarts)
        assert meter.lines == pytest.approx(len(decode(data).text), abs=1)
    assert recording.provenance.source == "bench"
    assert recording.provenance.manifests == {}
    ids = {e.node: e.data["build_id"] for e in recording.events if e.kind == "hello"}
    real = load(CLEAN).provenance.manifests
    assert ids == {role: real[role]["build_id"] for role in boards}
    assert [e.kind for e in recording.events].count("hello") == 2


def test_a_logged_run_is_judged_like_any_recording(
    boards: dict[str, Board], tmp_path: Path, spoken: dict[str, bytes]
) -> None:
    running = Running(boards, tmp_path / "log.mcap")
    at_once(*(lambda r=role: send(boards[r], spoken[r][:40_000]) for role in boards))
    until(lambda: all(running.bytes(role) == 40_000 for role in boards))
    running.end()
    result = CliRunner().invoke(app, ["replay", str(tmp_path / "log.mcap")])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "two boards on the bench" in result.output
    assert "imu." in result.output


def test_unplugged_and_plugged_in_again(boards: dict[str, Board], tmp_path: Path) -> None:
    board = boards["leader"]
    running = Running(boards, tmp_path / "log.mcap")
    hello = frame(0)
    send(board, b"before\r\n" + hello + frame(1)[:5])
    until(lambda: running.bytes("leader") == 13 + len(hello))
    board.unplug()
    until(lambda: running.log and "leader" in running.log.away)
    time.sleep(0.3)
    board.plug_in()
    until(lambda: running.log and "leader" not in running.log.away)
    send(board, frame(2) + b"after\r\n" + frame(3))
    until(lambda: running.bytes("leader") == 20 + 3 * len(hello))
    board.unplug()
    until(lambda: running.log and "leader" in running.log.away)
    log = running.end()
    (recording,) = whole(log.parts.paths)
    expected = b"before\r\n" + hello + frame(1)[:5] + frame(2) + b"after\r\n" + frame(3)
    assert recording.serial["leader"].data.tobytes() == expected
    gaps = [e for e in recording.events if e.kind == "gap"]
    assert [e.node for e in gaps] == ["leader", "leader"]
    assert 0.3 <= gaps[0].data["lasted_s"] < 5.0
    assert len(log.gaps["leader"]) == 2
    assert not log.gaps["follower"]
    # Bytes that came behind the gap carry a later time than its end.
    stream = recording.serial["leader"]
    back_ns = gaps[0].t_ns_bench + round(gaps[0].data["lasted_s"] * 1e9)
    assert stream.t_ns_bench(expected.index(frame(2))) >= back_ns - 1_000_000
    # Frame 1, cut by the unplugging, is missing: and said so.
    assert (log.meters["leader"].frames, log.meters["leader"].lost) == (3, 1)


def frame(seq: int, role: int = 0, uptime_ms: int = 9000) -> bytes:
    hello = {
        **{"protocol_version": 1, "role": role, "target": 1, "schema_hash": 1, "build_id": 2},
        **{"device_id": 3, "reset_reason": 0, "tick_rate_hz": 16_000_000},
        **{"conn_interval_us": 7500, "uptime_ms": uptime_ms},
    }
    return encode("hello", hello, seq)


def test_rotation_by_time_loses_no_byte_and_cuts_no_frame(
    boards: dict[str, Board], tmp_path: Path, spoken: dict[str, bytes]
) -> None:
    running = Running(boards, tmp_path / "log.mcap", Rotation(after_ns=400_000_000))

    def slowly(role: str) -> None:
        # In pieces that end within frames.
        for at in range(0, 120_000, 997):
            send(boards[role], spoken[role][at : min(at + 997, 120_000)])
            time.sleep(0.015)

    at_once(lambda: slowly("leader"), lambda: slowly("follower"))
    until(lambda: all(running.bytes(role) == 120_000 for role in boards))
    log = running.end()
    assert len(log.parts.paths) >= 4
    assert [p.name for p in log.parts.paths[:2]] == ["log-0001.mcap", "log-0002.mcap"]
    parts = whole(log.parts.paths)
    for role in boards:
        sent = spoken[role][:120_000]
        assert joined(log.parts.paths, role) == sent
        # Each file on its own has every frame that lies in it, and together they have all.
        assert sum(part.decoded(role).stats.frames for part in parts) == decode(sent).stats.frames
        assert sum(part.decoded(role).stats.lost for part in parts) == 0
        before = 0
        for part in parts:
            joints = [e for e in part.events if e.kind == "joint"]
            assert [e.data["bytes_before"][role] for e in joints] in ([before], [])
            before += len(part.serial[role].data)
            assert [e.node for e in part.events if e.kind == "hello"].count(role) == 1
    numbers = [e.data["number"] for part in parts for e in part.events if e.kind == "part"]
    assert numbers == list(range(1, len(parts) + 1))
    assert len({e.data["session"] for p in parts for e in p.events if e.kind == "part"}) == 1


def parts_of(
    data: bytes, tmp_path: Path, rotation: Rotation, piece: int, byte_s: float, **more: int
) -> list[Path]:
    """A log of one port without a port: reads of ``piece`` bytes, each byte takes ``byte_s``."""
    made = Provenance("bench", "")
    with Parts(tmp_path / "x.mcap", made, ["leader"], rotation, session="s", **more) as parts:
        for at in range(0, len(data), piece):
            t_ns = round(at * byte_s * 1e9)
            parts.write("leader", t_ns, data[at : at + piece])
            parts.tick(t_ns)
    return parts.paths


def after(seconds: float) -> Rotation:
    return Rotation(after_ns=round(seconds * 1e9))


@pytest.mark.parametrize("piece", [1, 2, 3, 1000])
def test_random_bytes_are_cut_anywhere_and_none_is_lost(tmp_path: Path, piece: int) -> None:
    data = random.Random(piece).randbytes(60 if piece < 10 else 60_000)
    paths = parts_of(data, tmp_path, after(0.7), piece, 6.0 / len(data))
    assert 3 <= len(paths) <= 9
    assert joined(paths, "leader") == data
    whole(paths)


@pytest.mark.parametrize("piece", [1, 2, 5, 64])
def test_frames_and_lines_are_whole_in_one_of_the_files(tmp_path: Path, piece: int) -> None:
    sent = b"".join(frame(k) + (b"text,1\r\n" if k % 3 == 0 else b"") for k in range(30))
    paths = parts_of(sent, tmp_path, after(0.03), piece, 1e-4)
    assert len(paths) >= 3
    parts = whole(paths)
    assert joined(paths, "leader") == sent
    assert sum(p.decoded("leader").stats.frames for p in parts) == 30
    text = [line.text for p in parts for line in p.decoded("leader").text]
    assert text == ["text,1"] * 10


def test_text_alone_is_cut_between_lines(tmp_path: Path) -> None:
    sent = b"".join(b"%d,%d\r\n" % (k, k) for k in range(500))
    paths = parts_of(sent, tmp_path, after(1.5), 50, 2e-3)
    assert len(paths) >= 3
    for path in paths:
        data = load(path).serial["leader"].data.tobytes()
        assert data.endswith(b"\r\n")
        assert re.match(rb"\d+,\d+\r\n", data)
    assert joined(paths, "leader") == sent


def test_rotation_by_size_and_the_limit_of_what_can_be_loaded(tmp_path: Path) -> None:
    noise = random.Random(1).randbytes(3_000_000)
    paths = parts_of(noise, tmp_path, Rotation(file_bytes=1_000_000), 10_000, 1e-5)
    assert len(paths) in (2, 3)
    assert all(1_000_000 <= path.stat().st_size < 1_500_000 for path in paths[:-1])
    assert joined(paths, "leader") == noise
    # Without any rotation asked for, a file never outgrows what load() takes.
    plain = tmp_path / "plain"
    plain.mkdir()
    paths = parts_of(noise, plain, Rotation(), 10_000, 1e-5, bytes_max=1_000_000)
    assert [path.name for path in paths][:2] == ["x.mcap", "x-0002.mcap"]
    assert joined(paths, "leader") == noise


def hil_log(*args: str | Path, **more: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", "from hil.cli import main; main()", "log", *map(str, args)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **more,  # type: ignore[call-overload]
    )


def listening(board: Board, process: subprocess.Popen[str]) -> None:
    """Wait until the log has opened the port: bytes sent before are dropped by the line."""
    until(lambda: process.poll() is not None or opened_by(process.pid, board), 20.0)
    time.sleep(0.2)


def opened_by(pid: int, board: Board) -> bool:
    device = os.path.realpath(board.link)
    try:
        return any(os.readlink(f) == device for f in Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return False


def test_kill_9_costs_at_most_the_last_chunk(boards: dict[str, Board], tmp_path: Path) -> None:
    output = tmp_path / "log.mcap"
    board = boards["leader"]
    with hil_log("--port", f"leader={board.link}", "-o", output) as process:
        listening(board, process)
        sent, safe = b"", b""
        begin_s = time.monotonic()
        while (now_s := time.monotonic() - begin_s) < 3.0:
            if now_s < 1.5:
                safe = sent
            sent += (data := b"%d,%s\r\n" % (len(sent), b"x" * 200))
            send(board, data)
            time.sleep(0.01)
        process.kill()
        process.wait()
    recording = load(output)
    assert not recording.integrity.complete
    kept = recording.serial["leader"].data.tobytes()
    assert sent.startswith(kept)
    # A second of chunk and what the loop holds; the rest had been handed to the system.
    assert len(kept) >= len(safe) > 10_000


def test_ctrl_c_ends_cleanly_with_a_summary_and_tables(
    boards: dict[str, Board], tmp_path: Path, spoken: dict[str, bytes]
) -> None:
    board = boards["leader"]
    output, csv = tmp_path / "sub/log.mcap", tmp_path / "t.csv"
    with hil_log("--port", f"leader={board.link}", "-o", output, "--csv", csv) as process:
        listening(board, process)
        send(board, frame(0) + SHADOW.encode() + frame(1) + frame(4))
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert process.returncode == 0, err
    assert "interrupted" in out
    assert "3 frames, 3 lines, 0 CRC errors, 2 frames lost" in out
    assert "2 rows, 0 bad ones" in out
    (recording,) = whole([output])
    assert recording.decoded("leader").stats.frames == 3
    rows = (tmp_path / "t-leader-shadow.csv").read_text().splitlines()
    assert rows[0] == "t_s_bench,t_us_node,ax_mps2"
    assert [r.partition(",")[2] for r in rows[1:]] == ["10000,0.25", "20000,-0.5"]
    # The same again from the file.
    (tmp_path / "t-leader-shadow.csv").unlink()
    result = CliRunner().invoke(app, ["log", "--from", str(output), "--csv", str(csv)])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "t-leader-shadow.csv").read_text().splitlines() == rows


def test_a_full_disk_is_a_clear_error_and_what_was_written_stays(
    boards: dict[str, Board], tmp_path: Path
) -> None:
    """A limit on the size of files stands for the disk: the write fails in the same place."""
    limit = 300_000
    output = tmp_path / "log.mcap"
    board = boards["leader"]

    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    noise = random.Random(2).randbytes(2_000_000)
    with hil_log("--port", f"leader={board.link}", "-o", output, preexec_fn=small) as process:
        listening(board, process)
        os.set_blocking(board.master, False)
        sent = 0
        while sent < len(noise) and process.poll() is None:
            try:
                sent += os.write(board.master, noise[sent : sent + 4096])
            except BlockingIOError:
                time.sleep(0.005)
            except OSError:
                break
        _, err = process.communicate(timeout=30)
    assert process.returncode == 2
    assert "cannot be written: File too large" in err
    assert "what was written until then is readable" in err
    assert "has room" in err
    assert "Traceback" not in err
    recording = load(output)
    kept = recording.serial["leader"].data.tobytes()
    assert len(kept) >= 200_000
    assert noise.startswith(kept)
    assert not recording.integrity.complete


def test_garbage_is_counted_and_kept(boards: dict[str, Board], tmp_path: Path) -> None:
    running = Running(boards, tmp_path / "log.mcap")
    noise = random.Random(3).randbytes(50_000)
    broken = bytearray(frame(1))
    broken[6] ^= 1
    send(boards["leader"], noise + b"\0" + frame(0) + bytes(broken) + frame(2))
    until(lambda: running.bytes("leader") == 50_001 + 3 * len(frame(0)))
    log = running.end()
    (recording,) = whole(log.parts.paths)
    assert recording.serial["leader"].data.tobytes().startswith(noise)
    assert log.meters["leader"].frames == 2
    assert log.meters["leader"].damaged >= 1
    assert recording.decoded("leader").stats.frames == 2


def test_hints_of_a_wrong_port() -> None:
    meter = Meter("leader", 0)
    assert meter.hint(1_000_000_000) == ""
    assert "two ports" in meter.hint(4_000_000_000)
    meter.feed(4_000_000_000, b"\xff" * 2000)
    assert "baud" in meter.hint(4_100_000_000)
    swapped = Meter("leader", 0)
    swapped.feed(0, frame(0, role=1))
    assert "swapped" in swapped.hint(1_000_000)
    other = Meter("leader", 0)
    other.feed(0, frame(0))
    assert "protocol table 0000000000000001" in other.hint(1_000_000)
    assert other.hint(9_000_000_000) == "silent for 9 s"


def test_a_meter_sees_losses_between_reads_whatever_the_pieces() -> None:
    spoken = b"".join(frame(k) for k in (0, 1, 2, 5, 6, 9)) + frame(0, uptime_ms=3) + frame(1)
    expected = decode(spoken).stats
    assert (expected.lost, expected.restarts) == (4, 1)
    for piece in (1, 7, 40, 1000):
        meter = Meter("leader", 0)
        for at in range(0, len(spoken), piece):
            meter.feed(at, spoken[at : at + piece])
        assert (meter.frames, meter.lost, meter.restarts) == (8, 4, 1)


def test_rates_are_of_the_last_seconds() -> None:
    meter = Meter("leader", 0)
    for k in range(1, 81):
        meter.feed(k * 125_000_000, b"ten bytes\n" * (10 if k > 40 else 1))
        rates = meter.rates(k * 125_000_000)
    assert rates.bytes == pytest.approx(800.0)
    assert rates.lines == pytest.approx(80.0)


def test_memory_stays_small_however_long_a_line_is() -> None:
    meter = Meter("leader", 0)
    for _ in range(50):
        meter.feed(0, b"x" * 100_000)
    assert len(meter._tail) <= 1024
    meter.feed(0, b"\0" + b"x" * 100_000)
    assert len(meter._stream._rest) <= 1 << 16


@pytest.mark.parametrize(
    ("texts", "what"),
    [
        (["/dev/ttyACM0"], "does not name a port"),
        (["Leader=/dev/x"], "does not name a port"),
        (["leader=/dev/x", "leader=/dev/y"], "named before"),
        (["leader=/dev/x", "follower=/dev/x"], "named before"),
    ],
)
def test_ports_that_are_named_wrong(texts: list[str], what: str) -> None:
    with pytest.raises(HilError, match=what):
        named(texts)


def test_a_named_usb_port_is_followed_by_its_serial_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    there = [PortInfo("/dev/ttyACM0", "000123", 2, 0x1366, 1)]
    monkeypatch.setattr(sources.ports, "find_ports", lambda: there)
    (one,) = named(["leader=/dev/ttyACM0@921600"])
    assert (one.baud, one.path) == (921_600, "/dev/ttyACM0")
    assert one.what == {
        "path": "/dev/ttyACM0",
        "usb_serial_number": "000123",
        "usb_interface": 2,
    }
    there[0] = PortInfo("/dev/ttyACM7", "000123", 2, 0x1366, 1)
    assert one.resolve() == "/dev/ttyACM7"


def test_nothing_is_overwritten_and_errors_are_clear(
    boards: dict[str, Board], tmp_path: Path
) -> None:
    taken = tmp_path / "log.mcap"
    taken.write_bytes(b"mine")
    ports = named([f"leader={boards['leader'].link}"])

    def run(path: Path) -> None:
        capture(ports, path, Rotation(), stop=lambda: "at once", show=lambda log: None)

    with pytest.raises(RecordingError, match="exists already"):
        run(taken)
    assert taken.read_bytes() == b"mine"
    with pytest.raises(RecordingError, match="cannot be made"):
        run(taken / "sub" / "log.mcap")
    with pytest.raises(RigError, match="no such serial port"):
        capture(
            named(["leader=/dev/ttyACM99"]),
            tmp_path / "new.mcap",
            Rotation(),
            stop=lambda: "",
            show=lambda log: None,
        )
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["--rotate", "ten"],
        ["--rotate-size", "5 bananas"],
        ["--duration", "0s"],
        ["--from", str(CLEAN)],
        ["--port", "leader=/dev/x", "--role", "leader"],
    ],
)
def test_options_that_make_no_sense(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, ["log", *arguments])
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_a_duration_and_a_bench_file(
    boards: dict[str, Board], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bench file's boards are found by serial number and interface."""
    there = [
        PortInfo(str(boards["leader"].link), "1050000001", 0, 0x1366, 1),
        PortInfo(str(boards["follower"].link), "1050000002", 2, 0x1366, 1),
    ]
    monkeypatch.setattr(sources.ports, "find_ports", lambda: there)
    bench = tmp_path / "bench.toml"
    bench.write_text(
        'format = 1\n[boards.leader]\nprobe = "1050000001"\nvcom = 0\n'
        '[boards.follower]\nprobe = "1050000002"\nvcom = 2\n'
    )
    output = tmp_path / "log.mcap"
    base = ["log", "--bench-file", str(bench), "-o", str(output), "--duration", "0.3s"]
    result = CliRunner().invoke(app, base)
    assert result.exit_code == 0, result.output
    assert "0.3 s are over" in result.output
    (recording,) = whole([output])
    assert recording.roles == ("leader", "follower")
    assert recording.provenance.host["ports"]["follower"]["vcom"] == 2
    output.unlink()
    assert CliRunner().invoke(app, [*base, "--role", "follower"]).exit_code == 0
    assert load(output).roles == ("follower",)
    assert tables_of_parts([load(output)], "leader") == {}
    assert np.size(load(output).edges.t_ns_bench) == 0
