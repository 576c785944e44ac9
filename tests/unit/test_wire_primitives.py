# SPDX-License-Identifier: Apache-2.0
"""CRC, stuffing and text, each on its own and held against independent implementations."""

from __future__ import annotations

import binascii

import pytest
from cobs import cobs as other_cobs
from hypothesis import given
from hypothesis import strategies as st

from hil.wire import cobs
from hil.wire.crc import crc16
from hil.wire.text import TextLine, find_text


class TestCrc:
    def test_check_value_of_the_catalogue(self) -> None:
        assert crc16(b"123456789") == 0x29B1

    @given(st.binary(max_size=300))
    def test_agrees_with_the_standard_library(self, data: bytes) -> None:
        assert crc16(data) == binascii.crc_hqx(data, 0xFFFF)


lumpy = st.lists(
    st.one_of(
        st.binary(max_size=8),
        st.just(b"\0"),
        st.integers(250, 258).map(lambda n: b"\x07" * n),
        st.integers(506, 510).map(lambda n: b"\xff" * n),
    ),
    max_size=6,
).map(b"".join)
"""Bytes with many zeros and with runs around the lengths at which groups are full."""


class TestCobs:
    @given(lumpy)
    def test_comes_back_and_holds_no_zero(self, data: bytes) -> None:
        stuffed = cobs.stuff(data)
        assert b"\0" not in stuffed
        assert cobs.unstuff(stuffed) == data

    @given(lumpy)
    def test_agrees_with_another_implementation(self, data: bytes) -> None:
        assert cobs.stuff(data) == other_cobs.encode(data)

    @given(st.binary(min_size=1, max_size=300).map(lambda data: data.replace(b"\0", b"\x01")))
    def test_refuses_what_another_implementation_refuses(self, chunk: bytes) -> None:
        try:
            wanted = other_cobs.decode(chunk)
        except other_cobs.DecodeError:
            wanted = None
        assert cobs.unstuff(chunk) == wanted


class TestText:
    @pytest.mark.parametrize(
        ("region", "lines", "taken"),
        [
            (b"", [], 0),
            (b"abc", [(5, "abc")], 3),
            (b"abc\r\n", [(5, "abc")], 5),
            (b"abc\n", [(5, "abc")], 4),
            (b"a\tb\r\nc\r\nd", [(5, "a\tb"), (10, "c"), (13, "d")], 9),
            (b"\r\n\r\na\r\n\r\n", [(9, "a")], 9),
            (b"a\x80b\r\n", [], 0),
            (b"a\x80\r\nbc\r\n\x01", [(9, "bc")], 4),
            (b"bc\r\n\x80", [(5, "bc")], 4),
            (b"bc\n\x80\r\n", [], 0),
            (b"\x80\r\n\r\n", [], 0),
            (b"\x80\r\nbc", [], 0),
            (b"\x7f", [], 0),
        ],
    )
    def test_lines(self, region: bytes, lines: list[tuple[int, str]], taken: int) -> None:
        assert find_text(region, 5) == ([TextLine(*line) for line in lines], taken)
