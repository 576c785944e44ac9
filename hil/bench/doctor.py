# SPDX-License-Identifier: Apache-2.0
"""Is this machine, and is this bench, ready? Each question is a check with its answer and its fix.

Nothing here changes anything: no board is written, none is reset.
"""

from __future__ import annotations

import grp
import json
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from hil.bench import inventory as inventories
from hil.bench import lock
from hil.bench.errors import BenchBusyError, InventoryError
from hil.bench.flash import identify
from hil.bench.inventory import Board, Inventory
from hil.bench.probes.choose import choose, runners
from hil.bench.probes.model import Readiness, Runner
from hil.bench.probes.tool import first_line
from hil.bench.survey import Survey
from hil.bench.wiring import advice
from hil.errors import HilError
from hil.wire.messages import ROLES, schema_hash

if TYPE_CHECKING:
    from rich.console import Console

Verdict = Literal["pass", "fail", "n/a"]
Hello = Callable[[str], "dict[str, Any] | None"]
"""Path of a serial port -> the fields of a HELLO heard there, or None."""

WiringCheck = Callable[[Inventory], "list[Check]"]
"""Makes the boards toggle their pins and watches the analyser."""

EXIT_FAILED: Final = 10
FIX_UDEV: Final = "hil doctor --write-udev 60-hil-bench.rules   (and then what it says)"


@dataclass(frozen=True)
class Check:
    """One question.

    Attributes:
        name: what is looked at.
        verdict: ``pass``, ``fail``, or ``n/a`` when the question does not arise.
        found: what was seen.
        fix: what to do about it, one line each; empty unless it failed.
    """

    name: str
    verdict: Verdict
    found: str
    fix: str = ""


@dataclass(frozen=True)
class Probing:
    """What the checks of hardware use; replaced in tests and by a rig that knows more.

    Attributes:
        look: surveys what is plugged in.
        runners: programs that can drive a probe.
        hello: listens on a serial port; None when there is nothing to listen with.
        wiring: checks the wires; None when there is nothing to check them with.
    """

    look: Callable[[], Survey]
    runners: Callable[[], Sequence[Runner]] = runners
    hello: Hello | None = None
    wiring: WiringCheck | None = None


@dataclass
class _Bench:
    """What is known of the bench so far, from one check to the next."""

    inventory: Inventory | None = None
    survey: Survey = field(default_factory=Survey)
    candidates: list[Runner] = field(default_factory=list)
    ready: list[Runner] = field(default_factory=list)
    chips: dict[str, int] = field(default_factory=dict)
    busy: bool = False


def examine(bench: Path, probing: Probing, workspace: Path | None = None) -> list[Check]:
    """Ask every question.

    Args:
        bench: the bench file; need not exist.
        workspace: as :func:`hil.build.find_workspace`.
    """
    state = _Bench()
    with ThreadPoolExecutor(8) as pool:
        survey = pool.submit(probing.look)
        candidates = list(probing.runners())
        readiness = [pool.submit(runner.readiness) for runner in candidates]
        tools = [pool.submit(check) for check in _TOOLS]
        state.survey = survey.result()
        checks = [_python(), _package(), *(task.result() for task in tools)]
        checks.append(_workspace(workspace))
        ready = [task.result() for task in readiness]
    checks += _runners(candidates, ready, state)
    checks += [_permissions(state.survey), _groups(), _bench_file(bench, state)]
    checks += _probes(state)
    checks += _ports(state)
    checks.append(_analyser(state))
    with ExitStack() as held:
        checks.append(_lock(bench, state, held))
        checks += _chips(state)
        checks += _firmware(state, probing.hello)
        checks += _wiring(state, probing.wiring)
    return checks


def failed(checks: Sequence[Check]) -> bool:
    """True when any check failed."""
    return any(check.verdict == "fail" for check in checks)


