# SPDX-License-Identifier: Apache-2.0
"""Plain data -> a protocol table, with every limit checked.

A recording carries the table it was made with. It is input like any other: what comes out of
:func:`parse` is bounded in every dimension and safe to build types and arrays from.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from hil.wire.messages import PROTOCOL_VERSION, TYPE_SIZES, Field, Group, Message, WireError

MAX_MESSAGES: Final = 256
MAX_FIELDS: Final = 128
MAX_ELEMENTS: Final = 1024
MAX_ROWS: Final = 1024
MAX_TEXT: Final = 1000
PAYLOAD_LIMIT: Final = 4000
"""Largest payload of a message; its frame stays below :data:`hil.wire.frames.CHUNK_LIMIT`."""

RESERVED: Final = frozenset({"seq", "offset", "row"})
"""Columns that decoding adds to those of the table."""

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,63}")
_CLOCKS: Final = ("", "leader", "follower", "node")
_COUNT_TYPES: Final = ("u8", "u16", "u32")


def parse(schema: Any) -> tuple[Message, ...]:
    """The table that :func:`hil.wire.messages.schema` made plain data of, JSON or not.

    Raises:
        WireError: it is none; the message says where and why.
    """
    version = _integer(_get(schema, "protocol_version", "schema"), "schema.protocol_version")
    if version != PROTOCOL_VERSION:
        raise WireError(
            f"schema.protocol_version: framing {version} is not known, only {PROTOCOL_VERSION}: "
            "decode it with the version of hil that made it"
        )
    rows = _list(_get(schema, "messages", "schema"), "schema.messages", MAX_MESSAGES)
    messages = tuple(_message(row, f"schema.messages[{i}]") for i, row in enumerate(rows))
    _require_unique((m.name for m in messages), "schema.messages", "name")
    _require_unique((m.id for m in messages), "schema.messages", "id")
    return messages


def _message(row: Any, where: str) -> Message:
    fields = _fields(row, where)
    group_row = _get(row, "group", where)
    group = None if group_row is None else _group(group_row, f"{where}.group", fields)
    message = Message(
        name=_name(row, "name", where),
        id=_integer(_get(row, "id", where), f"{where}.id", 0, 255),
        meaning=_text(row, "meaning", where),
        fields=fields,
        group=group,
    )
    # One name, one field: a scale can then be looked up by message and field.
    rows = group.fields if group else ()
    _require_unique((f.name for f in (*fields, *rows)), f"{where}.fields", "name")
    if message.max_size > PAYLOAD_LIMIT:
        raise WireError(f"{where}: a payload of {message.max_size} B is over {PAYLOAD_LIMIT} B")
    return message


def _group(row: Any, where: str, owner: Sequence[Field]) -> Group:
    fields = _fields(row, where)
    if not fields:
        raise WireError(f"{where}.fields: the rows of a group need at least one field")
    count_field = _name(row, "count_field", where)
    if count_field not in {f.name for f in owner if f.type in _COUNT_TYPES and f.count == 1}:
        raise WireError(
            f"{where}.count_field: the message has no single unsigned field {count_field}"
        )
    return Group(
        name=_name(row, "name", where),
        count_field=count_field,
        max_count=_integer(_get(row, "max_count", where), f"{where}.max_count", 1, MAX_ROWS),
        fields=fields,
    )


def _fields(row: Any, where: str) -> tuple[Field, ...]:
    rows = _list(_get(row, "fields", where), f"{where}.fields", MAX_FIELDS)
    return tuple(_field(f, f"{where}.fields[{i}]") for i, f in enumerate(rows))


def _field(row: Any, where: str) -> Field:
    name = _name(row, "name", where)
    if name in RESERVED:
        raise WireError(f"{where}.name: {name} is the name of a column that decoding adds")
    return Field(
        name=name,
        type=_choice(row, "type", where, tuple(TYPE_SIZES)),
        unit=_text(row, "unit", where),
        meaning=_text(row, "meaning", where),
        scale=_scale(row, where),
        clock=_choice(row, "clock", where, _CLOCKS),
        count=_integer(_get(row, "count", where), f"{where}.count", 1, MAX_ELEMENTS),
    )


def _get(row: Any, key: str, where: str) -> Any:
    if not isinstance(row, Mapping):
        raise WireError(f"{where}: a mapping is needed, not {type(row).__name__}")
    if key not in row:
        raise WireError(f"{where}: {key} is missing")
    return row[key]


def _list(value: Any, where: str, most: int) -> Sequence[Any]:
    if not isinstance(value, list | tuple):
        raise WireError(f"{where}: a list is needed, not {type(value).__name__}")
    if len(value) > most:
        raise WireError(f"{where}: {len(value)} entries are over {most}")
    return value


def _integer(value: Any, where: str, low: int = 0, high: int = 2**32) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise WireError(f"{where}: an integer is needed, not {type(value).__name__}")
    if not low <= value <= high:
        # The number itself may have any length.
        raise WireError(f"{where}: not within {low} .. {high}")
    return value


def _scale(row: Any, where: str) -> float:
    value = _get(row, "scale", where)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise WireError(f"{where}.scale: a number is needed, not {type(value).__name__}")
    try:
        scale = float(value)
    except OverflowError:
        scale = math.inf
    if not math.isfinite(scale) or scale == 0.0:
        raise WireError(f"{where}.scale: a finite number other than 0 is needed")
    return scale


def _text(row: Any, key: str, where: str) -> str:
    value = _get(row, key, where)
    if not isinstance(value, str):
        raise WireError(f"{where}.{key}: text is needed, not {type(value).__name__}")
    if len(value) > MAX_TEXT:
        raise WireError(f"{where}.{key}: {len(value)} characters are over {MAX_TEXT}")
    return value


def _name(row: Any, key: str, where: str) -> str:
    value = _text(row, key, where)
    if not _NAME.fullmatch(value):
        raise WireError(f"{where}.{key}: {value[:80]!r} is no name: lower case, digits, _")
    return value


def _choice(row: Any, key: str, where: str, choices: Sequence[str]) -> str:
    value = _text(row, key, where)
    if value not in choices:
        known = ", ".join(repr(c) for c in choices)
        raise WireError(f"{where}.{key}: {value[:80]!r} is none of {known}")
    return value


def _require_unique(values: Iterable[str | int], where: str, what: str) -> None:
    seen: set[str | int] = set()
    for value in values:
        if value in seen:
            raise WireError(f"{where}: {what} {value!r} appears twice")
        seen.add(value)
