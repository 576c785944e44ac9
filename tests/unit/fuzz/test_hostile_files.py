# SPDX-License-Identifier: Apache-2.0
"""Each hostile file is refused in one line, at once, in little memory, and as the manual says."""

from __future__ import annotations

import resource
import time
import tracemalloc
from pathlib import Path

import pytest

from hil.errors import HilError
from hil.recording import Event, Provenance, Writer, load
from hil.scenario import from_mapping
from tests.fuzz.common import check_refusal
from tests.unit.fuzz.hostile import BEGIN, CASES, END, READERS, section

ROOT = Path(__file__).parents[3]
DOCUMENT = ROOT / "docs" / "refusals.md"
MEMORY_MAX_B = 24 << 20
SECONDS_MAX = 5.0
NAMES = {
    "Recordings (.mcap)": "run.mcap",
    "Sessions of sigrok (.sr)": "capture.sr",
    "Value change dumps (.vcd)": "capture.vcd",
    "Exports of Saleae Logic 2 (digital.csv)": "digital.csv",
    "References (.csv)": "reference.csv",
    "The bench file (bench.toml)": "bench.toml",
    "Scenarios (.toml)": "scenario.toml",
}


def refused(reader: str, path: Path) -> HilError:
    """The refusal, which took little time and memory."""
    tracemalloc.start()
    began = time.process_time()
    try:
        with pytest.raises(HilError) as caught:
            READERS[reader](path)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert time.process_time() - began < SECONDS_MAX
    assert peak < MEMORY_MAX_B + 4 * path.stat().st_size
    check_refusal(caught.value, path)
    return caught.value


def said_of_all(folder: Path) -> dict[tuple[str, str], str]:
    said: dict[tuple[str, str], str] = {}
    for reader, cases in CASES.items():
        for case in cases:
            path = folder / NAMES[reader]
            path.write_bytes(case.make())
            message = refused(reader, path).message
            said[reader, case.what] = message.replace(str(path), path.name)
    return said


def test_every_hostile_file_is_refused_as_the_manual_says(tmp_path: Path) -> None:
    wanted = section(said_of_all(tmp_path))
    text = DOCUMENT.read_text(encoding="utf-8")
    found = text[text.index(BEGIN) : text.index(END) + len(END)]
    anew = tmp_path / "section.md"
    anew.write_text(wanted, encoding="utf-8")
    assert found == wanted, f"the section of docs/refusals.md, as it is now: {anew}"


def test_a_table_that_drifts_is_seen(tmp_path: Path) -> None:
    said = {(reader, case.what): "x" for reader, cases in CASES.items() for case in cases}
    assert section(said) not in DOCUMENT.read_text(encoding="utf-8")


def test_no_more_address_space_than_the_limit(tmp_path: Path) -> None:
    """What tracemalloc does not see, the system does: decompressors allocate by themselves."""
    case = next(c for c in CASES["Sessions of sigrok (.sr)"] if "128 MiB" in c.what)
    path = tmp_path / "capture.sr"
    path.write_bytes(case.make())
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused("Sessions of sigrok (.sr)", path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 64 << 10


def test_a_clock_that_goes_back_is_told_and_edges_are_put_in_order(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Writer(path, Provenance("synthetic", "")) as writer:
        for t_ns in (5, 1 << 62, 7):
            writer.write_serial("leader", t_ns, b"ab")
        writer.write_edges([9, 3], [0, 0], [1, 0])
        writer.write_event(Event(-(1 << 62), "note", "leader"))
    recording = load(path)
    said = "\n".join(recording.integrity.problems)
    assert "/serial/leader: time goes back 1 times" in said
    assert "/edges: time of leader.radio_end goes back 1 times" in said
    assert recording.edges.t_ns_bench.tolist() == [3, 9]


def test_slots_of_32_bits_end_where_they_end(tmp_path: Path) -> None:
    """The last slot that there can be is kept; a wrap behind it is told, not taken for new."""
    path = tmp_path / "run.mcap"
    last = (1 << 32) - 1
    with Writer(path, Provenance("synthetic", "")) as writer:
        counts = [[1, 2, 3, 4, 5, 6]]
        for slot, t_us in ((last - 1, 1.0), (last, 2.0), (0, 3.0)):
            writer.write_imu_truth("leader", [0], [slot], [t_us], counts, [0])
    recording = load(path)
    assert recording.imu_truth["leader"].slot.tolist() == [last - 1, last, 0]
    assert "time or slot goes back 1 times" in "\n".join(recording.integrity.problems)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e30, 1 << 63, -(1 << 63)])
@pytest.mark.parametrize("key", ["duration_s", "seed"])
def test_numbers_of_no_use_in_the_provenance_of_a_recording(key: str, value: float) -> None:
    with pytest.raises(HilError, match=rf"run\.mcap: '{key}'"):
        from_mapping({"name": "x", key: value}, "run.mcap")


def test_no_member_of_a_session_is_ever_written_to_disk(tmp_path: Path) -> None:
    case = next(c for c in CASES["Sessions of sigrok (.sr)"] if "point out" in c.what)
    path = tmp_path / "capture.sr"
    path.write_bytes(case.make())
    refused("Sessions of sigrok (.sr)", path)
    assert [p.name for p in tmp_path.iterdir()] == ["capture.sr"]
