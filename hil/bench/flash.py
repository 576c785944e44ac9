# SPDX-License-Identifier: Apache-2.0
"""Flash and verify: a board holds the right image, proven by reading it back, before it may run.

Everything that can be refused is refused before the first byte is written. Writing is skipped
only when readback proves that the same image is there already.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

from hil.bench import image as images
from hil.bench.errors import (
    ChipProtectedError,
    PairError,
    ProbeLostError,
    ProbeMissingError,
    ReadbackError,
    WrongBoardError,
    WrongChipError,
)
from hil.bench.image import Image
from hil.bench.inventory import Board, Inventory
from hil.bench.probes.choose import choose
from hil.bench.probes.ficr import PART_NRF52840, ChipInfo, read_chip
from hil.bench.probes.model import Probe, Protection, ResetKind, Runner
from hil.errors import RigError

if TYPE_CHECKING:
    from hil.build import Manifest

Result = TypeVar("Result")
Step = Callable[[str, str], None]
"""Called with the role and what is being done to its board."""

READ_CHUNK_B: Final = 64 * 1024


@dataclass(frozen=True)
class Flashed:
    """A board that holds its image, for a recording's provenance.

    Attributes:
        role: ``leader`` or ``follower``.
        probe: serial number of the probe.
        runner: the program that drove it.
        runner_version: what that says of itself.
        device_id: FICR DEVICEID, 16 hex digits.
        chip: part and variant.
        build_id: of the image, as HELLO will say it.
        hex_sha256: of the hex file.
        bytes_verified: read back and found equal.
        programmed: False when it was there already.
        check_s: time for identity and first readback.
        program_s: time for writing.
        verify_s: time for the readback after writing.
    """

    role: str
    probe: str
    runner: str
    runner_version: str
    device_id: str
    chip: str
    build_id: str
    hex_sha256: str
    bytes_verified: int
    programmed: bool
    check_s: float
    program_s: float
    verify_s: float

    def to_mapping(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def no_step(role: str, what: str) -> None:
    """A step callback that shows nothing."""


def identify(probe: Probe, board: Board) -> ChipInfo:
    """The chip at a probe, proven to be the board's.

    Raises:
        ChipProtectedError, WrongChipError, WrongBoardError, ProbeLostError: each when it says so.
    """
    if probe.protection() is Protection.ON:
        raise ChipProtectedError(
            f"the chip at probe {probe.serial} has its access port protected (APPROTECT)",
            f"hil bench recover {board.role}   (this erases the whole chip, calibration included)",
        )
    chip = read_chip(probe)
    if chip.part != PART_NRF52840:
        raise WrongChipError(
            f"the chip at probe {probe.serial} is an {chip.name}, not an nRF52840",
            "use an nRF52840 DK (PCA10056); hil doctor shows the chip at every probe\n"
            "is a cable in the 'debug out' connector? Then the probe sees the other board's chip",
        )
    if board.device_id is not None and chip.device_id != board.device_id:
        raise WrongBoardError(
            f"the {board.role} is chip 0x{board.device_id:016x} in the bench file, "
            f"but probe {probe.serial} sees 0x{chip.device_id:016x}",
            "was a board exchanged? Then write the bench file anew: hil bench init --force",
        )
    return chip


def ensure(
    probe: Probe, board: Board, manifest: Manifest, *, always: bool = False, step: Step = no_step
) -> Flashed:
    """Make a board hold an image. The firmware does not start anew before the probe resets it.

    Args:
        always: write even when the image is there already.

    Raises:
        FlashRefusedError: a subclass for each reason; nothing was written.
        ReadbackError: what was written is not what flash holds.
        ProbeLostError: the probe failed in the middle.
    """
    start_s = time.monotonic()
    step(board.role, "checking image and chip")
    image = images.check(manifest, board.role)
    chip = identify(probe, board)
    held = not always and first_difference(probe, image) is None
    checked_s = written_s = verified_s = time.monotonic()
    if not held:
        step(board.role, f"writing {image.size} bytes")
        _during("writing", probe, lambda: probe.program(image.path))
        written_s = time.monotonic()
        step(board.role, "reading back")
        address = _during("reading back", probe, lambda: first_difference(probe, image))
        verified_s = time.monotonic()
        if address is not None:
            raise ReadbackError(
                f"the {board.role}'s flash differs from {image.path.name} from 0x{address:08x} on",
                f"hil bench recover {board.role}   (this erases the whole chip), then run again\n"
                "when it differs again: another USB cable or hub; then the chip's flash is worn",
            )
    return Flashed(
        role=board.role,
        probe=probe.serial,
        runner=probe.runner,
        runner_version=probe.version(),
        device_id=f"{chip.device_id:016x}",
        chip=chip.name,
        build_id=manifest.build_id,
        hex_sha256=image.sha256,
        bytes_verified=image.size,
        programmed=not held,
        check_s=checked_s - start_s,
        program_s=written_s - checked_s,
        verify_s=verified_s - written_s,
    )


def first_difference(probe: Probe, image: Image) -> int | None:
    """The first address at which the chip differs from the image; None when it holds all of it."""
    for segment in image.segments:
        for start in range(0, len(segment.data), READ_CHUNK_B):
            wanted = segment.data[start : start + READ_CHUNK_B]
            address = segment.address + start
            found = probe.read_memory(address, len(wanted))
            if found != wanted:
                same = (a == b for a, b in zip(found, wanted, strict=False))
                return address + next((n for n, ok in enumerate(same) if not ok), len(found))
    return None


class BoardPair:
    """The two boards of a bench, worked on at the same time.

    Args:
        inventory: the bench.
        runner: drives both probes; chosen as the bench file says by default.

    Raises:
        NoRunnerError: no program can drive the probes.
        ProbeMissingError: a probe of the bench file is not connected.
    """

    def __init__(self, inventory: Inventory, runner: Runner | None = None) -> None:
        self.inventory = inventory
        self.runner = choose(inventory.runner) if runner is None else runner
        self._require(self.runner.serials())
        self._probes = {
            role: self.runner.open(board.probe) for role, board in inventory.boards.items()
        }

    def prepare(
        self,
        manifests: Mapping[str, Manifest],
        *,
        always: bool = False,
        after_failure: bool = False,
        step: Step = no_step,
    ) -> dict[str, Flashed]:
        """Make both boards hold their images; neither starts before :meth:`reset`.

        Both are worked on to the end, also when one fails, so that none is left half written; the
        one that succeeded then waits for its reset.

        Args:
            manifests: role -> image.
            always: write even what is there already.
            after_failure: reset both boards through their pin first: the run before ended badly.

        Raises:
            PairError: one or both failed; holds each error.
        """
        if after_failure:
            self.reset("pin")
        return self._both(
            lambda role: ensure(
                self._probes[role],
                self.inventory.boards[role],
                manifests[role],
                always=always,
                step=step,
            )
        )

    def reset(self, kind: ResetKind = "system") -> None:
        """Start both boards' firmware anew.

        Raises:
            PairError: one or both failed.
        """
        self._both(lambda role: self._probes[role].reset(kind))

    def chips(self) -> dict[str, ChipInfo]:
        """Role -> chip, each proven to be its board's.

        Raises:
            PairError: one or both are not.
        """
        return self._both(lambda role: identify(self._probes[role], self.inventory.boards[role]))

    def recover(self, role: str) -> None:
        """Erase one board's chip through CTRL-AP, which also ends its protection.

        Raises:
            ProbeLostError: it failed.
        """
        self._probes[role].recover()

    def _both(self, work: Callable[[str], Result]) -> dict[str, Result]:
        results: dict[str, Result] = {}
        errors: dict[str, RigError] = {}
        with ThreadPoolExecutor(len(self._probes)) as pool:
            tasks = {role: pool.submit(work, role) for role in self._probes}
            for role, task in tasks.items():
                try:
                    results[role] = task.result()
                except RigError as error:
                    errors[role] = error
        if errors:
            raise PairError(errors)
        return results

    def _require(self, connected: list[str]) -> None:
        missing = [b for b in self.inventory.boards.values() if b.probe not in connected]
        if missing:
            raise ProbeMissingError(
                " and ".join(f"the {b.role}'s probe {b.probe}" for b in missing)
                + (" is" if len(missing) == 1 else " are")
                + " not connected; connected: "
                + (", ".join(connected) or "none"),
                "plug it in and switch the board on; then: hil doctor\n"
                "other boards than before? Write the bench file anew: hil bench init --force",
            )


def _during(what: str, probe: Probe, work: Callable[[], Result]) -> Result:
    try:
        return work()
    except ProbeLostError as error:
        raise ProbeLostError(
            f"probe {probe.serial} was lost while {what}; the board holds no whole image now.\n"
            f"{error.message}",
            error.mend,
        ) from error
