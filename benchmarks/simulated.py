# SPDX-License-Identifier: Apache-2.0
"""60 s of both nodes on the simulated bench, beside the simulator's own programs.

The simulator's processor time is that of the images and of the radio; what the rig adds is its own:
reading both serial lines and the pins, and writing the recording.
"""

from __future__ import annotations

import re
import resource
import tempfile
from pathlib import Path

from benchmarks.measure import Row

SCENARIO = Path(__file__).parents[1] / "fixtures" / "scenarios" / "clean-7ms5.toml"
WORK = "simulated bench, 60 s of both nodes"
AIM = "within 1.3 times of the simulator"


def rows() -> list[Row]:
    from hil import build, run
    from hil.errors import HilError

    text = re.sub(
        r"^duration_s\s*=.*$", "duration_s = 60", SCENARIO.read_text("utf-8"), flags=re.MULTILINE
    )
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder, "minute.toml")
        scenario.write_text(text, encoding="utf-8")
        try:
            for role in ("leader", "follower"):
                build.build(role, "sim")
            before = _used()
            run.live("sim", scenario, None, Path(folder, "run.mcap"), _silent)
        except HilError as error:
            return [Row(WORK, "not measured", str(error).splitlines()[0], None, None, AIM, None)]
        own, simulator = (b - a for a, b in zip(before, _used(), strict=True))
    times = (own + simulator) / simulator
    return [
        Row(
            work=WORK,
            ours=f"{own + simulator:.1f} s",
            peer=f"images and radio alone: {simulator:.1f} s",
            ratio=1 / times,
            limit=None,
            aim=AIM,
            met=times <= 1.3,
            lacking="" if times <= 1.3 else f"{times:.2f} times",
        )
    ]


def _silent(share: float, what: str) -> None:
    """Progress is nobody's concern here."""


def _used() -> tuple[float, float]:
    """Processor time of this process and of the children that ended, s."""
    own, children = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime
