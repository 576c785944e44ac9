# SPDX-License-Identifier: Apache-2.0
"""Payloads <-> records, by the layout that a message of the table implies."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hil.wire.messages import Field, Message, WireError

Records = NDArray[np.void]
"""A structured array."""

_NUMPY: Final[Mapping[str, str]] = {
    "u8": "u1",
    "i8": "i1",
    "u16": "<u2",
    "i16": "<i2",
    "u32": "<u4",
    "i32": "<i4",
    "f32": "<f4",
    "u64": "<u8",
    "i64": "<i8",
}

_STRUCT: Final[Mapping[str, str]] = {
    "u8": "B",
    "i8": "b",
    "u16": "H",
    "i16": "h",
    "u32": "I",
    "i32": "i",
    "f32": "f",
    "u64": "Q",
    "i64": "q",
}

_SEQUENCE: Final = (list, tuple, Sequence, np.ndarray)
_MAPPING: Final = (dict, Mapping)
"""The usual kinds first: they are found at once."""

_MISFITS: Final = (struct.error, TypeError, ValueError, OverflowError)


class Packer:
    """Payloads of one message from raw numbers."""

    def __init__(self, message: Message) -> None:
        self._message = message
        self._fixed = _Layout(message.fields)
        self._row = _Layout(message.group.fields if message.group else ())

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """One payload.

        ``values`` holds every field, an array as a sequence, and a group as a sequence of such
        mappings under the group's name. The field that counts the group may be left out.

        Raises:
            WireError: a value is missing, unknown, of the wrong kind or outside its type.
        """
        name, group = self._message.name, self._message.group
        if group is None:
            return self._fixed.pack(values, name)
        given = dict(values)
        rows = given.pop(group.name, ())
        if not isinstance(rows, _SEQUENCE) or not all(isinstance(row, _MAPPING) for row in rows):
            raise WireError(f"{name}.{group.name}: a sequence of mappings is needed")
        if len(rows) > group.max_count:
            raise WireError(f"{name}.{group.name}: {len(rows)} rows are over {group.max_count}")
        if given.setdefault(group.count_field, len(rows)) != len(rows):
            raise WireError(
                f"{name}.{group.count_field}: {given[group.count_field]} is said, "
                f"{len(rows)} rows are given"
            )
        where = f"{name}.{group.name}"
        packed = [self._row.pack(row, f"{where}[{i}]") for i, row in enumerate(rows)]
        return self._fixed.pack(given, name) + b"".join(packed)


class _Layout:
    """Fields one behind the other."""

    def __init__(self, fields: Sequence[Field]) -> None:
        self._fields = fields
        self._names = {f.name for f in fields}
        self._struct = struct.Struct("<" + "".join(f"{f.count}{_STRUCT[f.type]}" for f in fields))

    def pack(self, values: Mapping[str, Any], where: str) -> bytes:
        unknown = sorted(values.keys() - self._names)
        if unknown:
            raise WireError(f"{where}: unknown field {', '.join(unknown)}")
        elements: list[Any] = []
        for f in self._fields:
            if f.name not in values:
                raise WireError(f"{where}.{f.name}: missing")
            value = values[f.name]
            if f.count == 1:
                elements.append(value)
                continue
            if not isinstance(value, _SEQUENCE):
                raise WireError(f"{where}.{f.name}: {value!r} is no sequence of {f.count}")
            if len(value) != f.count:
                raise WireError(f"{where}.{f.name}: {len(value)} elements, not {f.count}")
            elements += value
        try:
            return self._struct.pack(*elements)
        except _MISFITS as error:
            raise self._misfit(elements, where) from error

    def _misfit(self, elements: Sequence[Any], where: str) -> WireError:
        """Which element it was that does not fit its type."""
        left = iter(elements)
        for f in self._fields:
            for element in islice(left, f.count):
                try:
                    struct.pack(f"<{_STRUCT[f.type]}", element)
                except _MISFITS as error:
                    return WireError(f"{where}.{f.name}: {element!r} is no {f.type}: {error}")
        raise AssertionError("each element fits its type, and all together do not")


def record_type(message: Message) -> np.dtype[np.void]:
    """Fields as in the table, then ``seq`` and ``offset``, without padding."""
    return np.dtype([*_columns(message.fields), ("seq", "<u2"), ("offset", "<i8")])


def row_type(message: Message) -> np.dtype[np.void]:
    """Fields of the group's rows, then ``row``: index of the record that they belong to."""
    assert message.group is not None
    return np.dtype([*_columns(message.group.fields), ("row", "<i8")])


def _columns(fields: Sequence[Field]) -> Iterator[tuple[str, DTypeLike, tuple[int, ...]]]:
    for f in fields:
        yield f.name, _NUMPY[f.type], (f.count,) if f.count > 1 else ()


def records_of(
    message: Message, records: NDArray[np.uint8], rows: NDArray[np.uint8]
) -> tuple[Records, Records | None]:
    """Bytes laid out as :func:`record_type` and :func:`row_type` say, as arrays of them."""
    return records.view(record_type(message)), rows.view(
        row_type(message)
    ) if message.group else None


def layout(message: Message) -> tuple[int, int, int, int, int, int]:
    """The message as ``native/streams.hpp`` wants it: id, size of the fixed fields and of a row,
    most rows, and where their count stands: offset and size."""
    group = message.group
    if group is None:
        return message.id, message.fixed_size, 0, 0, 0, 0
    sent = record_type(message).fields
    assert sent is not None
    kind, offset = sent[group.count_field][:2]
    return message.id, message.fixed_size, group.size, group.max_count, offset, kind.itemsize
