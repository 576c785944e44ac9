# SPDX-License-Identifier: Apache-2.0
"""Payloads <-> records, by the layout that a message of the table implies."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hil.wire.frames import Batch
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


class Collector:
    """Gathers the frames of one message and lays them out as records in the stream's order.

    Until the end a record is a row of bytes: NumPy moves those many times faster than structures.
    """

    def __init__(self, message: Message) -> None:
        self.bad_lengths = 0
        self._message = message
        self._record_type = record_type(message)
        self._row_type = row_type(message) if message.group else np.dtype([])
        self._records = [np.empty((0, self._record_type.itemsize), np.uint8)]
        self._offsets = [np.empty(0, np.int64)]
        self._rows = [np.empty((0, self._row_type.itemsize), np.uint8)]

    def add(self, batch: Batch, offset: NDArray[np.int64]) -> None:
        """Takes frames of this message; ``offset``, int64[n], is where each is in the stream.

        Frames whose size is not the message's are counted and left out.
        """
        size, group = self._message.fixed_size, self._message.group
        payload = batch.payload
        row_count, excess = divmod(payload.shape[1] - size, group.size if group else 1)
        most = group.max_count if group else 0
        if excess or not 0 <= row_count <= most:
            self.bad_lengths += len(payload)
            return
        records = _lay_out(payload[:, :size], self._record_type)
        columns = _as_records(records, self._record_type)
        columns["seq"] = batch.seq
        columns["offset"] = offset
        if group:
            sound = columns[group.count_field] == row_count
            if not sound.all():
                self.bad_lengths += len(sound) - int(np.count_nonzero(sound))
                records, offset, payload = records[sound], offset[sound], payload[sound]
            rows = payload[:, size:].reshape(len(payload) * row_count, group.size)
            self._rows.append(_lay_out(rows, self._row_type))
        self._records.append(records)
        self._offsets.append(offset)

    def finish(self) -> tuple[Records, Records | None]:
        """All records, and all rows of their groups if the message has one."""
        records = np.concatenate(self._records)
        offset = np.concatenate(self._offsets)
        order = None
        if np.any(offset[1:] < offset[:-1]):
            order = np.argsort(offset, kind="stable")
        rows = self._finish_rows(_as_records(records, self._record_type), order)
        if order is not None:
            records = records.take(order, axis=0)
        return _as_records(records, self._record_type), rows

    def _finish_rows(self, records: Records, order: NDArray[np.intp] | None) -> Records | None:
        """Rows in the order that ``order`` brings their records into."""
        group = self._message.group
        if group is None:
            return None
        rows = np.concatenate(self._rows)
        owner = np.repeat(np.arange(len(records)), records[group.count_field].astype(np.int64))
        if order is not None:
            rank = np.empty_like(order)
            rank[order] = np.arange(len(order))
            owner = rank[owner]
            by_owner = np.argsort(owner, kind="stable")
            owner, rows = owner[by_owner], rows.take(by_owner, axis=0)
        columns = _as_records(rows, self._row_type)
        columns["row"] = owner
        return columns


def _lay_out(payload: NDArray[np.uint8], dtype: np.dtype[np.void]) -> NDArray[np.uint8]:
    """Bytes of records that start with the rows of ``payload``; their other columns are not set."""
    laid_out = np.empty((len(payload), dtype.itemsize), np.uint8)
    laid_out[:, : payload.shape[1]] = payload
    return laid_out


def _as_records(rows: NDArray[np.uint8], dtype: np.dtype[np.void]) -> Records:
    records: Records = rows.view(dtype)[:, 0]
    return records
