# SPDX-License-Identifier: Apache-2.0
"""MCAP that Foxglove and Rerun decode: protobuf messages, each with its schema in the file.

The tables become topics of messages with scalar fields, which a plot can draw by their names; the
attitude becomes ``foxglove.FrameTransform`` and the events ``foxglove.Log``. ``log_time`` is the
leader's clock.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from io import BytesIO
from typing import Any, Final

import numpy as np

from hil.exchange.table import Contents, Table
from hil.extras import module

TOPICS: Final = {
    "imu_leader": ("/leader/imu", "hil.ImuLeader"),
    "imu_follower": ("/follower/imu", "hil.ImuFollower"),
    "ekf": ("/ekf", "hil.Ekf"),
    "sync": ("/sync", "hil.Sync"),
    "repetitions": ("/repetitions", "hil.Repetition"),
}
"""Table -> topic, name of its message."""
PROVENANCE_TOPIC: Final = "/provenance"
EVENTS_TOPIC: Final = "/events"
TRANSFORM_TOPIC: Final = "/tf"
WORLD, BAR = "world", "leader_sensor"

_KINDS: Final = {"f": "TYPE_DOUBLE", "i": "TYPE_INT64", "u": "TYPE_UINT64", "b": "TYPE_BOOL"}


def as_mcap(contents: Contents) -> bytes:
    """The file.

    Raises:
        ExchangeError: the libraries of the extra are not installed.
    """
    writer_module = module("mcap_protobuf.writer")
    messages = _messages(contents)
    everything = [(TRANSFORM_TOPIC, *one) for one in _transforms(contents)]
    everything += [(EVENTS_TOPIC, *one) for one in _logs(contents)]
    for name, (topic, full_name) in TOPICS.items():
        table = contents.tables.get(name)
        if table is not None:
            everything += [(topic, *one) for one in _rows(table, messages[full_name])]
    # Readers that take the file as it comes get its times in order.
    everything.sort(key=lambda one: one[1])
    text = json.dumps(dict(contents.provenance), allow_nan=False)
    stream = BytesIO()
    with writer_module.Writer(stream) as writer:
        start = everything[0][1] if everything else 0
        provenance = _provenance(contents, messages["hil.Provenance"], text)
        writer.write_message(PROVENANCE_TOPIC, provenance, log_time=start, publish_time=start)
        for topic, t_ns, message in everything:
            writer.write_message(topic, message, log_time=t_ns, publish_time=t_ns)
        writer._writer.add_metadata("hil.provenance", {"json": text})
    return stream.getvalue()


def _messages(contents: Contents) -> dict[str, Any]:
    """Full name -> class, made from the columns; their meanings stand in docs/exchange.md."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory  # noqa: PLC0415

    field_type = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="hil.proto", package="hil", syntax="proto3")

    def add(name: str, fields: list[tuple[str, str]]) -> None:
        made = file.message_type.add(name=name)
        for number, (field, kind) in enumerate(fields, start=1):
            made.field.add(
                name=field,
                number=number,
                type=getattr(field_type, kind),
                label=field_type.LABEL_OPTIONAL,
            )

    texts = ("recording", "source", "source_label", "build_ids", "estimator", "json")
    add("Provenance", [(name, "TYPE_STRING") for name in texts])
    for name, (_, full_name) in TOPICS.items():
        table = contents.tables.get(name)
        if table is not None:
            kinds = [
                (c.name, "TYPE_STRING" if c.is_text else _KINDS[c.values.dtype.kind])
                for c in table.columns
            ]
            add(full_name.removeprefix("hil."), kinds)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    names = [f"hil.{message.name}" for message in file.message_type]
    return {
        name: message_factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in names
    }


def _provenance(contents: Contents, kind: Any, text: str) -> Any:
    known = contents.provenance
    return kind(
        recording=known["recording"],
        source=known["source"],
        source_label=known["source_label"],
        build_ids=json.dumps(known["build_ids"]),
        estimator=known["estimator"],
        json=text,
    )


def _rows(table: Table, kind: Any) -> Iterator[tuple[int, Any]]:
    names = [column.name for column in table.columns]
    values = zip(*(column.values.tolist() for column in table.columns), strict=True)
    for t_ns, row in zip(table.t_ns.tolist(), values, strict=True):
        yield t_ns, kind(**dict(zip(names, row, strict=True)))


def _transforms(contents: Contents) -> Iterator[tuple[int, Any]]:
    """The leader's sensor in the world, for views in three dimensions."""
    table = contents.tables.get("ekf")
    if table is None:
        return
    kind = module("foxglove_schemas_protobuf.FrameTransform_pb2").FrameTransform
    names = [f"position_{a}_m" for a in "xyz"] + [f"quaternion_{a}" for a in "wxyz"]
    rows = np.stack([table[name] for name in names], axis=1)
    for t_ns, row in zip(table.t_ns.tolist(), rows.tolist(), strict=True):
        message = kind(parent_frame_id=WORLD, child_frame_id=BAR)
        message.timestamp.FromNanoseconds(t_ns)
        place, turn = message.translation, message.rotation
        place.x, place.y, place.z = row[:3]
        turn.w, turn.x, turn.y, turn.z = row[3:]
        yield t_ns, message


def _logs(contents: Contents) -> Iterator[tuple[int, Any]]:
    table = contents.tables.get("events")
    if table is None:
        return
    kind = module("foxglove_schemas_protobuf.Log_pb2").Log
    columns = (table[name].tolist() for name in ("kind", "node", "data"))
    for t_ns, what, node, data in zip(table.t_ns.tolist(), *columns, strict=True):
        message = kind(level=kind.INFO, name=node or "run", message=f"{what} {data}")
        message.timestamp.FromNanoseconds(t_ns)
        yield t_ns, message
