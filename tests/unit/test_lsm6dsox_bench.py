# SPDX-License-Identifier: Apache-2.0
"""Chip model and FIFO stream on a bench in Python: every sample, its number and its time.

Both are the firmware's own C sources, compiled by the host's compiler. The wires between them, and
the driver's thread, are this file: when the pin rises, what the bus costs, how late the host is.
"""

from __future__ import annotations

import ctypes
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.unit.native import USUAL, shared_library

ROOT = Path(__file__).resolve().parents[2]
DRIVER = ROOT / "firmware" / "drivers" / "lsm6dsox"
WIRE = ROOT / "firmware" / "lib" / "wire"
SHIM = ROOT / "tests" / "unit" / "c" / "lsm6dsox_bench_shim.c"
SOURCES = (
    *(DRIVER / f"lsm6dsox_{part}.c" for part in ("decoder", "rest", "stream", "timing")),
    *(DRIVER / "model" / f"{part}.c" for part in ("chip", "fault", "motion", "registers")),
    SHIM,
)

TICKS_PER_US = 16
TOP_RATE_HZ = 6667.0
WORD_SIZE = 7
FIFO_WORDS = 512
HARDWARE_TIME, OVERRUN_BEFORE, CLIPPED = 1, 2, 4
FIFO_STATUS1, FIFO_DATA_OUT_TAG = 0x3A, 0x78
SLOTS, SAMPLES, BATCHES = 0, 1, 2
LOG_FIELDS = {SLOTS: 10, SAMPLES: 10, BATCHES: 5}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    output = tmp_path_factory.mktemp("lsm6dsox") / "bench.so"
    loaded = shared_library(output, SOURCES, [DRIVER, WIRE], USUAL)
    loaded.shim_new.restype = ctypes.c_void_p
    loaded.shim_next_us.restype = ctypes.c_double
    loaded.shim_transfer.restype = ctypes.c_double
    loaded.shim_rows.restype = ctypes.c_size_t
    return loaded


def samples_per_batch(rate_code: int) -> int:
    return int(np.clip(int(0.04 * TOP_RATE_HZ / 2 ** (10 - rate_code)), 1, 16))


