# SPDX-License-Identifier: Apache-2.0
"""Sequence numbers -> what is missing.

A node numbers its frames from 0 at boot, modulo 2^16, and its first frame is HELLO. A serial line
keeps their order. So, from each good frame to the next:

- a step of 1 is no loss; one of n, up to 32,767, says that n - 1 frames between them were lost;
- a step of 0 is a frame sent twice;
- a step back, or a HELLO that shows a later boot, is a restart: the node counts from 0 again, and
  the new number says how many of its frames since boot were lost.

A frame that arrived damaged is one of the lost ones, and is counted here and nowhere else. Three
things leave no trace in the numbers: frames before the first good one of a stream, frames behind
the last good one before a restart or the end, and 32,768 or more frames lost in one go, which look
like a restart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

BOOT_LIMIT_MS: Final = 5000
"""A HELLO numbered 0 and younger than this is the first since boot, not one after 65,536 frames:
at 1 Mbaud those need 5.2 s even if each is 8 bytes, the smallest frame there is."""

UPTIME_WRAP_MS: Final = 1 << 32


@dataclass(frozen=True)
class Continuity:
    """Counts of frames ``lost`` and ``duplicated``, and of ``restarts`` of the node."""

    lost: int
    duplicated: int
    restarts: int


def continuity(
    seq: NDArray[np.uint16], hello: NDArray[np.int64], uptime_ms: NDArray[np.int64]
) -> Continuity:
    """Counts losses in one node's stream.

    Args:
        seq: numbers of all good frames, in the order of the stream.
        hello: indices into ``seq`` of the frames that are HELLO, ascending.
        uptime_ms: time since boot that each of these says.
    """
    # Entry i is the step from frame i - 1 to frame i, -32768..32767.
    step = np.zeros(len(seq), np.int64)
    step[1:] = np.diff(seq).view(np.int16)
    restart = step < 0
    _mark_boots(restart, step, seq, hello, uptime_ms)
    ordinary = ~restart
    ordinary[:1] = False
    return Continuity(
        lost=int(np.maximum(step[ordinary] - 1, 0).sum() + seq[restart].sum(dtype=np.int64)),
        duplicated=int(np.count_nonzero(step[ordinary] == 0)),
        restarts=int(np.count_nonzero(restart)),
    )


def _mark_boots(
    restart: NDArray[np.bool_],
    step: NDArray[np.int64],
    seq: NDArray[np.uint16],
    hello: NDArray[np.int64],
    uptime_ms: NDArray[np.int64],
) -> None:
    """Adds to ``restart`` those that only HELLO shows: the numbers happened to step forward."""
    previous_uptime_ms = np.concatenate(([-1], uptime_ms[:-1]))
    repeated = (step[hello] == 0) & (uptime_ms == previous_uptime_ms)
    first = (seq[hello] == 0) & (uptime_ms < BOOT_LIMIT_MS) & ~repeated & (hello > 0)
    restart[hello[first]] = True
    fallen_ms = previous_uptime_ms - uptime_ms
    for k in np.flatnonzero((fallen_ms > 0) & (fallen_ms < UPTIME_WRAP_MS // 2)):
        # The first HELLO of this boot was lost. The boot lies where most is missing.
        since = slice(hello[k - 1] + 1, hello[k] + 1)
        if not restart[since].any():
            restart[since.start + int(np.argmax(step[since]))] = True
