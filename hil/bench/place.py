# SPDX-License-Identifier: Apache-2.0
"""A bench that a labgrid coordinator lends out: its place is acquired for the time of a run.

labgrid lives in an environment of its own, because its ``pyserial-labgrid`` overwrites the
``serial`` package; only its client program is run here.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from hil.bench.errors import BenchBusyError
from hil.bench.inventory import Place
from hil.errors import RigError
from hil.process import run

LIMIT_S: Final = 30.0
MEND: Final = (
    "who has it: labgrid-client who\n"
    "is the coordinator reachable? It is named by LG_COORDINATOR, or runs on this machine\n"
    "no such place? labgrid-client places lists them"
)
MEND_INSTALL: Final = (
    "python -m venv ~/labgrid && ~/labgrid/bin/pip install labgrid\n"
    'then in the bench file, under [labgrid]: client = "/home/.../labgrid/bin/labgrid-client"'
)


@contextmanager
def acquired(place: Place | None) -> Iterator[None]:
    """Hold a place during the block; does nothing when the bench has none.

    Raises:
        BenchBusyError: somebody else has it, or the client failed; shows the client's own words.
    """
    if place is None:
        yield
        return
    _client(place, "acquire")
    try:
        yield
    finally:
        # The run's own error is worth more than one about giving the place back.
        with contextlib.suppress(RigError):
            _client(place, "release")


def _client(place: Place, command: str) -> None:
    try:
        finished = run(
            [place.client, "-p", place.name, command],
            name=f"labgrid-client {command}",
            timeout_s=LIMIT_S,
            check=False,
        )
    except RigError as error:
        raise BenchBusyError(error.message, MEND_INSTALL) from error
    if finished.status != 0:
        raise BenchBusyError(
            f"the place '{place.name}' could not be had ({command}); labgrid says:\n"
            + "\n".join(f"    {line}" for line in finished.lines[-5:]),
            MEND,
        )
