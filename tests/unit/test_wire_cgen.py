# SPDX-License-Identifier: Apache-2.0
"""The generator of ``wire.h``. That the header is right, the golden vectors show."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from hil.wire.cgen import HEADER, header, main
from hil.wire.messages import BY_NAME, MESSAGES, Field, Group, WireError, schema_hash


def test_committed_header_is_that_of_the_table() -> None:
    assert main(["--check"]) == 0
    assert HEADER.read_text(encoding="utf-8") == header()


def test_output_depends_on_the_table_alone(tmp_path: Path) -> None:
    first, second = tmp_path / "first.h", tmp_path / "deeper" / "second.h"
    assert main(["--output", str(first)]) == main(["--output", str(second)]) == 0
    assert first.read_bytes() == second.read_bytes() == HEADER.read_bytes()


def test_stale_header_is_shown_and_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stale = tmp_path / "wire.h"
    text = header().replace("WIRE_HELLO_ID 1u", "WIRE_HELLO_ID 99u")
    stale.write_text(text)
    assert main(["--check", "--output", str(stale)]) == 1
    shown = capsys.readouterr()
    assert "-#define WIRE_HELLO_ID 99u\n+#define WIRE_HELLO_ID 1u\n" in shown.out
    assert "run `python -m hil.wire.cgen`" in shown.err
    assert stale.read_text() == text


def test_missing_header_is_stale(tmp_path: Path) -> None:
    assert main(["--check", "--output", str(tmp_path / "wire.h")]) == 1


def test_writing_mends_a_stale_header(tmp_path: Path) -> None:
    stale = tmp_path / "wire.h"
    stale.write_text("/* old */\n")
    assert main(["--output", str(stale)]) == 0
    assert main(["--check", "--output", str(stale)]) == 0


def test_says_the_hash_of_the_table() -> None:
    assert f"UINT64_C(0x{schema_hash():016X})" in header()
    renamed = (*MESSAGES[:-1], replace(MESSAGES[-1], name="failure"))
    assert f"UINT64_C(0x{schema_hash(renamed):016X})" in header(renamed)


def test_scale_constants_are_exact() -> None:
    scales = dict(re.findall(r"#define (\w+_SCALE) (\S+)", header()))
    assert float(scales["WIRE_SYNC_STATE_OFFSET_TICKS_SCALE"]) == 1 / 256
    assert float(scales["WIRE_SYNC_STATE_SKEW_SCALE"]) == 1e-12
    fields = [
        (m.name, f)
        for m in MESSAGES
        for f in (*m.fields, *(m.group.fields if m.group else ()))
        if f.scale != 1.0
    ]
    assert len(scales) == len(fields)


def test_lines_fit() -> None:
    assert max(len(line.expandtabs(8)) for line in header().splitlines()) <= 100


def test_two_parts_that_claim_one_name_are_refused() -> None:
    """The size of message `fault_detail` and the size of the rows `detail` of `fault`."""
    field = Field("a", "u8", "1", "")
    fault = replace(
        BY_NAME["fault"],
        fields=(Field("rows", "u8", "1", ""),),
        group=Group("detail", "rows", 4, (field,)),
    )
    with pytest.raises(WireError, match="WIRE_FAULT_DETAIL_SIZE twice: rename"):
        header((fault, replace(BY_NAME["fault"], name="fault_detail", id=99)))
