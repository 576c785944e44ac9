# SPDX-License-Identifier: Apache-2.0
"""A live stream fed with everything at once: nothing good is lost but where damage was done."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from hil.wire.codec import decode
from hil.wire.frames import frame
from hil.wire.live import LiveStream
from hil.wire.messages import BY_NAME

PULSE = BY_NAME["pulse"]
PRINTABLE = st.text(st.characters(min_codepoint=0x21, max_codepoint=0x7E), min_size=1, max_size=30)


class Line(RuleBasedStateMachine):
    """The line of one node: what was sent well is kept in a model, apart from the decoder."""

    def __init__(self) -> None:
        super().__init__()
        self.live = LiveStream()
        self.sent = bytearray()
        self.good: list[int] = []
        self.texts: list[str] = []
        self.seq = 0
        self.damaged = 0
        self.got: list[int] = []
        self.got_texts: list[str] = []

    def put(self, data: bytes, cuts: list[int]) -> None:
        self.sent += data
        at = 0
        for cut in [*sorted(c % (len(data) + 1) for c in cuts), len(data)]:
            decoded = self.live.feed(data[at:cut])
            at = cut
            self.got += decoded.messages["pulse"]["seq"].tolist()
            self.got_texts += [line.text for line in decoded.text]

    def framed(self) -> bytes:
        payload = self.seq.to_bytes(4, "little").ljust(PULSE.fixed_size, b"\x05")
        return frame(PULSE.id, self.seq, payload)

    @rule(cuts=st.lists(st.integers(0, 60), max_size=3))
    def good_frame(self, cuts: list[int]) -> None:
        data = self.framed()
        self.good.append(self.seq)
        self.seq += 1
        self.put(data, cuts)

    @rule(text=PRINTABLE, cuts=st.lists(st.integers(0, 60), max_size=2))
    def line_of_text(self, text: str, cuts: list[int]) -> None:
        self.texts.append(text)
        self.put(b"\0" + text.encode() + b"\r\n\0", cuts)

    @rule(at=st.integers(3, 20), flip=st.integers(1, 255))
    def damaged_frame(self, at: int, flip: int) -> None:
        """One byte wrong: the CRC finds every burst of up to 16 bits. It must not become a 00."""
        data = bytearray(self.framed())
        changed = data[at] ^ flip
        if changed == 0:
            return
        data[at] = changed
        self.seq += 1
        self.damaged += 1
        self.put(bytes(data), [])

    @rule(keep=st.integers(1, 12))
    def cut_frame(self, keep: int) -> None:
        """The rest of it never comes; the delimiter of what follows ends it."""
        self.put(self.framed()[:keep] + b"\0", [])
        self.seq += 1
        self.damaged += 1

    @rule(noise=st.binary(min_size=1, max_size=5))
    def garbage(self, noise: bytes) -> None:
        """Too short for a frame, and made not to look like text."""
        self.put(b"\0\x01" + noise.replace(b"\r\n", b"\xff").replace(b"\0", b"\x01") + b"\0", [])

    @invariant()
    def all_that_was_sent_well_has_come(self) -> None:
        assert self.got == self.good
        assert self.got_texts == self.texts

    @invariant()
    def every_loss_is_counted(self) -> None:
        stats = decode(bytes(self.sent)).stats
        missing = self.good[-1] + 1 - self.good[0] - len(self.good) if self.good else 0
        assert stats.lost == missing
        assert stats.duplicated == stats.restarts == 0
        assert stats.total_bytes == len(self.sent)


TestLine = Line.TestCase
TestLine.settings = settings(max_examples=20, stateful_step_count=20, deadline=None)
