# SPDX-License-Identifier: Apache-2.0
"""``hil bench`` and ``hil doctor`` as a person without hardware meets them, and with fakes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hil.bench import doctor, inventory, setup, survey
from hil.bench import lock as locks
from hil.bench.analyser.find import SigrokDevice
from hil.bench.doctor import Check, Probing
from hil.bench.flash import BoardPair
from hil.bench.inventory import Inventory
from hil.bench.ports import PortInfo
from hil.bench.probes.usb import UsbProbe
from hil.bench.survey import Survey
from hil.wire.messages import schema_hash
from tests.bench.fakes import images
from tests.bench.fakes.chip import FakeChip, FakeProbe, FakeRunner
from tests.bench.fakes.programs import programs_on_path

ROOT = Path(__file__).parents[3]
CODE = """
import typer
from hil import cli
from hil.bench import cli as bench
names = {command.name or command.callback.__name__ for command in cli.app.registered_commands}
if "doctor" not in names:
    cli.app.add_typer(bench.app)
    cli.app.command()(bench.doctor)
cli.main()
"""


def hil(
    *args: str | Path, cwd: Path, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", CODE, *map(str, args)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
        stdin=subprocess.DEVNULL,
    )


@pytest.mark.parametrize(
    ("command", "status", "said"),
    [
        (["bench", "show"], 2, "hil bench init"),
        (["bench", "flash"], 2, "hil bench init"),
        (["bench", "reset"], 2, "hil bench init"),
        (["bench", "recover", "leader", "--yes"], 2, "hil bench init"),
        (["bench", "recover", "middle"], 2, "neither leader nor follower"),
        (["bench", "unlock"], 0, "is free"),
        (["doctor"], 10, "hil bench init"),
    ],
)
def test_with_no_hardware_each_command_ends_soon_and_says_what_to_do(
    tmp_path: Path, command: list[str], status: int, said: str
) -> None:
    start_s = time.monotonic()
    result = hil(*command, cwd=tmp_path)
    assert time.monotonic() - start_s < 10
    assert result.returncode == status, result.stdout + result.stderr
    assert said in result.stdout + result.stderr
    assert "Traceback" not in result.stderr


def test_init_without_a_probe_writes_nothing_and_says_why(tmp_path: Path) -> None:
    if survey.look().probes:
        pytest.skip("probes are connected")
    start_s = time.monotonic()
    result = hil("bench", "init", cwd=tmp_path)
    assert time.monotonic() - start_s < 10
    assert result.returncode == 2
    assert "no debug probe is connected" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_show_draws_the_example(tmp_path: Path) -> None:
    result = hil("bench", "show", "--file", ROOT / "boards/bench.example.toml", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "├──────┤ D0           D3 ├──────┤" in result.stdout


def test_show_on_a_terminal_without_line_drawing(tmp_path: Path) -> None:
    result = hil(
        *("bench", "show", "--file", ROOT / "boards/bench.example.toml"),
        cwd=tmp_path,
        environment={"PYTHONIOENCODING": "ascii"},
    )
    assert result.returncode == 0, result.stderr
    assert "+------+ D0           D3 +------+" in result.stdout


def test_unlock_names_the_owner(tmp_path: Path) -> None:
    with locks.hold(tmp_path / "b.toml"):
        result = hil("bench", "unlock", "--file", tmp_path / "b.toml", cwd=tmp_path)
    assert result.returncode == 2
    assert f"kill {os.getpid()}" in result.stderr


def test_the_boards_are_not_touched_while_another_run_has_the_bench(tmp_path: Path) -> None:
    path = tmp_path / "b.toml"
    setup.write(path, setup.text(("1", "2")))
    with locks.hold(path):
        result = hil("bench", "reset", "--file", path, "--lock-wait", "0.2", cwd=tmp_path)
    assert result.returncode == 2
    assert "waiting up to 0 s for the bench" in result.stderr
    assert f"in use by {locks._user()}" in result.stderr


def test_doctor_speaks_json(tmp_path: Path) -> None:
    result = hil("doctor", "--json", cwd=tmp_path)
    document = json.loads(result.stdout)
    assert document["ok"] is False
    assert result.returncode == 10
    by_name = {check["name"]: check for check in document["checks"]}
    assert by_name["bench file"]["verdict"] == "fail"
    assert by_name["wiring"]["verdict"] == "n/a"
    assert all(check["fix"] for check in document["checks"] if check["verdict"] == "fail")


def test_udev_rules_are_written_where_told_and_nothing_else_happens(tmp_path: Path) -> None:
    result = hil("doctor", "--write-udev", tmp_path / "60.rules", cwd=tmp_path)
    assert result.returncode == 0
    assert f"sudo cp {tmp_path}/60.rules /etc/udev/rules.d/" in result.stdout
    rules = (tmp_path / "60.rules").read_text().splitlines()
    assert any('ATTR{idVendor}=="1366"' in rule for rule in rules)
    # udev(7): one rule is one line of KEY, operator and quoted value, with commas between.
    pair = r'[A-Z]+(\{\w+\})?(==|=|\+=)"[^"]+"'
    for rule in rules:
        assert rule.startswith("#") or re.fullmatch(rf"SUBSYSTEM==\"(usb|tty)\"(, {pair})+", rule)


def test_udev_rules_that_cannot_be_written_are_one_clear_error(tmp_path: Path) -> None:
    result = hil("doctor", "--write-udev", tmp_path / "no" / "60.rules", cwd=tmp_path)
    assert result.returncode == 2
    assert "cannot be written" in result.stderr


# Init and doctor on a bench of fakes


def bench_of_fakes(tmp_path: Path) -> tuple[Survey, FakeProbe, FakeProbe]:
    device, tty = tmp_path / "usb", tmp_path / "tty"
    device.touch()
    for name in ("tty1", "tty2"):
        (tmp_path / name).touch()
    leader, follower = (FakeProbe(n, FakeChip((int(n), 0))) for n in ("1", "2"))
    assert not tty.exists()
    return (
        Survey(
            tuple(UsbProbe(n, "J-Link", device) for n in ("1", "2")),
            tuple(
                PortInfo(str(tmp_path / f"tty{n}"), f"00000000000{n}", 0, 0x1366, 0x1051)
                for n in (1, 2)
            ),
            (SigrokDevice("fx2lafw", "1.7", "Saleae Logic", tuple(f"D{n}" for n in range(8))),),
        ),
        leader,
        follower,
    )


def hello(role: int, chip: int, **changes: int) -> dict[str, Any]:
    sound = {"role": role, "schema_hash": schema_hash(), "device_id": chip}
    return sound | {"build_id": 0xAB, "uptime_ms": 61_000} | changes


def checked(tmp_path: Path, found: Survey, *probes: FakeProbe, **replaced: Any) -> dict[str, Check]:
    path = tmp_path / "bench.toml"
    if not path.exists():
        setup.write(path, setup.text(("1", "2"), driver="fx2lafw"))
    probing = Probing(
        look=lambda: found,
        runners=lambda: [FakeRunner(*probes)],
        **{"hello": lambda port: hello(int(port[-1]) - 1, int(port[-1])), **replaced},
    )
    return {check.name: check for check in doctor.examine(path, probing)}


def test_a_bench_in_order_passes_every_check_of_it(tmp_path: Path) -> None:
    found, *probes = bench_of_fakes(tmp_path)
    checks = checked(
        tmp_path, found, *probes, wiring=lambda bench: [Check("wiring", "pass", "6 edges seen")]
    )
    names = ["bench file", "bench lock", "USB access", "analyser", "wiring"]
    names += [f"{what} {role}" for what in ("probe", "port", "chip", "firmware") for role in ROLES]
    assert {name: checks[name].verdict for name in names} == dict.fromkeys(names, "pass")
    assert "build 00000000000000ab, up 61 s" in checks["firmware leader"].found
    assert "0x0000000000000001" in checks["chip leader"].found


ROLES = ("leader", "follower")


def test_looking_changes_nothing_on_the_boards(tmp_path: Path) -> None:
    found, *probes = bench_of_fakes(tmp_path)
    checked(tmp_path, found, *probes)
    for probe in probes:
        assert [line.split()[0] for line in probe.log] == ["protection", "read", "read"]


@pytest.mark.parametrize(
    ("fault", "name", "said", "fix"),
    [
        ("protected", "chip leader", "APPROTECT", "hil bench recover leader"),
        ("part", "chip leader", "nRF52832", "PCA10056"),
        ("gone", "probe leader", "1 is not connected", "plug it in"),
        ("closed", "USB access", "no permission for probe 1", "--write-udev"),
        ("no port", "port leader", "no serial port", "vcom = 2"),
        ("analyser", "analyser", "sigrok finds no 'fx2lafw'", "plug it in"),
        ("silent", "firmware leader", "nothing that this rig understands", "hil bench flash"),
        ("role", "firmware leader", "other role's firmware", "hil bench flash"),
        ("schema", "firmware leader", "another protocol table", "hil bench flash"),
        ("chip", "firmware leader", "belongs to chip 0x0000000000000063", "hil bench flash"),
        ("locked", "bench lock", "in use by", "kill"),
    ],
)
def test_each_fault_fails_its_own_check_with_its_fix(
    tmp_path: Path, fault: str, name: str, said: str, fix: str
) -> None:
    found, *probes = bench_of_fakes(tmp_path)
    replaced: dict[str, Any] = {}
    says: dict[str, dict[str, int]] = {
        "role": {"role": 1},
        "schema": {"schema_hash": 1},
        "chip": {"device_id": 99},
    }
    if fault == "protected":
        probes[0].chip.protected = True
    elif fault == "part":
        probes[0].chip.part = 0x52832
    elif fault == "gone":
        found = Survey(found.probes[1:], found.ports, found.analysers)
        probes = probes[1:]
    elif fault == "closed":
        closed = UsbProbe("1", "J-Link", tmp_path / "nobody may")
        found = Survey((closed, found.probes[1]), found.ports, found.analysers)
    elif fault == "no port":
        found = Survey(found.probes, found.ports[1:], found.analysers)
    elif fault == "analyser":
        found = Survey(found.probes, found.ports)
    elif fault == "silent":
        replaced["hello"] = lambda port: None if port[-1] == "1" else hello(1, 2)
    elif fault in says:
        replaced["hello"] = lambda port: (
            hello(0, 1) | says[fault] if port[-1] == "1" else hello(1, 2)
        )
    if fault == "locked":
        with locks.hold(tmp_path / "bench.toml"):
            checks = checked(tmp_path, found, *probes)
        # The other run's boards are left alone.
        assert [probe.log for probe in probes] == [[], []]
        assert checks["chip leader"].found == "another run has the bench"
    else:
        checks = checked(tmp_path, found, *probes, **replaced)
    assert checks[name].verdict == "fail"
    assert said in checks[name].found
    assert fix in checks[name].fix
    other = [c for c in checks.values() if c.verdict == "fail" and "follower" in c.name]
    assert other == [] or fault == "gone"


def test_without_tools_each_one_is_a_line_with_its_fix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs_on_path(tmp_path / "bin", monkeypatch)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("ZEPHYR_BASE", raising=False)
    monkeypatch.chdir(tmp_path)
    checks = {c.name: c for c in doctor.examine(tmp_path / "b.toml", Probing(look=Survey))}
    for name, fix in {
        "compiler": "gcc-arm-none-eabi",
        "device tree": "device-tree-compiler",
        "sigrok-cli": "apt-get install sigrok-cli",
        "workspace": "west init",
        "probe runner": "apt-get install openocd",
    }.items():
        assert checks[name].verdict == "fail"
        assert fix in checks[name].fix


@pytest.mark.parametrize("width", [80, 120])
def test_the_table_fits_the_terminal_and_shows_every_fix(tmp_path: Path, width: int) -> None:
    checks = doctor.examine(tmp_path / "b.toml", Probing(look=Survey))
    console = Console(width=width, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    doctor.render(checks, console)
    text = console.export_text()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    squeezed = "".join(text.split())
    for check in checks:
        assert "".join(check.found.split()) in squeezed
        for line in check.fix.splitlines():
            assert f"→{''.join(line.split())}" in squeezed


def test_init_asks_nobody_who_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner  # noqa: PLC0415

    from hil.bench import cli  # noqa: PLC0415
    from hil.bench.errors import InventoryError  # noqa: PLC0415

    found, *_ = bench_of_fakes(tmp_path)
    ports = tuple(PortInfo(f"/dev/x{n}", "0002", n, 0x1366, 0x1051) for n in (4, 2))
    found = Survey(found.probes, (found.ports[0], *ports), found.analysers)
    monkeypatch.setattr(survey, "look", lambda: found)
    file = ["--file", str(tmp_path / "boards/bench.toml")]
    asked = CliRunner().invoke(cli.app, ["init", *file])
    assert isinstance(asked.exception, InventoryError)
    assert "hil bench init --leader 2" in asked.exception.mend
    done = CliRunner().invoke(cli.app, ["init", "--leader", "2", *file])
    assert done.exit_code == 0, done.output
    assert "├──────┤ D0           D3 ├──────┤" in done.output
    bench = inventory.load(tmp_path / "boards/bench.toml")
    assert (bench.boards["leader"].probe, bench.boards["follower"].probe) == ("2", "1")
    assert bench.analyser is not None
    # The second board's ports have other interface numbers; its firmware speaks on the lower.
    assert (bench.boards["leader"].vcom, bench.boards["follower"].vcom) == (2, 0)
    # Its place on USB changes with each replug, and there is only one.
    assert bench.analyser.driver == "fx2lafw"


def test_recover_asks_before_it_erases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner  # noqa: PLC0415

    from hil.bench import cli, flash  # noqa: PLC0415

    _, *probes = bench_of_fakes(tmp_path)
    path = tmp_path / "bench.toml"
    setup.write(path, setup.text(("1", "2")))

    def pair(bench: Inventory) -> BoardPair:
        return BoardPair(bench, FakeRunner(*probes))

    monkeypatch.setattr(flash, "BoardPair", pair)
    said = CliRunner().invoke(cli.app, ["recover", "leader", "--file", str(path)], input="n\n")
    assert said.exit_code == 1
    assert "recover" not in probes[0].log
    said = CliRunner().invoke(cli.app, ["recover", "leader", "--file", str(path)], input="y\n")
    assert said.exit_code == 0, said.output
    assert (probes[0].log, probes[1].log) == (["recover"], [])


def test_flash_writes_proves_and_starts_both_boards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from typer.testing import CliRunner  # noqa: PLC0415

    from hil import build  # noqa: PLC0415
    from hil.bench import cli, flash  # noqa: PLC0415

    _, *probes = bench_of_fakes(tmp_path)
    path = tmp_path / "bench.toml"
    setup.write(path, setup.text(("1", "2")))
    built = {role: images.built(tmp_path / role, role, seed=n) for n, role in enumerate(ROLES)}
    monkeypatch.setattr(build, "build_images", lambda kconfig, target, workspace: built)
    monkeypatch.setattr(flash, "BoardPair", lambda bench: BoardPair(bench, FakeRunner(*probes)))
    first = CliRunner().invoke(cli.app, ["flash", "--file", str(path)])
    assert first.exit_code == 0, first.output
    assert f"leader: written and verified: {images.SIZE} bytes, build" in first.output
    for n, probe in enumerate(probes):
        assert bytes(probe.chip.flash[: images.SIZE]) == images.content(n)
        assert probe.log[-1] == "reset system"
        assert probe.chip.running
    again = CliRunner().invoke(cli.app, ["flash", "--file", str(path)])
    assert "follower: already there, verified" in again.output
    assert [probe.log.count("program") for probe in probes] == [1, 1]