@dataclass
class Bench:
    """The driver's loop, in the test's hands. Times are true microseconds."""

    library: ctypes.CDLL
    rate_code: int = 6
    rate_error: float = -0.068
    rate_drift_per_s: float = 0.0
    pattern: bool = True
    motion_file: Path | None = None
    accel_fs_code: int = 1
    gyro_fs_code: int = 6
    byte_us: float = 1.0
    latency_us: Callable[[], float] = field(default=lambda: 40.0)
    int1_latency_us: int = 0
    burst_words: int = 64
    damage: Callable[[bytes], bytes] = field(default=lambda words: words)
    t_us: float = 1000.0
    overruns: int = 0

    def __post_init__(self) -> None:
        problem = ctypes.create_string_buffer(256)
        self.handle = ctypes.c_void_p(
            self.library.shim_new(
                ctypes.c_double(self.rate_error),
                ctypes.c_double(self.rate_drift_per_s),
                int(self.pattern),
                str(self.motion_file).encode() if self.motion_file else None,
                problem,
                ctypes.c_size_t(256),
            )
        )
        self.problem = problem.value.decode()
        self.batch = samples_per_batch(self.rate_code)
        self.watermark = 2 * self.batch
        self.rate_hz = TOP_RATE_HZ / 2 ** (10 - self.rate_code)
        self.library.shim_stream_init(
            self.handle,
            ctypes.c_double(self.rate_hz),
            self.batch,
            self.int1_latency_us * TICKS_PER_US,
        )
        self.edge_us: float | None = None
        self.int1 = False

    def close(self) -> None:
        self.library.shim_free(self.handle)

    # --- the bus ---

    def transfer(self, mosi: bytes) -> bytes:
        miso = (ctypes.c_uint8 * len(mosi))()
        self.t_us = self.library.shim_transfer(
            self.handle,
            ctypes.c_double(self.t_us),
            ctypes.c_double(self.byte_us),
            (ctypes.c_uint8 * len(mosi)).from_buffer_copy(mosi),
            miso,
            ctypes.c_size_t(len(mosi)),
        )
        self.watch_pin()
        return bytes(miso[1:])

    def write(self, address: int, value: int) -> None:
        self.transfer(bytes([address, value]))

    def read(self, address: int, size: int) -> bytes:
        return self.transfer(bytes([address | 0x80]) + bytes(size))

    # --- time and the pin ---

    def watch_pin(self, masked: bool = True) -> None:
        level = bool(self.library.shim_int1(self.handle))
        if level and not self.int1 and not masked:
            self.edge_us = float(round(self.t_us)) + self.int1_latency_us
        self.int1 = level

    def run_until(self, t_us: float) -> bool:
        """Let time pass; stop early, and say so, when the pin has risen."""
        while not self.int1:
            next_us = self.library.shim_next_us(self.handle)
            if next_us > t_us:
                self.t_us = max(self.t_us, t_us)
                return False
            self.t_us = max(self.t_us, next_us)
            # The chip's own time is finer than a double: reach the sample for certain.
            self.library.shim_advance(self.handle, ctypes.c_double(next_us + 1e-6))
            self.watch_pin(masked=False)
        return True

    def pause(self, duration_us: float) -> None:
        """The host does nothing; the chip goes on."""
        self.t_us += duration_us
        self.library.shim_advance(self.handle, ctypes.c_double(self.t_us))
        self.watch_pin()

    def ticks(self, t_us: float) -> ctypes.c_uint64:
        return ctypes.c_uint64(round(t_us) * TICKS_PER_US)

    # --- the driver ---

    def set_up(self) -> None:
        self.write(0x12, 0x05)
        self.pause(200.0)
        code = self.rate_code
        for address, value in (
            (0x12, 0x44),
            (0x13, 0x0C),
            (0x18, 0xE2),
            (0x07, self.watermark & 0xFF),
            (0x08, 0x10 | self.watermark >> 8),
            (0x09, code << 4 | code),
            (0x0D, 0x08),
            (0x11, code << 4 | self.gyro_fs_code << 1),
            (0x10, code << 4 | self.accel_fs_code << 2),
            (0x0A, 0x06),
        ):
            self.write(address, value)

    def serve(self, polled: bool = False) -> None:
        edge_us, self.edge_us = self.edge_us, None
        raw = self.read(FIFO_STATUS1, 2)
        status_us = self.t_us
        level = raw[0] | (raw[1] & 3) << 8
        if level >= FIFO_WORDS - 4:
            overrun = bool(raw[1] & 0x48)
            self.overruns += overrun
            self.library.shim_gap(self.handle, int(overrun))
        elif edge_us is not None:
            self.library.shim_edge(self.handle, self.ticks(edge_us))
        while level > 0:
            now = min(level, self.burst_words)
            words = self.damage(self.read(FIFO_DATA_OUT_TAG, now * WORD_SIZE))
            data = (ctypes.c_uint8 * len(words)).from_buffer_copy(words)
            self.library.shim_words(self.handle, data, ctypes.c_size_t(len(words)))
            level -= now
        self.library.shim_end(self.handle, self.ticks(status_us), int(polled))

    def stream(self, duration_s: float) -> None:
        end_us = self.t_us + duration_s * 1e6
        while self.run_until(end_us):
            self.pause(self.latency_us())
            self.serve()
            while self.int1:
                self.serve()

    # --- what came of it ---

    def log(self, which: int) -> NDArray[np.float64]:
        rows = np.empty((self.library.shim_rows(self.handle, which), LOG_FIELDS[which]))
        self.library.shim_copy(
            self.handle, which, rows.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        )
        return rows

    @property
    def counters(self) -> dict[str, int]:
        values = (ctypes.c_int64 * 7)()
        self.library.shim_counters(self.handle, values)
        names = ("samples", "crc32", "unsettled", "by_time", "lost", "pairs", "refused")
        return dict(zip(names, values, strict=True))

    @property
    def violations(self) -> int:
        text = ctypes.create_string_buffer(200)
        return int(self.library.shim_violations(self.handle, text, ctypes.c_size_t(200)))


