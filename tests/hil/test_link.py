# SPDX-License-Identifier: Apache-2.0
"""Did everything arrive, and from whom? Limits: docs/error-budget.md, lines L and R."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hil.wire.codec import Decoded
from tests.hil.conftest import Judge


def test_nodes_say_who_they_are(judge: Judge) -> None:
    """Role, schema hash and build id in HELLO are those of the image that was meant to run."""
    judge("node.leader.hello_errors", "node.follower.hello_errors")


def test_nodes_stay_up(judge: Judge) -> None:
    judge("node.leader.", "node.follower.")


def test_link_loses_nothing(judge: Judge) -> None:
    """Serial lines, BLE queues, GATT payloads and the recording itself."""
    judge("link.")


def test_both_nodes_send_hello(leader: Decoded, follower: Decoded) -> None:
    assert leader.messages["hello"].size > 0
    assert follower.messages["hello"].size > 0


def test_images_are_known(images: Mapping[str, Mapping[str, Any]]) -> None:
    """A run without the manifest of what ran proves nothing about any image."""
    for role in ("leader", "follower"):
        assert images[role]["build_id"]
