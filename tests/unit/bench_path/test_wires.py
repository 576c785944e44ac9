# SPDX-License-Identifier: Apache-2.0
"""Two wires between the boards in place of an analyser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil import checks, synthesis
from hil.measure import Measurement, Verdict
from hil.recording import Recording, SerialStream
from hil.wire.codec import decode, encode
from hil.wire.messages import BY_NAME


@pytest.fixture(scope="module")
def sound() -> Recording:
    found = synthesis.synthesise()
    return replace(found, provenance=replace(found.provenance, source="bench"))


def wired(recording: Recording, late_ticks: dict[str, int]) -> Recording:
    """Each node captures the other's pulse so many ticks after its own."""
    serial = {}
    for role, stream in recording.serial.items():
        data, pieces, at = stream.data.tobytes(), [], 0
        for sent in decode(data).messages["pulse"]:
            values = {f.name: sent[f.name].item() for f in BY_NAME["pulse"].fields}
            values["captured_ticks_node"] = values["compare_ticks_node"] + late_ticks[role]
            values["flags"] |= 2
            start = int(sent["offset"]) - 1
            end = data.index(0, start + 1) + 1
            pieces += [data[at:start], encode("pulse", values, int(sent["seq"]))]
            at = end
        joined = np.frombuffer(b"".join([*pieces, data[at:]]), np.uint8)
        # When each byte came does not matter here: the stream is one piece as long as the run.
        offset = np.minimum(stream.block_offset, joined.size - 1)
        serial[role] = SerialStream(joined, offset, stream.block_t_ns_bench)
    return replace(recording, serial=serial)


def judged(recording: Recording) -> dict[str, Measurement]:
    return {m.name: m for m in checks.suite(recording, "sync")}


def test_boards_that_are_not_wired_are_not_asked(sound: Recording) -> None:
    assert "sync.wire_error_max_ns" not in judged(sound)


def test_wires_that_carry_nothing_leave_it_unset_and_say_so(sound: Recording) -> None:
    host = {"wires": ["leader.pulse to follower.pulse_in"]}
    loose = replace(sound, provenance=replace(sound.provenance, host=host))
    found = judged(loose)["sync.wire_error_max_ns"]
    assert found.verdict is Verdict.UNSET
    assert "two pulse wires" in found.how


def test_both_nodes_see_the_same_difference_with_its_sign(sound: Recording) -> None:
    # The follower pulses 4 ticks of 62.5 ns after the leader: each sees the other accordingly.
    found = judged(wired(sound, {"leader": 4, "follower": -4}))["sync.wire_error_max_ns"]
    assert found.value == 250.0
    assert found.verdict is Verdict.PASS
    assert found.details["leader_mean_ns"] == found.details["follower_mean_ns"] == -250.0
    assert found.details["leader"] >= 50


def test_pulses_that_are_apart_fail(sound: Recording) -> None:
    # 20 ticks are 1250 ns; the limit is 1000 ns and the uncertainty 125 ns.
    found = judged(wired(sound, {"leader": 20, "follower": -20}))
    assert found["sync.wire_error_p99_ns"].verdict is Verdict.FAIL
    # 17 ticks are 1062.5 ns: too near to the limit to tell.
    found = judged(wired(sound, {"leader": 17, "follower": -17}))
    assert found["sync.wire_error_p99_ns"].verdict is Verdict.INCONCLUSIVE
