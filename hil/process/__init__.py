# SPDX-License-Identifier: Apache-2.0
"""Other programs: the only place in ``hil`` that starts them.

Programs are argument lists, never shell strings. Each runs in a session of its own, which is
killed whole when its owner leaves the ``with`` block for any reason, and which dies with the
owner even when the owner is killed outright. What a program says is kept, so that an error can
show the program's own last words.
"""

from hil.process.child import Child
from hil.process.ending import Ended, end_in_order
from hil.process.guard import Guard
from hil.process.run import Finished, capture, run
from hil.process.scratch import scratch
from hil.process.turn import turn

__all__ = [
    "Child",
    "Ended",
    "Finished",
    "Guard",
    "capture",
    "end_in_order",
    "run",
    "scratch",
    "turn",
]