def to_json(checks: Sequence[Check]) -> str:
    """The checks as one JSON document."""
    document = {"ok": not failed(checks), "checks": [asdict(check) for check in checks]}
    return json.dumps(document, indent=2, ensure_ascii=False)


def render(checks: Sequence[Check], console: Console) -> None:
    """Print a table, each line with a sign and a word, each failure with its fix, and a summary."""
    from rich.table import Table  # noqa: PLC0415 (start-up time of --help)
    from rich.text import Text  # noqa: PLC0415

    styles = {"pass": "green", "fail": "bold red", "n/a": "dim"}
    signs = {"pass": "✓ ok", "fail": "✗ FAIL", "n/a": "– n/a"}
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for check in checks:
        said = Text(check.found, "dim" if check.verdict == "n/a" else "")
        for line in check.fix.splitlines() if check.verdict == "fail" else ():
            said.append(f"\n→ {line}", "cyan")
        style = styles[check.verdict]
        table.add_row(Text(signs[check.verdict], style), Text(check.name), said)
    console.print(table)
    bad = [check.name for check in checks if check.verdict == "fail"]
    if bad:
        console.print(Text(f"\n✗ {len(bad)} to fix: {', '.join(bad)}", "bold red"))
    else:
        console.print(Text("\n✓ everything that could be checked is in order", "green"))


def _python() -> Check:
    """Always sound: the package does not install on an older one."""
    return Check("python", "pass", f"{platform.python_version()} at {sys.executable}")


def _package() -> Check:
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return Check("hil", "pass", f"{version('hil')}, protocol table {schema_hash():016x}")
    except PackageNotFoundError:
        return Check("hil", "fail", "not installed as a package", "pip install -e .")


def _west() -> Check:
    """As a module: the build runs the west of its own Python, not the one on ``PATH``."""
    version = first_line([sys.executable, "-m", "west", "--version"])
    if "version" in version:
        return Check("west", "pass", version)
    return Check("west", "fail", "west is not in this Python", "pip install -e '.[build]'")


def _tool(name: str, program: str, fix: str) -> Callable[[], Check]:
    def check() -> Check:
        if shutil.which(program) is None:
            return Check(name, "fail", f"{program} is not installed", fix)
        version = first_line([program, "--version"])
        return Check(name, "pass", version or f"{program} says no version")

    return check


_TOOLS: Final = (
    _west,
    _tool(
        "compiler",
        "arm-none-eabi-gcc",
        "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi "
        "libstdc++-arm-none-eabi-newlib\nor the Zephyr SDK: west sdk install -t arm-zephyr-eabi",
    ),
    _tool("device tree", "dtc", "apt-get install device-tree-compiler"),
    _tool("sigrok-cli", "sigrok-cli", "apt-get install sigrok-cli"),
)


def _workspace(workspace: Path | None) -> Check:
    from hil.build import find_workspace  # noqa: PLC0415

    try:
        found = find_workspace(workspace)
    except HilError as error:
        return Check("workspace", "fail", error.message, error.mend)
    return Check("workspace", "pass", f"Zephyr {found.version} at {found.path}")


def _runners(
    candidates: Sequence[Runner], readiness: Sequence[Readiness], state: _Bench
) -> Iterator[Check]:
    pairs = list(zip(candidates, readiness, strict=True))
    state.candidates = list(candidates)
    state.ready = [runner for runner, found in pairs if found.ready]
    for runner, found in pairs:
        if found.ready:
            yield Check(f"runner {runner.name}", "pass", found.version)
        else:
            yield Check(f"runner {runner.name}", "n/a", found.problem)
    if state.ready:
        yield Check(
            "probe runner", "pass", f"{state.ready[0].name}, unless the bench file names one"
        )
        return
    yield Check(
        "probe runner",
        "fail",
        "none of the programs above is ready, so no board can be flashed",
        "one of them is enough; the quickest: apt-get install openocd\n"
        "Nordic's own: nrfutil from nordicsemi.com, then: nrfutil install device\n"
        "SEGGER's J-Link software (segger.com/downloads/jlink) makes nrfjprog and jlink ready",
    )


