# SPDX-License-Identifier: Apache-2.0
"""What can be wrong with a bench, each kind an error of its own, so that callers can tell."""

from __future__ import annotations

from collections.abc import Sequence

from hil.errors import RigError


class InventoryError(RigError):
    """The bench file is missing or wrong; the message names file, line and key."""


class BenchBusyError(RigError):
    """Another run holds the bench."""


class NoRunnerError(RigError):
    """No program that can drive a debug probe is ready for use."""


class ProbeMissingError(RigError):
    """The probe is not connected."""


class ProbeLostError(RigError):
    """A probe, or the program that drives it, failed in the middle of an operation."""


class FlashRefusedError(RigError):
    """Nothing was written, because the image or the board is not the right one."""


class BadImageError(FlashRefusedError):
    """The hex file is no firmware image for this chip."""


class HexChangedError(FlashRefusedError):
    """The hex file is not the one that was built."""


class WrongRoleError(FlashRefusedError):
    """The image was built for the other role."""


class WrongTargetError(FlashRefusedError):
    """The image was built for another target."""


class ChipProtectedError(FlashRefusedError):
    """Access port protection is on."""


class WrongChipError(FlashRefusedError):
    """The chip at the probe is not an nRF52840."""


class WrongBoardError(FlashRefusedError):
    """The chip at the probe is not the one that the bench file names."""


class ReadbackError(RigError):
    """Flash does not hold what was written to it."""


class PairError(RigError):
    """One or both boards failed; holds the error of each role."""

    def __init__(self, errors: dict[str, RigError]) -> None:
        super().__init__(
            "\n".join(f"{role}: {error.message}" for role, error in errors.items()),
            "\n".join(dict.fromkeys(_lines(errors))),
        )
        self.errors = errors


def _lines(errors: dict[str, RigError]) -> Sequence[str]:
    return [
        f"{role}: {line}" if len(errors) > 1 else line
        for role, error in errors.items()
        for line in error.mend.splitlines()
    ]
