# SPDX-License-Identifier: Apache-2.0
"""The two files that a user writes: the bench file and the scenario. The first byte chooses."""

from __future__ import annotations

import random
from typing import Final

from hil import scenario
from hil.bench import inventory
from hil.recording import layout
from tests.fuzz.common import hostile_file, read_or_refuse

VALUES: Final = (
    *(b"nan", b"-inf", b"0", b"-1", b"1e300", b"99999999999999999999", b"1979-05-27"),
    *(b"true", b'""', b'"\\n"', b"[]", b"[1]", b"[[1]]", b'["x"]', b"{}", b"[{}]", b"{ x = 1 }"),
)


def mutate(data: bytes, max_size: int, seed: int) -> bytes:
    """Another value for a key, or a line less or twice: TOML that blind changes rarely leave."""
    rng = random.Random(seed)
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    key, equals, _ = lines[at].partition(b"=")
    match rng.randrange(4):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, rng.choice(lines[1:] or lines))
        case _ if equals:
            lines[at] = key + b"= " + rng.choice(VALUES)
    return b"\n".join(lines)[:max_size]


def run(data: bytes) -> None:
    if data:
        (_scenario if data[0] & 1 else _bench)(data[1:])


def _bench(data: bytes) -> None:
    path = hostile_file("bench.toml", data)
    found = read_or_refuse(path, inventory.load)
    if found is None:
        return
    assert set(found.boards) == {"leader", "follower"}
    assert found.boards["leader"].probe != found.boards["follower"].probe
    assert len({wire.end for wire in found.wires}) == len(found.wires)
    if found.analyser:
        signals = list(found.analyser.channels.values())
        assert len(set(signals)) == len(signals)


def _scenario(data: bytes) -> None:
    path = hostile_file("scenario.toml", data)
    found = read_or_refuse(path, scenario.load)
    if found is None:
        return
    # As a recording keeps it, and as it is taken out of there.
    kept = layout.parse_json(layout.dump_json(scenario.to_mapping(found)))
    assert scenario.from_mapping(kept, "recording") == found