@pytest.fixture
def make(library: ctypes.CDLL) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def new(**options: object) -> Bench:
        made.append(Bench(library, **options))  # type: ignore[arg-type]
        return made[-1]

    yield new
    for bench in made:
        bench.close()


def check_samples(bench: Bench) -> NDArray[np.float64]:
    """Every sample is one of the chip's, in order, numbered as the chip numbers it.

    Returns:
        error of each batch's time in us, float64[batches].
    """
    slots, samples, batches = bench.log(SLOTS), bench.log(SAMPLES), bench.log(BATCHES)
    last_run = slots[slots[:, 0] == slots[-1, 0]]
    t_us_of_slot = dict(zip(last_run[:, 1], last_run[:, 2], strict=True))
    slot = samples[:, 4].astype(np.int64) | samples[:, 5].astype(np.int64) << 14
    np.testing.assert_array_equal(samples[:, 7:10], -1 - samples[:, 4:7])
    assert np.all(np.diff(slot) > 0), "in order, none twice"
    assert np.unique(slot - samples[:, 0]).size == 1, "the index counts the chip's slots"
    first = np.flatnonzero(samples[:, 2] == 0)
    true_us = np.array([t_us_of_slot[s] for s in slot[first]])
    return np.asarray(batches[:, 1] / TICKS_PER_US - true_us, dtype=np.float64)


@pytest.mark.parametrize("rate_code", range(1, 11))
def test_every_rate_on_time_and_complete(make: Callable[..., Bench], rate_code: int) -> None:
    bench = make(rate_code=rate_code)
    bench.set_up()
    bench.stream(20.0 if rate_code < 7 else 3.0)
    error_us = check_samples(bench)
    batches = bench.log(BATCHES)
    assert np.max(np.abs(error_us)) <= 1.0
    assert np.all(batches[:, 3] == HARDWARE_TIME)
    counters = bench.counters
    assert counters["lost"] == counters["refused"] == bench.violations == 0
    assert counters["samples"] == batches[:, 2].sum()
    true_ticks = TICKS_PER_US * 1e6 / (bench.rate_hz * (1 - 0.068))
    assert batches[-1, 4] / 256 == pytest.approx(true_ticks, rel=20e-6)


def test_the_latency_of_int1_is_taken_off(make: Callable[..., Bench]) -> None:
    bench = make(int1_latency_us=7)
    bench.set_up()
    bench.stream(3.0)
    assert np.max(np.abs(check_samples(bench))) <= 1.0


def test_the_edge_finds_its_word_over_several_bursts(make: Callable[..., Bench]) -> None:
    bench = make(burst_words=5)
    bench.set_up()
    bench.stream(3.0)
    assert np.max(np.abs(check_samples(bench))) <= 1.0
    assert np.all(bench.log(BATCHES)[:, 3] == HARDWARE_TIME)


