# SPDX-License-Identifier: Apache-2.0
"""Embedded tables: old ones decode, wrong ones are refused with where and why."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire.codec import decode, encode, physical
from hil.wire.frames import CHUNK_LIMIT, frame
from hil.wire.messages import BY_NAME, MESSAGES, WireError, schema
from hil.wire.schema import PAYLOAD_LIMIT, parse


def plain() -> dict[str, Any]:
    """The present table as it comes out of a recording."""
    table: dict[str, Any] = json.loads(json.dumps(schema()))
    return table


def test_present_table_survives_json() -> None:
    assert parse(plain()) == parse(schema()) == MESSAGES


def test_stream_is_decoded_by_the_table_it_was_made_with() -> None:
    """The old table had a message less, an id changed, and a field of another type and scale."""
    old = {
        "protocol_version": 1,
        "tick_rate_hz": 16_000_000,
        "messages": [
            {
                "name": "hello",
                "id": 42,
                "meaning": "",
                "fields": [
                    {
                        "name": "uptime_ms",
                        "type": "u16",
                        "unit": "ms",
                        "meaning": "",
                        "scale": 10,
                        "clock": "",
                        "count": 1,
                    }
                ],
                "group": None,
            }
        ],
    }
    stream = (
        frame(42, 7, (300).to_bytes(2, "little"))
        + frame(1, 8, b"\1\2")
        + frame(42, 0, b"\1\0")
        + frame(42, 1, b"\1")
    )
    decoded = decode(stream, old)
    assert list(decoded.messages) == list(decoded.table) == ["hello"]
    hello = decoded.messages["hello"]
    assert hello["uptime_ms"].tolist() == [300, 1]
    assert physical(hello, "hello", "uptime_ms", decoded.table).tolist() == [3000.0, 10.0]
    stats = decoded.stats
    assert (stats.frames, stats.unknown_types, stats.bad_lengths) == (4, 1, 1)
    assert (stats.lost, stats.restarts) == (0, 1)


def test_present_stream_by_the_present_table_written_out() -> None:
    values = {"t_ticks_leader": 5, "quaternion": [1, 0, 0, 0], "divergence_rad": 0.5}
    stream = encode("attitude", values, 3)
    by_schema, by_default = decode(stream, plain()), decode(stream)
    assert by_schema.table == by_default.table
    assert by_schema.stats == by_default.stats
    found, wanted = by_schema.messages["attitude"], by_default.messages["attitude"]
    assert found.dtype == wanted.dtype
    assert found.tobytes() == wanted.tobytes()


def test_table_without_messages_calls_every_frame_unknown() -> None:
    decoded = decode(frame(1, 0, b""), plain() | {"messages": []})
    assert decoded.messages == {}
    assert decoded.stats.unknown_types == 1


@pytest.mark.parametrize("uptime", [{"type": "f32"}, {"count": 2}, {"type": "i64"}])
def test_hello_with_an_odd_uptime_does_not_disturb(uptime: dict[str, Any]) -> None:
    table = plain()
    table["messages"][0]["fields"][-1] |= uptime
    size = parse(table)[0].fixed_size
    stream = frame(1, 9, b"\xff" * size) + frame(1, 0, bytes(size))
    stats = decode(stream, table).stats
    assert (stats.frames, stats.restarts) == (2, 1)


def test_longest_message_is_decoded() -> None:
    table = plain()
    table["messages"] = [dict(table["messages"][0], id=9, fields=[])]
    field = dict(schema()["messages"][0]["fields"][0], count=1000)
    table["messages"][0]["fields"] = [dict(field, name=f"part_{i}") for i in range(4)]
    stream = frame(9, 0, b"\xa5" * PAYLOAD_LIMIT)
    assert len(stream) < CHUNK_LIMIT
    (record,) = decode(stream, table).messages["hello"]
    assert np.all(record["part_3"] == 0xA5)


def at(*path: str | int) -> Callable[[dict[str, Any], Any], None]:
    def put(table: dict[str, Any], value: Any) -> None:
        node: Any = table
        for step in path[:-1]:
            node = node[step]
        if value is None:
            del node[path[-1]]
        else:
            node[path[-1]] = value

    return put


FIRST = ("messages", 0)
FIELD = (*FIRST, "fields", 0)
GROUP = ("messages", 1, "group")


@pytest.mark.parametrize(
    ("put", "value", "message"),
    [
        (at("protocol_version"), 2, "schema.protocol_version: framing 2 is not known, only 1"),
        (at("protocol_version"), None, "schema: protocol_version is missing"),
        (at("protocol_version"), True, "schema.protocol_version: an integer is needed, not bool"),
        (at("messages"), {}, "schema.messages: a list is needed, not dict"),
        (at("messages"), [{}] * 257, "schema.messages: 257 entries are over 256"),
        (at("messages"), ["hello"], r"schema.messages\[0\]: a mapping is needed, not str"),
        (at(*FIRST, "name"), "imu_batch", "schema.messages: name 'imu_batch' appears twice"),
        (at(*FIRST, "name"), "Hello", r"schema.messages\[0\].name: 'Hello' is no name"),
        (at(*FIRST, "name"), "__class__", r"schema.messages\[0\].name: '__class__' is no name"),
        (at(*FIRST, "name"), "a" * 65, r"schema.messages\[0\].name: 'a+' is no name"),
        (at(*FIRST, "id"), 2, "schema.messages: id 2 appears twice"),
        (at(*FIRST, "id"), 256, r"schema.messages\[0\].id: not within 0 .. 255"),
        (at(*FIRST, "id"), -1, r"schema.messages\[0\].id: not within 0 .. 255"),
        (at(*FIRST, "id"), "1", r"schema.messages\[0\].id: an integer is needed, not str"),
        (at(*FIRST, "meaning"), "x" * 1001, r"messages\[0\].meaning: 1001 characters are over"),
        (at(*FIRST, "fields"), None, r"schema.messages\[0\]: fields is missing"),
        (at(*FIELD, "type"), "u24", r"fields\[0\].type: 'u24' is none of 'u8', 'i8'"),
        (at(*FIELD, "type"), ["u8"], r"fields\[0\].type: text is needed, not list"),
        (at(*FIELD, "name"), "role", r"messages\[0\].fields: name 'role' appears twice"),
        (at(*FIELD, "name"), "seq", r"fields\[0\].name: seq is the name of a column"),
        (at(*FIELD, "count"), 0, r"fields\[0\].count: not within 1 .. 1024"),
        (at(*FIELD, "count"), 10**30, r"fields\[0\].count: not within 1 .. 1024"),
        (at(*FIELD, "count"), 1.0, r"fields\[0\].count: an integer is needed, not float"),
        (at(*FIELD, "scale"), 0, r"fields\[0\].scale: a finite number other than 0"),
        (at(*FIELD, "scale"), float("nan"), r"fields\[0\].scale: a finite number other than 0"),
        (at(*FIELD, "scale"), 10**400, r"fields\[0\].scale: a finite number other than 0"),
        (at(*FIELD, "scale"), "1", r"fields\[0\].scale: a number is needed, not str"),
        (at(*FIELD, "clock"), "wall", r"fields\[0\].clock: 'wall' is none of '', 'leader'"),
        (at(*FIELD, "unit"), 7, r"fields\[0\].unit: text is needed, not int"),
        (at(*GROUP), [], r"messages\[1\].group: a mapping is needed, not list"),
        (at(*GROUP, "count_field"), "rows", r"group.count_field: the message has no single"),
        (at(*GROUP, "max_count"), 1025, r"group.max_count: not within 1 .. 1024"),
        (at(*GROUP, "max_count"), 400, r"messages\[1\]: a payload of \d+ B is over 4000 B"),
        (at(*GROUP, "fields"), [], r"group.fields: the rows of a group need at least one"),
        (at(*GROUP, "fields", 0, "name"), "flags", r"messages\[1\].fields: name 'flags' appears"),
    ],
)
def test_wrong_table_is_refused(
    put: Callable[[dict[str, Any], Any], None], value: Any, message: str
) -> None:
    table = plain()
    put(table, value)
    with pytest.raises(WireError, match=message):
        decode(b"", table)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=10,
)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_any_value_anywhere_is_taken_or_refused(data: st.DataObject) -> None:
    """Nothing but WireError comes out, wherever the table is wrong."""
    table = plain()
    node: Any = table
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = data.draw(st.sampled_from(keys))
        if isinstance(node[key], dict | list) and node[key] and data.draw(st.booleans()):
            node = node[key]
            continue
        node[key] = data.draw(json_values)
        break
    stream = frame(1, 0, bytes(43)) + frame(BY_NAME["imu_batch"].id, 1, bytes(24))
    try:
        stats = decode(stream, table).stats
    except WireError:
        return
    assert stats.frames == 2
