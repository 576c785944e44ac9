# SPDX-License-Identifier: Apache-2.0
"""The ``hil`` command: every command by name, read only when it is called or asked for help.

Typer reads the type hints of whatever it knows, and rich's help imports a Markdown parser; both
take longer than most commands. So the top level knows a name and a line of help for each, and its
own help and errors are plain text; ``hil COMMAND --help`` is painted by rich.
"""

from __future__ import annotations

import errno
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from hil.errors import HilError

COMMANDS: Final = {
    "build": (
        "hil.runs_cli:build",
        "Build the firmware images with west and print their manifests.",
    ),
    "record": (
        "hil.runs_cli:record",
        "Run a scenario live and keep everything it produced as a recording.",
    ),
    "replay": ("hil.runs_cli:replay", "Judge recordings and print every measurement."),
    "report": (
        "hil.runs_cli:report",
        "Write report.json, junit.xml, badge.json and one self-contained index.html.",
    ),
    "calibrate": (
        "hil.runs_cli:calibrate",
        "Calibrate a unit's sensor: lay it on six faces, leave it for a minute.",
    ),
    "noise": (
        "hil.runs_cli:noise",
        "Show a sensor's white noise and bias instability, by the Allan deviation of a long rest.",
    ),
    "pil": (
        "hil.runs_cli:pil",
        "Run the estimator on an emulated Cortex-M4F: equal bits, instructions, load, stack.",
    ),
    "log": (
        "hil.log.cli:log",
        "Log what the boards say on their serial ports, frames and text, until Ctrl-C.",
    ),
    "compare": (
        "hil.compare.cli:compare",
        "Run ours and other published trackers over the same samples: a league table.",
    ),
    "reps": (
        "hil.tools_cli:reps",
        "Show the repetitions of a recording, with velocities, times, range and tilt.",
    ),
    "truth": (
        "hil.tools_cli:truth",
        "Align an outside reference with the estimate and show the errors of the estimate.",
    ),
    "export": (
        "hil.exchange.cli:export",
        "Write a recording for other programs: samples, estimates, sync, events, repetitions.",
    ),
    "import": (
        "hil.exchange.cli:import_",
        "Make a recording of IMU data: of an export, or of another rig's one or two sensors.",
    ),
    "plot": (
        "hil.plot.cli:plot",
        "Draw a recording: samples, velocity, all 16 states with ±1 σ, stillness, repetitions.",
    ),
    "live": (
        "hil.live.cli:live",
        "Show a set as it is lifted: count, velocity, both sensors and their health, in a browser.",
    ),
    "link-key": (
        "hil.link_key_cli:link_key",
        "Give both nodes a random key of their own: no other node can join the link.",
    ),
    "sbom": (
        "hil.sbom.cli:sbom",
        "Write the bill of materials of images that were built: CycloneDX 1.6, JSON.",
    ),
    "soak": (
        "hil.soak.cli:soak",
        "Show what each hour of a long recording was like, and whether anything drifts.",
    ),
    "doctor": (
        "hil.bench.cli:doctor",
        "Check this machine and the bench: tools, permissions, boards, ports, wires.",
    ),
    "bench": ("hil.bench.cli:app", "The real bench: two boards, their probes, ports and wires."),
    "history": (
        "hil.history.cli:app",
        "Every run ever judged: list them, show how a measurement went, find flaky checks.",
    ),
    "tune": ("hil.tuning.cli:app", "Choose the estimator's parameters on recordings."),
    "stringpot": (
        "hil.stringpot.cli:app",
        "A string potentiometer on an ESP32 as an outside reference: calibrate, log, convert.",
    ),
}
"""Name -> module:function (or group of commands), first line of its help."""


class OnDemand(TyperGroup):
    """The commands of :data:`COMMANDS`: None until one is asked for by name."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        known: dict[str, Any] = {**dict.fromkeys(COMMANDS), **self.commands}
        self.commands = known

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command, its module imported; None for a name that there is not."""
        if cmd_name in COMMANDS and self.commands[cmd_name] is None:
            self.commands[cmd_name] = _read(cmd_name)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The table as it stands, nothing being imported for it."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])


def _read(name: str) -> Any:
    module, attribute = COMMANDS[name][0].split(":")
    found = getattr(import_module(module), attribute)
    around = typer.Typer(add_completion=False, rich_markup_mode="rich")
    if isinstance(found, typer.Typer):
        around.add_typer(found)
    else:
        around.command(name)(found)
    return typer.main.get_group(around).commands[name]


app = typer.Typer(
    name="hil",
    cls=OnDemand,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog="Example: hil replay fixtures/recordings/clean-7ms5",
)


@app.callback()
def _hil() -> None:
    """Hardware-in-the-loop rig for the two-node barbell velocity tracker: build the firmware,
    run it, record it, judge it.
    """


_DISK = (
    *(errno.EACCES, errno.EDQUOT, errno.EFBIG, errno.ENOSPC, errno.EPERM, errno.EROFS),
    *(errno.EEXIST, errno.EISDIR, errno.ENAMETOOLONG, errno.ENOENT, errno.ENOTDIR),
)


def _disk_error(error: OSError) -> HilError:
    """An error of the disk, wherever a command met it, in the words of this program."""
    from hil.errors import HilError  # noqa: PLC0415

    where = f"{error.filename}: " if error.filename else ""
    if error.errno in (errno.ENAMETOOLONG, errno.ENOENT):
        return HilError(f"{where}cannot be opened: {error.strerror}", "check the path")
    return HilError(
        f"{where}cannot be written: {error.strerror}",
        "name a place that you may write to, with room",
    )


def main() -> None:
    """Entry point: errors raised on purpose become one clear message and exit code 2."""
    from hil.errors import HilError  # noqa: PLC0415
    from hil.process.ending import end_in_order  # noqa: PLC0415

    end_in_order()
    try:
        app()
    except HilError as error:
        typer.echo(f"hil: {error}", err=True)
        sys.exit(2)
    except OSError as error:
        if error.errno not in _DISK:
            raise
        typer.echo(f"hil: {_disk_error(error)}", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        typer.echo("hil: interrupted", err=True)
        sys.exit(130)
