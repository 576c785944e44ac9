# SPDX-License-Identifier: Apache-2.0
"""The LSM6DSOX FIFO decoder against an encoder written from the datasheet's word layout.

The decoder is the firmware's own C source, compiled by the host's compiler.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.unit.native import shared_library

ROOT = Path(__file__).resolve().parents[2]
DRIVER = ROOT / "firmware" / "drivers" / "lsm6dsox"
SHIM = ROOT / "tests" / "unit" / "c" / "lsm6dsox_decoder_shim.c"
WORD_SIZE = 7
GYRO, ACCEL, TEMPERATURE, TIMESTAMP, CONFIG_CHANGE = 1, 2, 3, 4, 5

COUNTERS = (
    "words_paired",
    "words_unpaired",
    "words_out_of_sequence",
    "parity_errors",
    "unknown_tags",
    "config_changes",
    "words_other",
    "words_empty",
    "short_reads",
    "tag_gaps",
    "slots_lost",
    "pairs",
)


# --- the encoder: what the chip writes into its FIFO ---------------------------------------------


def tag_byte(sensor: int, slot: int) -> int:
    """Sensor in bits 7..3, slot modulo 4 in bits 2..1, bit 0 makes the number of ones even."""
    body = (sensor << 3) | ((slot % 4) << 1)
    return body | (body.bit_count() % 2)


def word(sensor: int, slot: int, axes: tuple[int, int, int]) -> bytes:
    return struct.pack("<B3h", tag_byte(sensor, slot), *axes)


def gyro_of(slot: int) -> tuple[int, int, int]:
    """Counts that no other slot has, so that a pair's origin can be read from its data."""
    return (slot % 32768, -(slot // 32768) - 1, -slot % 32768)


def accel_of(slot: int) -> tuple[int, int, int]:
    return (-(slot % 32768) - 1, slot // 32768, slot % 32768)


def slot_words(slot: int) -> list[bytes]:
    return [word(GYRO, slot, gyro_of(slot)), word(ACCEL, slot, accel_of(slot))]


def stream(first: int, last: int) -> list[bytes]:
    """Words of the slots ``first`` <= slot < ``last``."""
    return [w for slot in range(first, last) for w in slot_words(slot)]


# --- the decoder ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Burst:
    rows: list[tuple[int, ...]]
    words: int
    mark_slot: int | None

    @property
    def slots(self) -> list[int]:
        return [row[0] for row in self.rows]


class Decoder:
    def __init__(self, library: ctypes.CDLL, first_slot: int = 0) -> None:
        self._library = library
        self._handle = ctypes.c_void_p(library.shim_new(ctypes.c_uint32(first_slot)))

    def close(self) -> None:
        self._library.shim_free(self._handle)

    def push(self, words: bytes, mark: int = 0) -> Burst:
        rows = (ctypes.c_int64 * (7 * (len(words) // (2 * WORD_SIZE) + 2)))()
        burst = (ctypes.c_int64 * 4)()
        data = (ctypes.c_uint8 * max(len(words), 1)).from_buffer_copy(words or b"\0")
        assert (
            self._library.shim_push(
                self._handle,
                data,
                ctypes.c_size_t(len(words)),
                ctypes.c_size_t(mark),
                burst,
                rows,
            )
            == 0
        )
        table = [tuple(rows[7 * i : 7 * i + 7]) for i in range(burst[0])]
        return Burst(table, burst[1], burst[3] if burst[2] else None)

    def break_(self) -> None:
        self._library.lsm6dsox_decoder_break(self._handle)

    def restart(self, next_slot: int) -> None:
        self._library.lsm6dsox_decoder_restart(self._handle, ctypes.c_uint32(next_slot))

    def skip(self, slots: int) -> None:
        self._library.lsm6dsox_decoder_skip(self._handle, ctypes.c_uint32(slots))

    @property
    def counters(self) -> dict[str, int]:
        values = (ctypes.c_int64 * len(COUNTERS))()
        self._library.shim_counters(self._handle, values)
        return dict(zip(COUNTERS, values, strict=True))


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    output = tmp_path_factory.mktemp("lsm6dsox") / "decoder.so"
    loaded = shared_library(output, [DRIVER / "lsm6dsox_decoder.c", SHIM], [DRIVER])
    loaded.shim_new.restype = ctypes.c_void_p
    return loaded


@pytest.fixture
def decoder(library: ctypes.CDLL) -> Iterator[Decoder]:
    one = Decoder(library)
    yield one
    one.close()


def expected_row(slot: int) -> tuple[int, ...]:
    return (slot, *gyro_of(slot), *accel_of(slot))


def zeros(**changed: int) -> dict[str, int]:
    return dict.fromkeys(COUNTERS, 0) | changed


def flip(words: list[bytes], index: int, mask: int) -> None:
    words[index] = bytes([words[index][0] ^ mask]) + words[index][1:]


# --- words worked out by hand --------------------------------------------------------------------


def test_tag_bytes_worked_out_by_hand() -> None:
    # 00001 00 . has one 1 -> parity 1; 00001 01 . two -> 0; 00010 11 . three -> 1
    assert tag_byte(GYRO, 0) == 0b00001_00_1
    assert tag_byte(GYRO, 1) == 0b00001_01_0
    assert tag_byte(ACCEL, 3) == 0b00010_11_1
    assert tag_byte(CONFIG_CHANGE, 0) == 0b00101_00_0


def test_bytes_worked_out_by_hand_become_a_pair(decoder: Decoder) -> None:
    words = bytes.fromhex(
        "09 0100 ff7f 0080"  # gyro, slot counter 0: 1, 32767, -32768
        "11 feff 0002 3412"  # accelerometer, slot counter 0: -2, 512, 0x1234
    )
    assert decoder.push(words).rows == [(0, 1, 32767, -32768, -2, 512, 0x1234)]
    assert decoder.counters == zeros(words_paired=2, pairs=1)


# --- the ordinary case ---------------------------------------------------------------------------


def test_unbroken_stream_gives_every_pair_once(decoder: Decoder) -> None:
    got = decoder.push(b"".join(stream(0, 70000))).rows
    assert got == [expected_row(slot) for slot in range(70000)]
    assert decoder.counters == zeros(words_paired=140000, pairs=70000)


@given(cuts=st.lists(st.integers(1, 9), min_size=1, max_size=60))
def test_burst_boundaries_do_not_matter(library: ctypes.CDLL, cuts: list[int]) -> None:
    words = stream(0, sum(cuts) // 2 + 1)
    decoder = Decoder(library)
    slots: list[int] = []
    at = 0
    for cut in cuts:
        slots += decoder.push(b"".join(words[at : at + cut])).slots
        at += cut
    counters = decoder.counters
    decoder.close()
    assert slots == list(range(sum(cuts) // 2))
    assert counters["tag_gaps"] == counters["slots_lost"] == counters["short_reads"] == 0


PIECES = st.tuples(
    st.integers(0, 8),  # slots that come whole
    st.sampled_from(["lose", "flip", "spoil", "double", "other", "break", "restart"]),
    st.integers(0, 7),  # which word of the next four slots it befalls; which bit of its tag
)


# Both words of a slot damaged, whole slots, seven words lost: the damage is forgotten by then.
@example([(2, "flip", 4), (4, "lose", 6)], 0)
@given(st.lists(PIECES, min_size=1, max_size=12), st.integers(0, 3))
def test_whole_slots_take_the_short_way_and_come_to_the_same(
    library: ctypes.CDLL, pieces: list[tuple[int, str, int]], first: int
) -> None:
    """A push of one word holds no whole slot, so that each word goes the long way there."""
    short, long = Decoder(library), Decoder(library)
    slot, given = first, ([], [])
    for count, befalls, which in pieces:
        if befalls == "break":
            short.break_(), long.break_()
        elif befalls == "restart":
            short.restart(slot + 3 + which), long.restart(slot + 3 + which)
        words = stream(slot, slot + count + 8)
        at = 2 * count + which
        if befalls == "lose":
            del words[at : at + 1 + which]
        elif befalls == "flip":
            for hit in range(at, at + 1 + which % 3):
                words[hit] = bytes([words[hit][0] ^ 1 << which]) + words[hit][1:]
        elif befalls == "spoil":
            # One by parity, the next by a number that is not its own, which parity cannot see.
            words[at] = bytes([words[at][0] ^ 1]) + words[at][1:]
            words[at + 1] = word(words[at + 1][0] >> 3, slot + which, (0, 0, 0))
        elif befalls == "double":
            words.insert(at, words[at])
        elif befalls == "other":
            words.insert(at, word(TIMESTAMP, 0, (1, 2, 3)))
        slot += count + 8
        given[0].extend(short.push(b"".join(words)).rows)
        for one in words:
            given[1].extend(long.push(one).rows)
    assert given[0] == given[1]
    ours, theirs = short.counters, long.counters
    short.close(), long.close()
    # An empty tag, as two flips may make, is a short read of each push.
    del ours["short_reads"], theirs["short_reads"]
    assert ours == theirs


def test_accelerometer_first_pairs_as_well(decoder: Decoder) -> None:
    words = [w for slot in range(9) for w in reversed(slot_words(slot))]
    assert decoder.push(b"".join(words)).rows == [expected_row(slot) for slot in range(9)]


@pytest.mark.parametrize(
    ("mark", "slot"), [(1, 0), (2, 0), (3, 1), (6, 2), (20, 9), (0, None), (21, None)]
)
def test_mark_names_the_slot_of_that_word(decoder: Decoder, mark: int, slot: int | None) -> None:
    assert decoder.push(b"".join(stream(0, 10)), mark).mark_slot == slot


def test_a_mark_before_a_gap_is_not_guessed(decoder: Decoder) -> None:
    words = stream(0, 12)
    del words[9:14]
    assert decoder.push(b"".join(words), mark=4).mark_slot is None
    assert decoder.push(b"".join(stream(12, 14)), mark=4).mark_slot == 13


@pytest.mark.parametrize(("mark", "slot"), [(10, 7), (11, 7), (15, 9)])
def test_a_mark_behind_a_gap_is_found(decoder: Decoder, mark: int, slot: int) -> None:
    words = stream(0, 12)
    del words[9:14]
    assert decoder.push(b"".join(words), mark).mark_slot == slot


# --- words that are not sensor words -------------------------------------------------------------


def test_other_words_are_counted_and_change_nothing(decoder: Decoder) -> None:
    words = stream(0, 4)
    # Related parts leave the slot counter of these words at 0, whatever the slot.
    words.insert(1, word(TIMESTAMP, 0, (1, 2, 3)))
    words.insert(5, word(CONFIG_CHANGE, 0, (0, 0, 0)))
    words.insert(6, word(TEMPERATURE, 0, (25, 0, 0)))
    assert decoder.push(b"".join(words)).rows == [expected_row(slot) for slot in range(4)]
    assert decoder.counters == zeros(words_paired=8, pairs=4, config_changes=1, words_other=2)


def test_unknown_sensor_code_is_counted_under_its_own_name(decoder: Decoder) -> None:
    words = stream(0, 3)
    words.insert(2, word(0x1F, 1, (0, 0, 0)))
    burst = decoder.push(b"".join(words))
    assert burst.slots == [0, 1, 2]
    assert decoder.counters == zeros(words_paired=6, pairs=3, unknown_tags=1)


def test_empty_words_are_a_short_read(decoder: Decoder) -> None:
    burst = decoder.push(b"".join(stream(0, 2)) + bytes(3 * WORD_SIZE))
    assert (burst.slots, burst.words) == ([0, 1], 4)
    assert decoder.push(b"".join(stream(2, 4))).slots == [2, 3]
    assert decoder.counters == zeros(words_paired=8, pairs=4, words_empty=3, short_reads=1)


def test_part_of_a_word_is_a_short_read(decoder: Decoder) -> None:
    assert decoder.push(b"".join(stream(0, 2))[:-1]).slots == [0]
    assert decoder.counters["short_reads"] == 1


@pytest.mark.parametrize("level", [0x00, 0xFF])
def test_stuck_bus_gives_no_pair(decoder: Decoder, level: int) -> None:
    decoder.push(b"".join(stream(0, 2)))
    burst = decoder.push(bytes([level]) * (WORD_SIZE * 64))
    assert burst.rows == []
    stuck = "words_empty" if level == 0 else "unknown_tags"
    assert decoder.counters[stuck] == 64


# --- loss of one half, of slots, of everything ---------------------------------------------------


@pytest.mark.parametrize("lost", range(2, 14))
def test_one_lost_word_costs_its_slot_only(decoder: Decoder, lost: int) -> None:
    words = stream(0, 8)
    del words[lost]
    got = decoder.push(b"".join(words)).rows
    assert got == [expected_row(slot) for slot in range(8) if slot != lost // 2]
    assert decoder.counters == zeros(
        words_paired=14, pairs=7, words_unpaired=1, slots_lost=1, tag_gaps=1
    )


@pytest.mark.parametrize("damaged", range(2, 14))
@pytest.mark.parametrize("bit", range(8))
def test_one_bit_error_in_a_tag_costs_its_slot_only(
    decoder: Decoder, damaged: int, bit: int
) -> None:
    words = stream(0, 8)
    flip(words, damaged, 1 << bit)
    got = decoder.push(b"".join(words)).rows
    assert got == [expected_row(slot) for slot in range(8) if slot != damaged // 2]
    assert decoder.counters == zeros(
        words_paired=14, pairs=7, words_unpaired=1, slots_lost=1, parity_errors=1
    )


@pytest.mark.parametrize("run", range(1, 41))
@pytest.mark.parametrize("start", [4, 5])
def test_a_run_of_damaged_words_is_bridged_however_long(
    decoder: Decoder, start: int, run: int
) -> None:
    """Eight damaged words leave the slot counter where it was; their places tell."""
    words = stream(0, 30)
    for index in range(start, start + run):
        flip(words, index, 0x01)
    got = decoder.push(b"".join(words)).rows
    hit = {index // 2 for index in range(start, start + run)}
    assert got == [expected_row(slot) for slot in range(30) if slot not in hit]
    assert decoder.counters["parity_errors"] == run
    assert decoder.counters["slots_lost"] == len(hit)
    assert decoder.counters["tag_gaps"] == 0


def test_a_half_is_never_joined_over_a_break(decoder: Decoder) -> None:
    """Gyro of slot 3, then an overrun that takes exactly the words up to accel of slot 7."""
    words = stream(0, 12)
    assert decoder.push(b"".join(words[:7])).slots == [0, 1, 2]
    decoder.break_()
    rows = decoder.push(b"".join(words[15:])).rows
    # Slot 7 counts as slot 3 does, so the numbers come out four short until corrected.
    assert [row[1:] for row in rows] == [expected_row(slot)[1:] for slot in range(8, 12)]
    assert [row[0] for row in rows] == [4, 5, 6, 7]
    decoder.skip(4)
    assert decoder.push(b"".join(stream(12, 14))).rows == [expected_row(12), expected_row(13)]
    # Slots 3 to 7 gave no pair.
    assert decoder.counters["slots_lost"] == 5
    assert decoder.counters["tag_gaps"] == 0


@given(
    before=st.integers(0, 12),
    lost=st.integers(0, 40),
    after=st.integers(1, 12),
)
def test_break_and_skip_give_the_true_numbers(
    library: ctypes.CDLL, before: int, lost: int, after: int
) -> None:
    words = stream(0, (before + lost + after) // 2 + 2)
    kept = words[before + lost :]
    decoder = Decoder(library)
    first = decoder.push(b"".join(words[:before])).rows
    decoder.break_()
    second = decoder.push(b"".join(kept)).rows
    decoder.close()
    assert first == [expected_row(slot) for slot in range(before // 2)]
    # Whatever the numbers, every pair is one of the chip's, each once and in order.
    whole = (before + lost + 1) // 2
    assert [row[1:] for row in second] == [
        expected_row(slot)[1:] for slot in range(whole, len(words) // 2)
    ]
    if before >= 2 and second:  # two neighbours fix where the numbering stands
        short = whole - second[0][0]
        assert short >= 0
        assert short % 4 == 0, "the counter fixes the number modulo four"


@pytest.mark.parametrize("first", range(8))
def test_the_slot_counter_may_start_anywhere(decoder: Decoder, first: int) -> None:
    rows = decoder.push(b"".join(stream(first, first + 9))).rows
    assert [row[0] for row in rows] == list(range(9))
    assert [row[1:] for row in rows] == [expected_row(first + s)[1:] for s in range(9)]


def test_restart_goes_on_at_the_number_given(decoder: Decoder) -> None:
    decoder.push(b"".join(stream(0, 5)))
    decoder.restart(100)
    # After the FIFO was emptied the counter starts anywhere.
    rows = decoder.push(b"".join(stream(2, 4))).rows
    assert [row[0] for row in rows] == [100, 101]
    assert decoder.counters["slots_lost"] == 95
    assert decoder.counters["tag_gaps"] == 0


def test_restart_below_what_was_given_out_does_not_repeat_a_number(decoder: Decoder) -> None:
    decoder.push(b"".join(stream(0, 5)))
    decoder.restart(2)
    assert decoder.push(b"".join(stream(0, 2))).slots == [5, 6]


@given(
    words=st.integers(8, 80),
    hits=st.dictionaries(st.integers(2, 79), st.integers(0, 7), max_size=20),
)
def test_random_single_bit_errors_never_make_or_repeat_a_pair(
    library: ctypes.CDLL, words: int, hits: dict[int, int]
) -> None:
    sent = stream(0, words // 2)
    hits = {index: bit for index, bit in hits.items() if index < len(sent)}
    for index, bit in hits.items():
        flip(sent, index, 1 << bit)
    decoder = Decoder(library)
    got = decoder.push(b"".join(sent)).rows
    counters = decoder.counters
    decoder.close()
    spoiled = {index // 2 for index in hits}
    assert got == [expected_row(s) for s in range(len(sent) // 2) if s not in spoiled]
    assert counters["parity_errors"] == len(hits)
    assert counters["tag_gaps"] == counters["words_out_of_sequence"] == 0
    # A last half without its partner still waits.
    accounted = counters["words_paired"] + counters["words_unpaired"] + len(hits)
    assert accounted in (len(sent), len(sent) - 1)


@given(
    slots=st.integers(4, 60),
    hits=st.dictionaries(st.integers(2, 119), st.integers(1, 255), max_size=30),
)
def test_any_damage_to_lone_tags_costs_their_slots_only(
    library: ctypes.CDLL, slots: int, hits: dict[int, int]
) -> None:
    """Also damage that parity cannot see, that turns one sensor, counter or kind into another."""
    sent = stream(0, slots)
    hits = {i: mask for i, mask in hits.items() if i < len(sent)}
    hits = {i: mask for i, mask in hits.items() if not {i - 1, i - 2} & hits.keys()}
    for index, mask in hits.items():
        flip(sent, index, mask)
    decoder = Decoder(library)
    got = decoder.push(b"".join(sent)).rows
    decoder.close()
    spoiled = {index // 2 for index in hits}
    whole = [expected_row(s) for s in range(slots) if s not in spoiled]
    # A last word that waits for its neighbour may keep the last pair back.
    assert got in (whole, whole[:-1] if slots - 1 not in spoiled else whole)


def runs_of(lost: list[tuple[int, int]]) -> set[int]:
    """Indices lost, from (intact words before, length of the run) of each run."""
    indices: set[int] = set()
    at = 2
    for intact, length in lost:
        at += intact
        indices |= set(range(at, at + length))
        at += length
    return indices


@given(lost=st.lists(st.tuples(st.integers(2, 9), st.integers(1, 7)), min_size=1, max_size=12))
def test_unannounced_loss_is_found_and_numbered(
    library: ctypes.CDLL, lost: list[tuple[int, int]]
) -> None:
    """Up to seven words in a row; eight leave every tag where it would have been."""
    indices = runs_of(lost)
    slots = max(indices) // 2 + 4
    sent = stream(0, slots)
    decoder = Decoder(library)
    got = decoder.push(b"".join(w for i, w in enumerate(sent) if i not in indices)).rows
    counters = decoder.counters
    decoder.close()
    whole = [s for s in range(slots) if not {2 * s, 2 * s + 1} & indices]
    assert got == [expected_row(s) for s in whole]
    assert counters["slots_lost"] == slots - len(whole)
    assert counters["tag_gaps"] == len(lost)


def test_loss_with_damage_right_behind_it(decoder: Decoder) -> None:
    """The word that waits to be confirmed has a damaged neighbour; the next but one confirms."""
    words = stream(0, 12)
    flip(words, 13, 0x01)
    del words[7:12]
    got = decoder.push(b"".join(words)).rows
    assert got == [expected_row(slot) for slot in (0, 1, 2, 7, 8, 9, 10, 11)]


@given(
    slots=st.integers(4, 60),
    lost=st.sets(st.integers(2, 119), max_size=60),
)
def test_random_loss_never_joins_two_slots(
    library: ctypes.CDLL, slots: int, lost: set[int]
) -> None:
    sent = stream(0, slots)
    run = 0
    for index in range(len(sent)):
        run = run + 1 if index in lost else 0
        assume(run < 8)
    decoder = Decoder(library)
    got = decoder.push(b"".join(w for i, w in enumerate(sent) if i not in lost)).rows
    decoder.close()
    data = [row[1:] for row in got]
    true = [expected_row(s)[1:] for s in range(slots)]
    origins = [true.index(one) for one in data]  # ValueError: a pair that the chip never made
    assert all(a < b for a, b in itertools.pairwise(origins))


@given(
    slots=st.integers(2, 60),
    noise=st.lists(st.tuples(st.integers(0, 119), st.binary(min_size=7, max_size=7)), max_size=40),
    short=st.integers(0, 6),
)
def test_noise_is_accounted_for_word_by_word(
    library: ctypes.CDLL, slots: int, noise: list[tuple[int, bytes]], short: int
) -> None:
    sent = stream(0, slots)
    for index, replacement in noise:
        if index < len(sent):
            sent[index] = replacement
    decoder = Decoder(library)
    burst = decoder.push(b"".join(sent) + bytes(short))
    counters = decoder.counters
    decoder.close()
    accounted = sum(counters[name] for name in COUNTERS[:8])
    assert len(sent) - 2 <= accounted <= len(sent), "each word counts once; two may wait"
    assert burst.words == len(sent) - counters["words_empty"]
    assert all(a < b for a, b in itertools.pairwise(burst.slots))
    assert len(burst.rows) == counters["pairs"]


# --- real counts ---------------------------------------------------------------------------------

LOGS = ("tennis_serve", "tennis_forehand", "tennis_backhand")
ACCEL_MG_PER_LSB_16G = 0.488
GYRO_DPS_PER_LSB_2000 = 0.070


def real_log(name: str) -> NDArray[np.float64]:
    """Columns: time us, accel xyz LSB, accel xyz mg, gyro xyz LSB, gyro xyz dps, temperature."""
    folder = Path(os.environ.get("HIL_DATA", ROOT.parent / "shared" / "data")) / "lsm6dsox"
    path = folder / f"{name}.txt"
    if not path.is_file():
        pytest.skip(f"no real log at {path}; set HIL_DATA to the folder that holds lsm6dsox/")
    return np.genfromtxt(path, skip_header=1, dtype=np.float64)


@pytest.mark.parametrize("name", LOGS)
def test_real_counts_decode_to_the_values_beside_them(decoder: Decoder, name: str) -> None:
    log = real_log(name)
    accel, gyro = log[:, 1:4].astype(int), log[:, 7:10].astype(int)
    words = b"".join(
        word(GYRO, slot, tuple(gyro[slot])) + word(ACCEL, slot, tuple(accel[slot]))
        for slot in range(len(log))
    )
    rows = np.array(decoder.push(words).rows)
    assert rows[:, 0].tolist() == list(range(len(log)))
    np.testing.assert_allclose(rows[:, 4:7] * ACCEL_MG_PER_LSB_16G, log[:, 4:7], atol=6e-4)
    np.testing.assert_allclose(rows[:, 1:4] * GYRO_DPS_PER_LSB_2000, log[:, 10:13], atol=6e-4)
