# SPDX-License-Identifier: Apache-2.0
"""``hil link-key`` against nodes without firmware, written from link_security.c and node.c."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from typer.testing import CliRunner

from hil import link_key
from hil.cli import app
from hil.errors import RigError
from hil.wire.codec import decode, encode
from hil.wire.messages import schema_hash

STEP_S = 0.1
IMAGE_KEY = bytes(range(16))
REFUSED, NO_SPACE = 34, 28


@dataclass
class Air:
    """What the nodes share: time, and whether they can hear each other."""

    t_s: float = 0.0
    in_reach: bool = True
    nodes: list[FakeNode] = field(default_factory=list)

    def secure(self) -> bool:
        keys = {node.key for node in self.nodes}
        return self.in_reach and len(self.nodes) == 2 and len(keys) == 1


@dataclass
class FakeNode:
    air: Air
    role: int
    stored: bytes | None = None
    refuse: int = 0
    deaf_to_first: int = 0
    deaf: bool = False
    silent: bool = False
    schema: int = field(default_factory=schema_hash)
    heard: list[bytes] = field(default_factory=list)
    out: bytes = b""
    seq: int = 0
    next_s: float = 0.0

    def __post_init__(self) -> None:
        self.air.nodes.append(self)

    @property
    def key(self) -> bytes:
        return self.stored or IMAGE_KEY

    def write(self, data: bytes) -> None:
        (values,) = decode(data).messages["link_key"]
        key = bytes(values["key"].tolist())
        self.heard.append(key)
        if self.deaf or len(self.heard) <= self.deaf_to_first:
            return
        if self.refuse and any(key):
            self._say("fault", t_ticks_node=0, code=REFUSED, argument=self.refuse)
            return
        self.stored = key if any(key) else None

    def read_bytes(self, timeout_s: float) -> bytes:
        if timeout_s > 0:
            self.air.t_s += STEP_S
            if not self.silent and self.air.t_s >= self.next_s:
                self.next_s = self.air.t_s + 1.0
                self._speak()
        said, self.out = self.out, b""
        return said

    def _speak(self) -> None:
        self._say("hello", role=self.role, schema_hash=self.schema)
        origin = int(self.stored is not None)
        self._say("link_security", key=origin, secure=int(self.air.secure()))

    def _say(self, name: str, **values: Any) -> None:
        from hil.wire.messages import BY_NAME  # noqa: PLC0415

        blank = {f.name: [0] * f.count if f.count > 1 else 0 for f in BY_NAME[name].fields}
        self.out += encode(name, {**blank, **values}, self.seq)
        self.seq += 1


Pair = tuple[Air, FakeNode, FakeNode, dict[str, link_key.Node]]


@pytest.fixture
def pair() -> Callable[..., Pair]:
    def make(leader: dict[str, Any] | None = None, follower: dict[str, Any] | None = None) -> Pair:
        air = Air()
        one = FakeNode(air, 0, **(leader or {}))
        two = FakeNode(air, 1, **(follower or {}))
        nodes = {
            "leader": link_key.Node(one, "leader", lambda: air.t_s),
            "follower": link_key.Node(two, "follower", lambda: air.t_s),
        }
        return air, one, two, nodes

    return make


def test_both_get_one_random_key(pair: Callable[..., Pair]) -> None:
    keys = set()
    for _ in range(3):
        air, leader, follower, nodes = pair()
        link_key.change(nodes)
        assert leader.stored == follower.stored
        assert leader.stored is not None
        keys.add(leader.stored)
        link_key.wait_connected(nodes, now_s=lambda air=air: air.t_s)
    assert len(keys) == 3
    assert all(len(key) == 16 and len(set(key)) > 4 for key in keys)


def test_a_stored_key_is_forgotten_first(pair: Callable[..., Pair]) -> None:
    """Its answer to the new one would otherwise be what it said before."""
    old = bytes([7] * 16)
    _, leader, follower, nodes = pair({"stored": old}, {"stored": old})
    link_key.change(nodes)
    assert leader.heard[0] == bytes(16)
    assert leader.stored == follower.stored
    assert leader.stored not in (old, None)


def test_a_node_that_keeps_its_old_key_is_not_taken_for_done(pair: Callable[..., Pair]) -> None:
    _, leader, follower, nodes = pair({}, {"stored": bytes([7] * 16), "deaf": True})
    with pytest.raises(RigError, match="the leader has the new key, the follower has not") as found:
        link_key.change(nodes)
    assert "hil link-key" in found.value.mend
    assert "--forget" in found.value.mend
    assert leader.stored != follower.stored


def test_a_lost_command_is_said_again(pair: Callable[..., Pair]) -> None:
    _, leader, follower, nodes = pair({"deaf_to_first": 2})
    link_key.change(nodes)
    assert leader.stored == follower.stored is not None
    assert len(leader.heard) == 3


def test_forget_puts_both_back(pair: Callable[..., Pair]) -> None:
    _, leader, follower, nodes = pair({"stored": bytes([7] * 16)}, {"stored": bytes([9] * 16)})
    link_key.change(nodes, forget=True)
    assert leader.stored is None
    assert follower.stored is None


def test_nothing_is_told_to_one_when_the_other_is_not_there(pair: Callable[..., Pair]) -> None:
    for wrong, words in (
        ({"silent": True}, "did not say who it is"),
        ({"schema": 1}, "another version"),
    ):
        _, leader, _, nodes = pair({}, wrong)
        with pytest.raises(RigError, match=words):
            link_key.change(nodes)
        assert leader.heard == []


def test_a_refusal_says_the_error(pair: Callable[..., Pair]) -> None:
    _, _, follower, nodes = pair({"refuse": NO_SPACE})
    with pytest.raises(RigError, match=r"leader could not store the key \(its error 28\)"):
        link_key.change(nodes)
    assert follower.heard == []


def test_nodes_that_do_not_find_each_other(pair: Callable[..., Pair]) -> None:
    air, _, _, nodes = pair()
    air.in_reach = False
    link_key.change(nodes)
    with pytest.raises(RigError, match="not connected by it after 20 s"):
        link_key.wait_connected(nodes, now_s=lambda: air.t_s)


def test_the_key_is_in_no_message(
    pair: Callable[..., Pair], capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    for wrong in ({}, {"refuse": NO_SPACE}, {"deaf": True}):
        _, leader, follower, nodes = pair({}, wrong)
        said = ""
        try:
            link_key.change(nodes)
        except RigError as error:
            said = str(error)
        shown = capsys.readouterr()
        said += shown.out + shown.err + caplog.text
        for key in {*leader.heard, *follower.heard}:
            assert any(key)
            assert key.hex() not in said
            assert str(list(key)) not in said
            assert repr(key) not in said


def test_help_has_an_example() -> None:
    shown = CliRunner().invoke(app, ["link-key", "--help"])
    assert shown.exit_code == 0
    assert "hil link-key --board sim" in shown.output