def test_without_edges_batches_come_but_claim_no_hardware_time(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.set_up()
    for _ in range(200):
        bench.pause(50e3)
        bench.edge_us = None
        bench.serve(polled=True)
    period_us = 1e6 / (bench.rate_hz * (1 - 0.068))
    error_us = check_samples(bench)
    assert np.all(bench.log(BATCHES)[:, 3] == 0)
    assert np.max(np.abs(error_us[len(error_us) // 2 :])) < period_us


def test_damage_that_two_words_agree_on_moves_numbers_and_not_times(
    make: Callable[..., Bench],
) -> None:
    """Both tags of one slot turn into those of the slot after the next; no single check sees it."""
    bench = make()
    bench.set_up()
    bench.stream(1.0)
    hits = 0

    def damage(words: bytes) -> bytes:
        nonlocal hits
        hits += 1
        if hits != 5:
            return words
        data = bytearray(words)
        for word in (8, 9):
            sensor, count = data[7 * word] >> 3, (data[7 * word] >> 1) + 2 & 3
            tag = sensor << 3 | count << 1
            data[7 * word] = tag | tag.bit_count() & 1
        return bytes(data)

    bench.damage = damage
    bench.stream(1.0)
    slots, batches, samples = bench.log(SLOTS), bench.log(BATCHES), bench.log(SAMPLES)
    t_us_of_slot = dict(zip(slots[:, 1], slots[:, 2], strict=True))
    slot = samples[:, 4].astype(int) | samples[:, 5].astype(int) << 14
    assert np.all(np.diff(slot) > 0)
    assert np.unique(slot - samples[:, 0]).size > 1, "numbers given out cannot be taken back"
    first = np.flatnonzero(samples[:, 2] == 0)
    error_us = batches[:, 1] / TICKS_PER_US - [t_us_of_slot[s] for s in slot[first]]
    # The burst that was hit, the one whose edge came before it was known, and the next: its edge
    # is two slots off by number, which is no multiple of four and so cannot be told from damage.
    assert np.sum(np.abs(error_us) > 1.0) <= 3
    assert np.all(np.abs(error_us[-10:]) <= 1.0)


def test_the_checksum_is_the_crc32_of_all_samples(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.set_up()
    bench.stream(2.0)
    rows = bench.log(SAMPLES)[:, 4:10].astype("<i2")
    assert bench.counters["crc32"] == zlib.crc32(rows.tobytes())


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate_code=st.integers(4, 10),
    rate_error=st.floats(-0.09, 0.09),
    stalls=st.lists(st.floats(0.2, 3.0), max_size=4),
)
def test_random_lateness_and_stalls(
    library: ctypes.CDLL, seed: int, rate_code: int, rate_error: float, stalls: list[float]
) -> None:
    """Stalls are in units of the time that the FIFO can hold."""
    rng = np.random.default_rng(seed)
    bench = Bench(library, rate_code=rate_code, rate_error=rate_error)
    batch_us = bench.batch * 1e6 / bench.rate_hz
    bench.latency_us = lambda: float(rng.exponential(0.1 * batch_us))
    hold_us = FIFO_WORDS / 2 / (bench.rate_hz * (1 + rate_error)) * 1e6
    bench.set_up()
    bench.stream(0.5)
    for stall in stalls:
        bench.pause(stall * hold_us)
        bench.serve()
        bench.stream(0.2)
    # Long without an edge, the time of a sample is not claimed to be hardware's.
    timed = bench.log(BATCHES)[:, 3].astype(int) & HARDWARE_TIME != 0
    error_us = check_samples(bench)[timed]
    lost = bench.counters["lost"]
    overruns = bench.overruns
    flagged = int(np.sum(bench.log(BATCHES)[:, 3].astype(int) & OVERRUN_BEFORE != 0))
    indices = bench.log(SAMPLES)[:, 0]
    bench.close()
    assert np.max(np.abs(error_us)) <= 1.0
    assert indices[-1] - indices[0] + 1 - indices.size == lost
    assert (lost > 0) == (overruns > 0)
    assert flagged == overruns
    assert timed[0]
    assert timed[-1], "a few edges later it is again"
    if any(stall > 1.1 for stall in stalls):
        assert overruns > 0


def test_a_restart_of_the_chip_shows_as_a_hole(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.set_up()
    bench.stream(1.0)
    bench.pause(0.5e6)
    bench.set_up()
    bench.library.shim_restarted(bench.handle, bench.ticks(bench.t_us), 1)
    before = bench.log(SAMPLES)[-1, 0]
    bench.stream(1.0)
    after = bench.log(SAMPLES)[:, 0]
    after = after[after > before]
    # Half a second and the settling: 388 Hz, 70 ms for the gyroscope, three edges.
    assert 190 < after[0] - before < 290
    assert np.all(np.diff(after) == 1)


def test_a_rest_leaves_no_hole(make: Callable[..., Bench]) -> None:
    bench = make()
    bench.set_up()
    bench.stream(1.0)
    bench.library.shim_flush(bench.handle)
    before = bench.log(SAMPLES)[-1, 0]
    bench.pause(5e6)
    bench.set_up()
    bench.library.shim_restarted(bench.handle, bench.ticks(bench.t_us), 0)
    bench.stream(1.0)
    indices = bench.log(SAMPLES)[:, 0]
    assert np.all(np.diff(indices) == 1)
    assert indices[-1] > before + 200


# --- motion --------------------------------------------------------------------------------------

HEADER = "t_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps"
G = 9.80665


def ramp_file(path: Path) -> None:
    """One second at rest, then x of everything rises linearly for a second, beyond full scale."""
    rows = ["# a comment", HEADER, f"0,0,0,{G},0,0,0", f"1,0,0,{G},0,0,0"]
    rows.append(f"2,{40 * G},0,{G},{100.0},0,0")
    path.write_text("\n".join(rows) + "\n")


def test_motion_is_interpolated_quantised_and_saturated(
    make: Callable[..., Bench], tmp_path: Path
) -> None:
    path = tmp_path / "motion.csv"
    ramp_file(path)
    bench = make(pattern=False, motion_file=path)
    bench.set_up()
    bench.stream(2.5)
    slots = bench.log(SLOTS)
    slots = slots[(slots[:, 0] == slots[-1, 0]) & (slots[:, 9].astype(int) & 3 == 3)]
    share = np.clip(slots[:, 2] / 1e6 - 1.0, 0.0, 1.0)
    accel = np.clip(np.rint(share * 40 / 0.488e-3), -32768, 32767)
    gyro = np.clip(np.rint(np.degrees(share * 100.0) / 0.070), -32768, 32767)
    np.testing.assert_array_equal(slots[:, 6], accel)
    np.testing.assert_array_equal(slots[:, 3], gyro)
    np.testing.assert_array_equal(slots[:, 8], np.full(len(slots), round(1 / 0.488e-3)))
    assert accel.max() == gyro.max() == 32767
    clipped = bench.log(BATCHES)
    assert np.any(clipped[:, 3].astype(int) & CLIPPED)
    assert not np.any(clipped[clipped[:, 1] < 1.2e6 * TICKS_PER_US][:, 3].astype(int) & CLIPPED)


def test_text_and_binary_motion_files_are_the_same(
    make: Callable[..., Bench], tmp_path: Path
) -> None:
    rng = np.random.default_rng(5)
    rows = np.column_stack([np.arange(50) * 0.05, rng.normal(0, 5, (50, 6))])
    text, binary = tmp_path / "m.csv", tmp_path / "m.bin"
    text.write_text(HEADER + "\n" + "\n".join(",".join(map(repr, r)) for r in rows.tolist()) + "\n")
    binary.write_bytes(b"BVMOTION" + struct.pack("<II", 1, 50) + rows.astype("<f8").tobytes())
    logs = []
    for path in (text, binary):
        bench = make(pattern=False, motion_file=path)
        bench.set_up()
        bench.stream(2.0)
        logs.append(bench.log(SAMPLES))
    assert len(logs[0]) > 500
    np.testing.assert_array_equal(logs[0], logs[1])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "it has no rows"),
        (b"t,x\n", "line 1 must be: " + HEADER),
        (HEADER.encode() + b"\n1,2,3\n", "line 2 does not hold seven numbers"),
        (HEADER.encode() + b"\n0,0,0,0,0,0,0\n0,0,0,0,0,0,0\n", "row 2: time 0 s does not rise"),
        (HEADER.encode() + b"\n0,nan,0,0,0,0,0\n", "row 1, column 2 is not a finite number"),
        (b"BVMOTION\x02\x00\x00\x00\x01\x00\x00\x00", "version 2, only 1 is known"),
        (b"BVMOTION\x01\x00\x00\x00\x01\x00\x00\x00abc", "cut in row 1 of 1"),
        (b"BVMOTION\x01", "cut in the header"),
    ],
)
def test_wrong_motion_files_are_refused(
    make: Callable[..., Bench], tmp_path: Path, content: bytes, says: str
) -> None:
    path = tmp_path / "motion"
    path.write_bytes(content)
    assert make(motion_file=path).problem == says


def test_missing_motion_file_is_refused(make: Callable[..., Bench], tmp_path: Path) -> None:
    assert make(motion_file=tmp_path / "none").problem == "No such file or directory"
