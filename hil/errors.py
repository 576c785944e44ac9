# SPDX-License-Identifier: Apache-2.0
"""Every error the rig raises on purpose: one root, one family.

Each error carries what happened and, in ``mend``, what the user can do about it. The command
line prints both; the pytest plugin reports :class:`RigError` as an error of the rig, never as
a failed check of the product and never as a skip.
"""

from __future__ import annotations


def printable(text: str) -> str:
    """``text`` on one line and without what could steer a terminal: part of it is from a file."""
    return "".join(c if c.isprintable() else "?" for c in text)


def shorten(text: str, most: int = 300) -> str:
    """``text``, or as much of its beginning as ``most`` characters and an ellipsis hold."""
    return text if len(text) <= most else f"{text[:most]}…"


class HilError(Exception):
    """Root of all errors raised by ``hil``.

    Args:
        message: what happened, one sentence.
        mend: what to do about it: commands or settings, one per line.
    """

    def __init__(self, message: str, mend: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.mend = mend

    def __str__(self) -> str:
        if not self.mend:
            return self.message
        return f"{self.message}\nThings to try:\n" + "\n".join(
            f"  - {line}" for line in self.mend.splitlines()
        )


class RecordingError(HilError):
    """A recording that cannot be opened, or input that is not a recording."""


class ScenarioError(HilError):
    """A scenario file that is wrong; the message names the file and the key."""


class BuildError(HilError):
    """Firmware could not be built: no workspace, no toolchain, or the compiler said no."""


class RigError(HilError):
    """The rig, not the product, failed: a node that died, a port lost, a tool that hung."""
