# SPDX-License-Identifier: Apache-2.0
"""The JSON messages of a recording: what the writer puts in, and what the reader accepts."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from typing import Any

from hil.errors import RecordingError
from hil.recording import layout
from hil.recording.model import Event, Provenance


def front(
    provenance: Provenance, edge_channels: Sequence[str], edge_resolution_ns: float
) -> dict[str, Any]:
    """The /provenance message."""
    return {
        "format": layout.FORMAT,
        "version": layout.FORMAT_VERSION,
        "edges": {"channels": list(edge_channels), "resolution_ns": edge_resolution_ns},
        "provenance": provenance.to_mapping(),
    }


def read_front(data: Mapping[str, Any]) -> tuple[Provenance, tuple[str, ...], float]:
    """Provenance, names of the edge channels, resolution of the edges in ns.

    Raises:
        RecordingError: not ours, of another version, or malformed.
    """
    if data.get("format") != layout.FORMAT:
        raise RecordingError(
            "is an MCAP file, but its /provenance is not that of a recording",
            "name a recording made by `hil record`",
        )
    version = data.get("version")
    if version != layout.FORMAT_VERSION:
        raise RecordingError(
            f"has format version {str(version)[:20]!r}; this hil reads {layout.FORMAT_VERSION}",
            "open it with the version of hil that wrote it, or a later one",
        )
    edges = mapping(data, "edges")
    channels: Any = edges.get("channels")
    resolution_ns: Any = edges.get("resolution_ns")
    if not isinstance(channels, list) or not are_edge_channels(channels):
        raise RecordingError("names its edge channels in a way that no writer does")
    if not is_resolution(resolution_ns):
        raise RecordingError("gives a resolution of its edges that is none")
    provenance = Provenance.from_mapping(mapping(data, "provenance"))
    return provenance, tuple(channels), float(resolution_ns)


def event(item: Event) -> dict[str, Any]:
    """The /events message. Raises RecordingError for a time that is no int64."""
    return {
        "t_ns_bench": time_ns(item.t_ns_bench),
        "kind": str(item.kind),
        "node": str(item.node),
        "data": dict(item.data),
    }


def read_event(data: Mapping[str, Any]) -> Event:
    """Raises LayoutError when it is not what :func:`event` makes."""
    t_ns, body = data.get("t_ns_bench"), data.get("data")
    kind, node = data.get("kind"), data.get("node")
    if isinstance(t_ns, bool) or not isinstance(t_ns, int) or abs(t_ns) >= 1 << 63:
        raise layout.LayoutError("an event without a 64-bit time")
    if not isinstance(kind, str) or not isinstance(node, str) or not isinstance(body, dict):
        raise layout.LayoutError("an event without kind, node or data")
    return Event(t_ns, kind, node, body)


def are_edge_channels(names: Sequence[Any]) -> bool:
    return len(names) <= layout.MAX_EDGE_CHANNELS and all(
        isinstance(name, str) and layout.EDGE_NAME_PATTERN.fullmatch(name) for name in names
    )


def is_resolution(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value) and value >= 0


def is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def mapping(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """``data[key]`` if it is a mapping, else an empty one."""
    value = data.get(key)
    return value if isinstance(value, Mapping) else {}


def time_ns(t_ns_bench: Any) -> int:
    """Raises RecordingError when it is no whole number of 64 bits."""
    try:
        t_ns = operator.index(t_ns_bench)
    except TypeError as error:
        raise RecordingError(f"time {t_ns_bench!r} is not a whole number of ns") from error
    if abs(t_ns) >= 1 << 63:
        raise RecordingError(f"time {t_ns} ns is outside 64 bits")
    return t_ns