def _permissions(survey: Survey) -> Check:
    closed = [probe for probe in survey.probes if not probe.writable]
    if not survey.probes:
        return Check("USB access", "n/a", "no probe is plugged in")
    if closed:
        names = ", ".join(f"{probe.serial} ({probe.device})" for probe in closed)
        return Check("USB access", "fail", f"no permission for probe {names}", FIX_UDEV)
    return Check("USB access", "pass", f"{len(survey.probes)} probes may be used")


def _groups() -> Check:
    if os.geteuid() == 0:
        return Check("serial access", "pass", "root may open every port")
    names = {_group_name(gid) for gid in os.getgroups()}
    if "dialout" in names:
        return Check("serial access", "pass", "in group dialout")
    return Check(
        "serial access",
        "fail",
        "not in group dialout, which owns serial ports",
        f"sudo usermod -aG dialout $USER   (then log out and in)\nor: {FIX_UDEV}",
    )


def _group_name(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


def _bench_file(bench: Path, state: _Bench) -> Check:
    try:
        state.inventory = inventories.load(bench)
    except InventoryError as error:
        return Check("bench file", "fail", error.message, error.mend)
    return Check("bench file", "pass", f"{bench}; {advice(state.inventory)[0]}")


def _lock(bench: Path, state: _Bench, held: ExitStack) -> Check:
    """Takes the bench, so that what follows does not disturb another run."""
    if state.inventory is None:
        return Check("bench lock", "n/a", "there is no bench file")
    try:
        held.enter_context(lock.hold(bench))
    except BenchBusyError as error:
        state.busy = True
        return Check("bench lock", "fail", error.message, error.mend)
    return Check("bench lock", "pass", "nobody else is using the bench")


def _probes(state: _Bench) -> Iterator[Check]:
    connected = {probe.serial for probe in state.survey.probes}
    shown = ", ".join(sorted(connected)) or "none"
    if state.inventory is None:
        if len(connected) >= len(ROLES):
            yield Check("probes", "pass", f"connected: {shown}")
        else:
            yield Check(
                "probes",
                "fail",
                f"{len(connected)} of two debug probes connected ({shown})",
                "plug in both boards and switch them on; in a virtual machine, pass USB through",
            )
        return
    for role, board in state.inventory.boards.items():
        if board.probe in connected:
            yield Check(f"probe {role}", "pass", board.probe)
        else:
            yield Check(
                f"probe {role}",
                "fail",
                f"{board.probe} is not connected (connected: {shown})",
                "plug it in and switch the board on\n"
                "other boards than before? hil bench init --force",
            )


def _ports(state: _Bench) -> Iterator[Check]:
    for role, board in _boards(state, "port"):
        if isinstance(board, Check):
            yield board
            continue
        port = state.survey.port(board)
        if port is None:
            yield Check(
                f"port {role}",
                "fail",
                f"probe {board.probe} has no serial port with USB interface {board.vcom}",
                "a DK has two: try vcom = 0 and vcom = 2 in the bench file\n"
                "switched off in the probe? JLinkExe: vcom enable, then replug the board",
            )
        elif not os.access(port.path, os.R_OK | os.W_OK):
            yield Check(f"port {role}", "fail", f"no permission for {port.path}", FIX_UDEV)
        else:
            yield Check(f"port {role}", "pass", f"{port.path} (interface {port.interface})")


def _analyser(state: _Bench) -> Check:
    found = ", ".join(device.spec for device in state.survey.analysers)
    if state.inventory is None:
        return Check("analyser", "pass" if found else "n/a", found or "none is plugged in")
    wanted = state.inventory.analyser
    if wanted is None:
        return Check("analyser", "n/a", "the bench file has none")
    if wanted.kind != "sigrok":
        return Check("analyser", "n/a", f"{wanted.kind} is looked for when a run starts")
    name = wanted.driver.partition(":")[0]
    if any(device.driver == name for device in state.survey.analysers):
        return Check("analyser", "pass", wanted.driver)
    return Check(
        "analyser",
        "fail",
        f"sigrok finds no '{name}' (found: {found or 'none'})",
        f"plug it in; then: sigrok-cli --driver {name} --scan\n"
        f"no permission? {FIX_UDEV}\nfx2lafw needs: apt-get install sigrok-firmware-fx2lafw",
    )


def _chips(state: _Bench) -> Iterator[Check]:
    for role, board in _boards(state, "chip"):
        if isinstance(board, Check):
            yield board
            continue
        assert state.inventory is not None
        try:
            named = state.inventory.runner
            runner = choose(named, state.candidates if named else state.ready)
            chip = identify(runner.open(board.probe), board)
        except HilError as error:
            yield Check(f"chip {role}", "fail", error.message, error.mend)
            continue
        state.chips[role] = chip.device_id
        yield Check(f"chip {role}", "pass", f"{chip.name}, id 0x{chip.device_id:016x}")


def _firmware(state: _Bench, hello: Hello | None) -> Iterator[Check]:
    for role, board in _boards(state, "firmware"):
        if isinstance(board, Check):
            yield board
            continue
        port = state.survey.port(board)
        if port is None or hello is None:
            yield Check(f"firmware {role}", "n/a", "there is no serial port to listen on")
            continue
        try:
            said = hello(port.path)
        except HilError as error:
            yield Check(f"firmware {role}", "fail", error.message, error.mend)
            continue
        yield _identity(role, said, state.chips.get(role), port.path)


def _identity(role: str, said: dict[str, Any] | None, chip: int | None, path: str) -> Check:
    name = f"firmware {role}"
    if said is None:
        return Check(
            name,
            "fail",
            f"nothing that this rig understands came from {path} in five seconds",
            "flash the tracker's firmware: hil bench flash\n"
            "or it is the DK's other port: vcom = 0 or vcom = 2 in the bench file",
        )
    wrong = []
    if said["role"] != ROLES[role]:
        wrong.append("it is the other role's firmware")
    if said["schema_hash"] != schema_hash():
        wrong.append("it speaks another protocol table")
    if chip is not None and said["device_id"] != chip:
        wrong.append(f"the port belongs to chip 0x{said['device_id']:016x}, not to the probe's")
    if wrong:
        return Check(name, "fail", "; ".join(wrong), "hil bench flash")
    return Check(name, "pass", f"build {said['build_id']:016x}, up {said['uptime_ms'] // 1000} s")


def _wiring(state: _Bench, check: WiringCheck | None) -> Iterator[Check]:
    if state.inventory is None:
        yield Check("wiring", "n/a", "there is no bench file")
    elif len(state.chips) < len(ROLES):
        yield Check("wiring", "n/a", "needs both boards, identified")
    elif state.inventory.analyser is None or check is None:
        yield Check("wiring", "n/a", "needs an analyser to see the pins with")
    else:
        yield from check(state.inventory)


def _boards(state: _Bench, what: str) -> Iterator[tuple[str, Board | Check]]:
    """The boards of the bench file, or for each role why the question does not arise."""
    connected = {probe.serial for probe in state.survey.probes}
    for role in ROLES:
        if state.inventory is None:
            yield role, Check(f"{what} {role}", "n/a", "there is no bench file")
        elif state.inventory.boards[role].probe not in connected:
            yield role, Check(f"{what} {role}", "n/a", "its probe is not connected")
        elif state.busy and what != "port":
            yield role, Check(f"{what} {role}", "n/a", "another run has the bench")
        elif what == "chip" and not state.ready:
            yield role, Check(f"{what} {role}", "n/a", "no probe runner is ready")
        else:
            yield role, state.inventory.boards[role]
