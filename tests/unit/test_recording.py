# SPDX-License-Identifier: Apache-2.0
"""Writing and reading a recording, the small rules of its parts, and what the writer refuses."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
from collections import OrderedDict
from pathlib import Path
from types import MappingProxyType

import mcap.reader
import numpy as np
import pytest

from hil.errors import RecordingError
from hil.recording import (
    EDGE_CHANNELS,
    ClockModel,
    Edges,
    Event,
    Integrity,
    Provenance,
    Recording,
    SerialStream,
    Writer,
    layout,
    load,
)
from hil.wire.codec import encode
from hil.wire.messages import schema, schema_hash

SCENARIO = {
    "name": "clean",
    "nodes": {
        "leader": {"drift_ppm": 13.7, "start_offset_us": 100, "wander": []},
        "follower": {"drift_ppm": -31.1, "start_offset_us": 200, "wander": []},
    },
}
PROVENANCE = Provenance(
    source="sim",
    created_utc="2025-06-01T12:00:00Z",
    scenario=SCENARIO,
    manifests={"leader": {"sha256": "ab" * 32, "flash_b": 171_000}},
    tools={"zephyr": "4.1.0"},
    host={"cpu": "ü"},
    notes="two\nlines",
)
HELLO = {
    "protocol_version": 1,
    "role": 0,
    "target": 0,
    "schema_hash": schema_hash(),
    "build_id": 7,
    "device_id": 2**64 - 1,
    "reset_reason": 1,
    "tick_rate_hz": 16_000_000,
    "conn_interval_us": 7500,
    "uptime_ms": 0,
}


def stream(*reads: tuple[int, bytes]) -> SerialStream:
    lengths = np.array([len(data) for _, data in reads], dtype=np.int64)
    return SerialStream(
        data=np.frombuffer(b"".join(data for _, data in reads), np.uint8),
        block_offset=np.cumsum(lengths) - lengths,
        block_t_ns_bench=np.array([t for t, _ in reads], dtype=np.int64),
    )


def recording(provenance: Provenance = PROVENANCE, **serial: SerialStream) -> Recording:
    none = np.zeros(0, np.uint8)
    edges = Edges(np.zeros(0, np.int64), none, none, EDGE_CHANNELS, 1000.0)
    return Recording(provenance, serial, edges, (), Integrity(complete=True))


def test_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    reads: dict[str, list[tuple[int, bytes]]] = {"leader": [], "follower": []}
    edges: list[tuple[int, int, int]] = []
    events = [Event(-5, "reset", "leader", {"reason": 1}), Event(10**12, "note", "", {"ü": [1.5]})]
    path = tmp_path / "clean.mcap"
    with Writer(path, PROVENANCE, edge_resolution_ns=41.5) as writer:
        for i in range(2000):
            for role, log in reads.items():
                read = (i * 1_000_000 - 3, rng.bytes(int(rng.integers(1, 700))))
                log.append(read)
                writer.write_serial(role, *read)
            if i % 3 == 0:
                pair = [(i * 1_000_000, i % 6, 1), (i * 1_000_000 + 7, i % 6, 0)]
                edges += pair
                writer.write_edges(*zip(*pair, strict=True))
        for event in events:
            writer.write_event(event)

    loaded = load(path)
    assert loaded.integrity.complete
    assert loaded.integrity.problems == ()
    assert loaded.integrity.lost_blocks == 0
    assert loaded.integrity.blocks > 90
    assert loaded.provenance.to_mapping() == json.loads(json.dumps(PROVENANCE.to_mapping()))
    assert loaded.roles == ("leader", "follower")
    assert (loaded.path, loaded.name) == (path, "clean")
    for role, log in reads.items():
        expected, found = stream(*log), loaded.serial[role]
        assert found.data.tobytes() == expected.data.tobytes()
        np.testing.assert_array_equal(found.block_offset, expected.block_offset)
        np.testing.assert_array_equal(found.block_t_ns_bench, expected.block_t_ns_bench)
        assert len(found.gap_offset) == len(found.gap_bytes) == 0
    found_edges = loaded.edges
    rows = zip(found_edges.t_ns_bench, found_edges.channel, found_edges.level, strict=True)
    assert list(rows) == edges
    assert (found_edges.channels, found_edges.resolution_ns) == (EDGE_CHANNELS, 41.5)
    assert list(loaded.events) == events


def test_an_empty_run_is_a_complete_recording(tmp_path: Path) -> None:
    with Writer(tmp_path / "e.mcap", PROVENANCE):
        pass
    loaded = load(str(tmp_path / "e.mcap"))
    assert loaded.integrity.complete
    assert loaded.integrity.problems == ()
    assert [len(s.data) for s in loaded.serial.values()] == [0, 0]
    assert len(loaded.edges.t_ns_bench) == 0


def test_arrays_cannot_be_written_to(tmp_path: Path) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        writer.write_serial("leader", 1, b"abc")
        writer.write_edges([5, 3], [0, 1], [1, 0])
    loaded = load(tmp_path / "r.mcap")
    leader, edges = loaded.serial["leader"], loaded.edges
    arrays = [leader.data, leader.block_offset, leader.block_t_ns_bench, leader.gap_offset]
    arrays += [edges.t_ns_bench, edges.channel, edges.level, *edges.select("leader.pulse")]
    for array in arrays:
        assert not array.flags.writeable
    with pytest.raises(ValueError, match="WRITEABLE"):
        leader.data.flags.writeable = True
    with pytest.raises(TypeError):
        loaded.serial["leader"] = leader  # type: ignore[index]


def test_time_of_a_byte_is_that_of_its_read() -> None:
    port = stream((10, b"abc"), (20, b"d"), (20, b"ef"))
    np.testing.assert_array_equal(port.t_ns_bench(range(6)), [10, 10, 10, 20, 20, 20])
    assert port.t_ns_bench(3) == 20
    assert port.t_ns_bench([]).dtype == np.int64
    for outside in (-1, 6):
        with pytest.raises(IndexError, match="6 bytes"):
            port.t_ns_bench([0, outside])
    with pytest.raises(IndexError):
        stream().t_ns_bench(0)


def test_edges_by_name() -> None:
    edges = Edges([1, 2, 3], [1, 0, 1], [1, 1, 0], ("a.x", "b.x"), 1.0)  # type: ignore[arg-type]
    t_ns, level = edges.select("b.x")
    np.testing.assert_array_equal(t_ns, [1, 3])
    np.testing.assert_array_equal(level, [1, 0])
    with pytest.raises(RecordingError, match=r"c\.x") as caught:
        edges.select("c.x")
    assert "a.x, b.x" in caught.value.mend


def test_edges_of_several_pins_may_be_written_one_after_the_other(tmp_path: Path) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        writer.write_edges([10, 30], [0, 0], [1, 0])
        writer.write_edges([20, 30], [2, 2], [1, 0])
    loaded = load(tmp_path / "r.mcap")
    np.testing.assert_array_equal(loaded.edges.t_ns_bench, [10, 20, 30, 30])
    np.testing.assert_array_equal(loaded.edges.channel, [0, 2, 0, 2])
    assert loaded.integrity.problems == ()


def test_times_that_go_back_are_reported_and_kept(tmp_path: Path) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        writer.write_serial("leader", 20, b"a")
        writer.write_serial("leader", 10, b"b")
        writer.write_edges([5, 4, 6], [0, 0, 0], [1, 0, 1])
    loaded = load(tmp_path / "r.mcap")
    np.testing.assert_array_equal(loaded.serial["leader"].block_t_ns_bench, [20, 10])
    assert loaded.integrity.problems == (
        "/edges: time of leader.radio_end goes back 1 times",
        "/serial/leader: time goes back 1 times",
    )
    assert loaded.integrity.complete


def test_truth_is_known_only_for_simulated_clocks() -> None:
    truth = recording().truth
    assert truth["leader"] == ClockModel(drift=13.7e-6, start_offset_us=100)
    assert truth["follower"].drift == pytest.approx(-31.1e-6)
    bench = Provenance("bench", "2025-06-01T12:00:00Z", scenario=SCENARIO)
    assert recording(bench).truth == {}
    assert recording(Provenance("sim", "2025-06-01T12:00:00Z")).truth == {}
    half = Provenance("synthetic", "", scenario={"nodes": {"leader": {"drift_ppm": 1}}})
    assert recording(half).truth["follower"] == ClockModel()
    for nodes in (3, [1], {"leader": 4}):
        wrong = Provenance("sim", "", scenario={"name": "x", "nodes": nodes})
        with pytest.raises(RecordingError):
            _ = recording(wrong).truth


def test_names(tmp_path: Path) -> None:
    assert recording().name == "clean"
    folder = tmp_path / "lossy"
    folder.mkdir()
    with Writer(folder / "recording.mcap", PROVENANCE):
        pass
    assert load(folder / "recording.mcap").name == "lossy"


def test_decoded_is_cached_and_knows_its_roles() -> None:
    whole = recording(leader=stream((1, encode("hello", HELLO, 0) + b"t,1\r\n")))
    decoded = whole.decoded("leader")
    assert decoded.stats.frames == 1
    assert decoded.messages["hello"]["device_id"][0] == 2**64 - 1
    assert whole.decoded("leader") is decoded
    with pytest.raises(RecordingError, match="follower") as caught:
        whole.decoded("follower")
    assert "leader" in caught.value.mend


def test_decoding_uses_the_embedded_table() -> None:
    """A table of an older day names a field differently; the recording says how."""
    table = json.loads(json.dumps(schema()).replace('"device_id"', '"chip_id"'))
    old = Provenance("sim", "", schema=table, schema_hash="0")
    decoded = recording(old, leader=stream((1, encode("hello", HELLO, 0)))).decoded("leader")
    assert decoded.messages["hello"]["chip_id"][0] == 2**64 - 1
    broken = recording(Provenance("sim", "", schema={"messages": 3}), leader=stream((1, b"x")))
    with pytest.raises(RecordingError, match="table cannot be used"):
        broken.decoded("leader")


def test_any_mcap_tool_can_read_it(tmp_path: Path) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        writer.write_serial("leader", 5, b"abc")
    with (tmp_path / "r.mcap").open("rb") as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "hil"
        found = [(s, c, m) for s, c, m in reader.iter_messages()]
    topics = [channel.topic for _, channel, _ in found]
    assert sorted(topics) == ["/end", "/provenance", "/provenance", "/serial/leader"]
    serial_schema, channel, message = found[topics.index("/serial/leader")]
    assert (channel.message_encoding, message.log_time) == ("x-hil-block", 5)
    assert serial_schema is not None
    assert "start_offset" in serial_schema.data.decode()
    assert message.data == (
        b"\0\0\0\0\0\0\0\0" + b"\x01\0\0\0" + b"\x05\0\0\0\0\0\0\0" + b"\x03\0\0\0" + b"abc"
    )


def test_long_writes_are_split_and_chunks_stay_small(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    data = np.random.default_rng(5).bytes(3_000_000)
    count = 200_000
    with Writer(path, PROVENANCE) as writer:
        writer.write_serial("leader", 9, data)
        writer.write_serial("leader", 9, b"")
        writer.write_edges(np.arange(count), np.zeros(count, int), np.arange(count) % 2)
    loaded = load(path)
    assert loaded.integrity.complete
    assert loaded.serial["leader"].data.tobytes() == data
    assert set(loaded.serial["leader"].block_t_ns_bench) == {9}
    np.testing.assert_array_equal(loaded.edges.t_ns_bench, np.arange(count))
    with path.open("rb") as file:
        summary = mcap.reader.make_reader(file).get_summary()
    assert summary is not None
    largest = max(index.uncompressed_size for index in summary.chunk_indexes)
    assert largest < 2 * layout.CHUNK_BYTES


def test_what_was_flushed_can_be_read_while_the_run_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    with Writer(path, PROVENANCE) as writer:
        writer.write_serial("leader", 1, b"first")
        writer.flush()
        writer.write_serial("leader", 2, b"second")
        during = load(path)
    assert during.serial["leader"].data.tobytes() == b"first"
    assert not during.integrity.complete
    assert "never closed" in during.integrity.problems[0]
    assert load(path).serial["leader"].data.tobytes() == b"firstsecond"


def test_an_aborted_run_is_readable_and_never_complete(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"

    def run() -> None:
        with Writer(path, PROVENANCE) as writer:
            writer.write_serial("leader", 1, b"abc")
            raise KeyboardInterrupt("\udcff \x1b[31m")

    with pytest.raises(KeyboardInterrupt):
        run()
    loaded = load(path)
    assert loaded.serial["leader"].data.tobytes() == b"abc"
    assert loaded.integrity.lost_blocks == 0
    assert not loaded.integrity.complete
    assert loaded.integrity.problems == ("the run was aborted: KeyboardInterrupt: ? ?[31m",)


def test_threads_may_write_at_once(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    with Writer(path, PROVENANCE) as writer:

        def fill(role: str) -> None:
            for i in range(3000):
                writer.write_serial(role, i, i.to_bytes(4, "little") * 40)

        threads = [threading.Thread(target=fill, args=(role,)) for role in ("leader", "follower")]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    loaded = load(path)
    assert loaded.integrity.complete
    for role in loaded.roles:
        words = loaded.serial[role].data.view("<u4")
        np.testing.assert_array_equal(words, np.repeat(np.arange(3000), 40))


def test_plain_mappings_of_any_kind_are_recorded(tmp_path: Path) -> None:
    scenario = MappingProxyType({"name": "m", "nodes": OrderedDict(leader=MappingProxyType({}))})
    with Writer(tmp_path / "r.mcap", Provenance("sim", "", scenario=scenario)):
        pass
    found = load(tmp_path / "r.mcap").provenance.scenario
    assert found == {"name": "m", "nodes": {"leader": {}}}


def test_an_existing_file_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="exists already") as caught:
        Writer(path, PROVENANCE)
    assert "another name" in caught.value.mend
    assert path.read_bytes() == b"precious"


@pytest.mark.parametrize("where", ["missing/r.mcap", "r\0.mcap", "x" * 300])
def test_a_file_that_cannot_be_made(tmp_path: Path, where: str) -> None:
    with pytest.raises(RecordingError, match="cannot be written"):
        Writer(tmp_path / where, PROVENANCE)


@pytest.mark.parametrize(
    "edges",
    [
        ([1.5], [0], [1]),
        (["a"], [0], [1]),
        ([2**63], [0], [1]),
        ([1, 2], [0], [1]),
        ([[1]], [[0]], [[1]]),
        ([1], [6], [1]),
        ([1], [-1], [1]),
        ([1], [0], [2]),
        ([1], [0], [-1]),
        ([1], [0], [math.nan]),
    ],
)
def test_edges_that_are_none_are_refused(tmp_path: Path, edges: tuple[list, ...]) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        with pytest.raises(RecordingError):
            writer.write_edges(*edges)
        writer.write_edges([], [], [])
        writer.write_edges(np.uint32(7), np.uint8(1), True)
    loaded = load(tmp_path / "r.mcap")
    assert loaded.integrity.problems == ()
    np.testing.assert_array_equal(loaded.edges.t_ns_bench, [7])


@pytest.mark.parametrize(
    "event",
    [
        Event(2**63, "k", "n"),
        Event(1.5, "k", "n"),  # type: ignore[arg-type]
        Event(1, "k", "n", {"x": math.nan}),
        Event(1, "k", "n", {"x": object()}),
        Event(1, "k\ud800", "n"),
        Event(1, "k", "n", {"x": 2**64}),
        Event(1, "k", "n", {"x": "y" * 5_000_000}),
    ],
)
def test_events_that_cannot_be_kept_are_refused(tmp_path: Path, event: Event) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        with pytest.raises(RecordingError):
            writer.write_event(event)
        writer.write_event(Event(1, "k", "n"))
    assert load(tmp_path / "r.mcap").events == (Event(1, "k", "n"),)


def test_serial_that_cannot_be_kept_is_refused(tmp_path: Path) -> None:
    with Writer(tmp_path / "r.mcap", PROVENANCE) as writer:
        with pytest.raises(RecordingError, match="'third'") as caught:
            writer.write_serial("third", 1, b"x")
        assert "leader" in caught.value.mend
        for t in (2**63, 1.0, None):
            with pytest.raises(RecordingError, match="time"):
                writer.write_serial("leader", t, b"x")  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match="closed"):
        writer.write_serial("leader", 1, b"x")
    assert len(load(tmp_path / "r.mcap").serial["leader"].data) == 0


@pytest.mark.parametrize(
    "options",
    [
        {"roles": ["../x"]},
        {"roles": [f"port{i}" for i in range(17)]},
        {"edge_channels": ["A\n"]},
        {"edge_channels": ["a"] * 257},
        {"edge_resolution_ns": math.nan},
        {"edge_resolution_ns": -1},
    ],
)
def test_options_that_make_no_sense(tmp_path: Path, options: dict) -> None:
    with pytest.raises(RecordingError):
        Writer(tmp_path / "r.mcap", PROVENANCE, **options)
    assert not (tmp_path / "r.mcap").exists()


@pytest.mark.parametrize(
    "change",
    [{"source": "dream"}, {"notes": 3}, {"scenario": []}, {"manifests": {"leader": 3}}],
)
def test_provenance_that_is_none_is_refused(change: dict) -> None:
    with pytest.raises(RecordingError, match="provenance"):
        Provenance(**{"source": "sim", "created_utc": "", **change})


def test_a_full_disk_is_one_clear_error_and_loses_only_what_did_not_fit(tmp_path: Path) -> None:
    """The size limit of a process stands in for the disk: write() fails the same way."""
    script = """
import resource, sys
from hil.errors import RecordingError
from hil.recording import Provenance, Writer
import random
resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))
rng = random.Random(1)
with Writer(sys.argv[1], Provenance("sim", "")) as writer:
    try:
        for i in range(1000):
            writer.write_serial("leader", i, rng.randbytes(1000))
    except RecordingError as error:
        print(error)
    try:
        writer.write_serial("leader", i, b"x")
    except RecordingError as again:
        print(again)
"""
    path = tmp_path / "r.mcap"
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "cannot be written: File too large" in done.stdout
    assert "has room" in done.stdout
    assert "the recording is unusable after a failed write" in done.stdout
    assert done.stderr == ""
    loaded = load(path)
    assert not loaded.integrity.complete
    assert len(loaded.serial["leader"].data) >= layout.CHUNK_BYTES
