# SPDX-License-Identifier: Apache-2.0
"""Every runner: the whole command line of each operation, and what becomes of each answer."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hil.bench.errors import NoRunnerError, ProbeLostError
from hil.bench.probes import ChipInfo, Protection, choose, read_chip, usb
from hil.bench.probes.jlink import JlinkRunner
from hil.bench.probes.nrfjprog import NrfjprogRunner
from hil.bench.probes.nrfutil import NrfutilRunner
from hil.bench.probes.openocd import OpenocdRunner
from hil.bench.probes.pyocd import PyocdRunner
from tests.bench.fakes import images, nrfjprog
from tests.bench.fakes.chip import FakeChip, FakeProbe, FakeRunner
from tests.bench.fakes.programs import Programs, programs_on_path

SERIAL = "683000001"
SCRATCH = re.compile(r"/\S*/hil-probe-[^/\s\"]+")


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Programs:
    return programs_on_path(tmp_path / "bin", monkeypatch)


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "my image.hex"
    images.write_hex(path, images.content())
    return path


def calls(programs: Programs) -> list[str]:
    """The calls in full, arguments apart by ``|``, temporary folders as TMP."""
    found = ["|".join(SCRATCH.sub("TMP", part) for part in call) for call in programs.calls()]
    programs.forget()
    return found


# nrfutil


@pytest.fixture
def nrfutil(programs: Programs) -> Programs:
    programs.install("nrfutil")
    return programs


def test_nrfutil_command_lines(nrfutil: Programs, image: Path) -> None:
    probe = NrfutilRunner().open(SERIAL)
    begin = "nrfutil|--json|--skip-overhead|device"
    end = f"--serial-number|{SERIAL}"
    probe.program(image)
    options = "chip_erase_mode=ERASE_RANGES_TOUCHED_BY_FIRMWARE,verify=VERIFY_NONE,reset=RESET_NONE"
    assert calls(nrfutil) == [f"{begin}|program|--firmware|{image}|--options|{options}|{end}"]
    probe.erase()
    assert calls(nrfutil) == [f"{begin}|erase|--all|{end}"]
    probe.reset()
    probe.reset("pin")
    assert calls(nrfutil) == [
        f"{begin}|reset|--reset-kind|RESET_SYSTEM|{end}",
        f"{begin}|reset|--reset-kind|RESET_PIN|{end}",
    ]
    probe.recover()
    assert calls(nrfutil) == [f"{begin}|recover|{end}"]


def test_nrfutil_reads_memory_through_a_hex_file(nrfutil: Programs, tmp_path: Path) -> None:
    images.write_hex(tmp_path / "answer.hex", bytes(range(20)), 0x10000100)
    nrfutil.answer(
        "nrfutil", r"--to-file (\S+)", "{}", write=(tmp_path / "answer.hex").read_bytes()
    )
    probe = NrfutilRunner().open(SERIAL)
    assert probe.read_memory(0x10000100, 20) == bytes(range(20))
    assert calls(nrfutil) == [
        "nrfutil|--json|--skip-overhead|device|read|--address|0x10000100|--bytes|20"
        f"|--to-file|TMP/memory.hex|--serial-number|{SERIAL}"
    ]
    with pytest.raises(ProbeLostError, match="no 21 bytes"):
        probe.read_memory(0x10000100, 21)


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        ("NRFDL_PROTECTION_STATUS_NONE", Protection.OFF),
        ("NRFDL_PROTECTION_STATUS_ALL", Protection.ON),
        ("NRFDL_PROTECTION_STATUS_REGION0", Protection.ON),
    ],
)
def test_nrfutil_protection(nrfutil: Programs, status: str, expected: Protection) -> None:
    answer = {"devices": [{"serialNumber": "000683000001", "protectionStatus": status}]}
    nrfutil.answer("nrfutil", "protection-get", json.dumps(answer))
    assert NrfutilRunner().open(SERIAL).protection() is expected
    assert calls(nrfutil) == [
        f"nrfutil|--json|--skip-overhead|device|protection-get|--serial-number|{SERIAL}"
    ]


def test_nrfutil_lists_only_debug_probes_without_leading_zeros(nrfutil: Programs) -> None:
    devices = [
        {"serialNumber": "000683000001", "traits": {"jlink": True}},
        {"serialNumber": "E3A1", "traits": {"nordicDfu": True}},
        {"serialNumber": None, "traits": {"jlink": True}},
        {"serialNumber": "001050000002", "traits": {"jlink": True, "usb": True}},
    ]
    nrfutil.answer("nrfutil", "device list", json.dumps({"devices": devices}, indent=2))
    assert NrfutilRunner().serials() == ["1050000002", "683000001"]
    assert calls(nrfutil) == ["nrfutil|--json|--skip-overhead|device|list"]


def test_nrfutil_of_pypi_is_told_apart(nrfutil: Programs) -> None:
    nrfutil.answer("nrfutil", "device", "Error: No such command 'device'.\n", status=2)
    found = NrfutilRunner().readiness()
    assert not found.ready
    assert "PyPI" in found.problem
    assert "pip uninstall nrfutil" in found.mend


def test_nrfutil_without_its_device_command(nrfutil: Programs) -> None:
    nrfutil.answer("nrfutil", "device", "Subcommand nrfutil-device not found.\n", status=1)
    assert NrfutilRunner().readiness().mend == "nrfutil install device"


@pytest.mark.parametrize("answer", ["", "[]", "null", '{"devices": {"a": 1}}', "[" * 100_000])
def test_nrfutil_that_answers_nonsense_never_says_that_a_chip_is_open(
    nrfutil: Programs, answer: str
) -> None:
    nrfutil.answer("nrfutil", "protection-get", answer)
    with pytest.raises(ProbeLostError):
        NrfutilRunner().open(SERIAL).protection()


# JLinkExe


@pytest.fixture
def jlink(programs: Programs) -> Programs:
    programs.install("JLinkExe")
    return programs


CONNECTED = (
    f"JLinkExe|-NoGui|1|-ExitOnError|1|-USB|{SERIAL}|-Device|nRF52840_xxAA|-If|SWD|-Speed|4000"
    "|-AutoConnect|1|-CommandFile|TMP/commands.jlink"
)


def commands(programs: Programs) -> list[str]:
    """Lines of the last command file."""
    return [SCRATCH.sub("TMP", line) for line in programs.texts()[-1].splitlines()[1:]]


def test_jlink_command_lines(jlink: Programs, image: Path) -> None:
    probe = JlinkRunner().open(SERIAL)
    probe.program(image)
    assert commands(jlink) == ["r", "h", 'LoadFile "TMP/image.hex"', "Exit"]
    probe.erase()
    assert commands(jlink) == ["r", "h", "erase", "Exit"]
    probe.reset()
    assert commands(jlink) == ["RSetType 0", "r", "g", "Exit"]
    probe.reset("pin")
    assert commands(jlink) == ["RSetType 2", "r", "g", "Exit"]
    assert calls(jlink) == [CONNECTED] * 4


def test_jlink_reads_memory_through_a_file(jlink: Programs) -> None:
    jlink.answer("JLinkExe", r'SaveBin "(\S+)"', write=b"12345678")
    probe = JlinkRunner().open(SERIAL)
    assert probe.read_memory(0x10000060, 8) == b"12345678"
    assert commands(jlink) == ['SaveBin "TMP/memory.bin", 0x10000060, 0x8', "Exit"]
    assert calls(jlink) == [CONNECTED]
    with pytest.raises(ProbeLostError, match="8 bytes of the 9"):
        probe.read_memory(0x10000060, 9)


@pytest.mark.parametrize(
    ("value", "expected"), [("0x00000001", Protection.OFF), ("0x00000000", Protection.ON)]
)
def test_jlink_reads_the_protection_without_connecting_to_the_core(
    jlink: Programs, value: str, expected: Protection
) -> None:
    said = f"Read AP register 3 = 0xFFFFFFFF\nRead DP register 3 = {value}\n"
    jlink.answer("JLinkExe", "SWDReadDP 3", said)
    assert JlinkRunner().open(SERIAL).protection() is expected
    assert commands(jlink) == [
        "SWDSelect",
        "SWDWriteDP 1 0x50000000",
        "SWDWriteDP 2 0x01000000",
        "SWDReadAP 3",
        "SWDReadDP 3",
        "Exit",
    ]
    (call,) = calls(jlink)
    assert call == (
        f"JLinkExe|-NoGui|1|-ExitOnError|1|-USB|{SERIAL}|-If|SWD|-Speed|4000"
        "|-CommandFile|TMP/commands.jlink"
    )


def test_jlink_that_says_nothing_of_the_protection_is_an_error(jlink: Programs) -> None:
    with pytest.raises(ProbeLostError, match="did not say"):
        JlinkRunner().open(SERIAL).protection()


def test_jlink_recovers_through_ctrl_ap_then_keeps_the_port_open(jlink: Programs) -> None:
    JlinkRunner().open(SERIAL).recover()
    first, second = (text.splitlines()[1:] for text in jlink.texts())
    assert "SWDWriteAP 1 0x00000001" in first
    assert second == [
        "h",
        "w4 0x4001E504 1",
        "w4 0x10001208 0x0000005A",
        "w4 0x4001E504 0",
        "Exit",
    ]


def test_jlink_lists_probes(jlink: Programs) -> None:
    jlink.answer(
        "JLinkExe",
        "ShowEmuList",
        "J-Link[0]: Connection: USB, Serial number: 683000001, ProductName: J-Link OB\n"
        "J-Link[1]: Connection: USB, Serial number: 1050000002, ProductName: J-Link OB\n",
    )
    assert JlinkRunner().serials() == ["1050000002", "683000001"]


def test_jlink_without_a_probe_is_ready_all_the_same(jlink: Programs) -> None:
    said = "SEGGER J-Link Commander V7.94e (Compiled Jan 15 2024)\nConnecting via USB...FAILED\n"
    jlink.answer("JLinkExe", "CommandFile", said, status=1)
    assert JlinkRunner().readiness().version == "J-Link Commander V7.94e"
    assert JlinkRunner().serials() == []


def test_a_jlinkexe_that_is_another_program_is_not_ready(jlink: Programs) -> None:
    assert "does not say which version" in JlinkRunner().readiness().problem


def test_jlink_failure_with_exit_status_0_is_an_error(jlink: Programs, image: Path) -> None:
    jlink.answer("JLinkExe", "LoadFile", "Cannot connect to target.\n")
    with pytest.raises(ProbeLostError, match="Cannot connect to target"):
        JlinkRunner().open(SERIAL).program(image)


# OpenOCD


@pytest.fixture
def openocd(programs: Programs) -> Programs:
    programs.install("openocd")
    return programs


def openocd_call(*arguments: str, adapter: str = "jlink", serial: str = SERIAL) -> str:
    fixed = (
        f"openocd|-f|interface/{adapter}.cfg|-c|transport select swd|-c|adapter serial {serial}"
        "|-f|target/nrf52.cfg|-c|gdb_port disabled|-c|tcl_port disabled|-c|telnet_port disabled"
    )
    return "|-c|".join((fixed, *arguments, "shutdown"))


def test_openocd_command_lines(openocd: Programs, image: Path) -> None:
    probe = OpenocdRunner().open(SERIAL)
    probe.program(image)
    probe.erase()
    probe.reset()
    probe.reset("pin")
    probe.recover()
    assert calls(openocd) == [
        openocd_call("init", "reset halt", "flash write_image erase TMP/image.hex 0 ihex"),
        openocd_call("init", "reset halt", "nrf5 mass_erase"),
        openocd_call("init", "reset run"),
        openocd_call("reset_config srst_only", "init", "reset run"),
        openocd_call(
            *("init", "nrf52_recover", "halt"),
            *("mww 0x4001e504 1", "mww 0x10001208 0x0000005a", "mww 0x4001e504 0"),
        ),
    ]


def test_openocd_drives_other_probes_through_cmsis_dap(openocd: Programs) -> None:
    OpenocdRunner().open("0220E66A").reset()
    assert calls(openocd) == [
        openocd_call("init", "reset run", adapter="cmsis-dap", serial="0220E66A")
    ]


def test_openocd_reads_memory_through_a_file(openocd: Programs) -> None:
    openocd.answer("openocd", r"dump_image (\S+)", write=b"12345678")
    assert OpenocdRunner().open(SERIAL).read_memory(0x60, 8) == b"12345678"
    assert calls(openocd) == [openocd_call("init", "dump_image TMP/memory.bin 0x00000060 8")]


@pytest.mark.parametrize(
    ("value", "expected"),
    [("0x1", Protection.OFF), ("1", Protection.OFF), ("0x00000000", Protection.ON)],
)
def test_openocd_protection(openocd: Programs, value: str, expected: Protection) -> None:
    openocd.answer("openocd", "apreg", f"Info : ready\napprotectstatus {value}\n")
    assert OpenocdRunner().open(SERIAL).protection() is expected
    assert calls(openocd) == [
        openocd_call("init", 'echo "approtectstatus [nrf52.dap apreg 1 0x0c]"')
    ]


def test_openocd_failure_shows_its_own_last_words(openocd: Programs, image: Path) -> None:
    openocd.answer("openocd", "init", "Error: No J-Link device found\n", status=1)
    with pytest.raises(ProbeLostError, match="Error: No J-Link device found"):
        OpenocdRunner().open(SERIAL).program(image)


# pyOCD


@pytest.fixture
def pyocd(programs: Programs) -> Programs:
    programs.install("pyocd")
    return programs


def pyocd_call(command: str, *arguments: str, unlock: str = "false") -> str:
    fixed = (
        f"pyocd|{command}|--no-wait|--no-config|--uid|{SERIAL}|--target|nrf52840"
        f"|-O|auto_unlock={unlock}|-O|resume_on_disconnect=false"
    )
    return "|".join((fixed, *arguments))


def test_pyocd_command_lines(pyocd: Programs, image: Path) -> None:
    probe = PyocdRunner().open(SERIAL)
    probe.program(image)
    probe.erase()
    probe.reset()
    probe.reset("pin")
    probe.recover()
    load = ("--connect", "halt", "--no-reset", "--erase", "sector", "--format", "hex", str(image))
    assert calls(pyocd) == [
        pyocd_call("load", *load),
        pyocd_call("erase", "--chip"),
        pyocd_call("reset", "--method", "sysresetreq"),
        pyocd_call("reset", "--method", "hw"),
        pyocd_call("erase", "--mass", unlock="true"),
        pyocd_call("commander", "--command", "status", unlock="true"),
    ]


def test_pyocd_reads_memory_of_a_running_core(pyocd: Programs) -> None:
    pyocd.answer("pyocd", r"savemem \S+ \S+ (\S+)", write=b"12345678")
    assert PyocdRunner().open(SERIAL).read_memory(0x10000060, 8) == b"12345678"
    save = "savemem 0x10000060 8 TMP/memory.bin"
    assert calls(pyocd) == [pyocd_call("commander", "--connect", "attach", "--command", save)]


@pytest.mark.parametrize(
    ("value", "expected"), [("0x00000001", Protection.OFF), ("0x00000000", Protection.ON)]
)
def test_pyocd_protection(pyocd: Programs, value: str, expected: Protection) -> None:
    pyocd.answer("pyocd", "readap", f"AP register 0x100000c = {value}\n")
    assert PyocdRunner().open(SERIAL).protection() is expected
    arguments = ("--no-init", "--command", "initdp", "--command", "readap 1 0x0c")
    assert calls(pyocd) == [pyocd_call("commander", *arguments)]


def test_pyocd_lists_probes(pyocd: Programs) -> None:
    boards = [{"unique_id": "683000001"}, {"unique_id": "0240000034544e45"}]
    pyocd.answer("pyocd", "json", json.dumps({"status": 0, "boards": boards}, indent=4))
    assert PyocdRunner().serials() == ["0240000034544e45", "683000001"]
    assert calls(pyocd) == ["pyocd|json|--probes|--no-config"]


@pytest.mark.parametrize("answer", ["", "{}", '{"boards": 1}', '{"boards": [1]}', "[" * 99_999])
def test_pyocd_that_answers_nonsense_is_an_error(pyocd: Programs, answer: str) -> None:
    pyocd.answer("pyocd", "json", answer)
    with pytest.raises(ProbeLostError, match="no list of probes"):
        PyocdRunner().serials()


# pynrfjprog


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> nrfjprog.Rig:
    return nrfjprog.install(monkeypatch)


def test_nrfjprog_calls(module: nrfjprog.Rig, image: Path) -> None:
    probe = NrfjprogRunner().open(SERIAL)
    probe.program(image)
    probe.erase()
    probe.reset()
    probe.reset("pin")
    probe.recover()
    options = {"verify": 0, "erase_action": 2, "qspi_erase_action": 0, "reset": 0}
    assert module.calls == [
        ("program", 683000001, str(image), options),
        ("erase", 683000001, "ERASE_ALL"),
        ("reset", 683000001, "RESET_SYSTEM"),
        ("reset", 683000001, "RESET_PIN"),
        ("recover", 683000001),
    ]
    assert module.open_probes == 0


@pytest.mark.parametrize(("status", "expected"), [(0, Protection.OFF), (2, Protection.ON)])
def test_nrfjprog_protection(module: nrfjprog.Rig, status: int, expected: Protection) -> None:
    module.protection = status
    assert NrfjprogRunner().open(SERIAL).protection() is expected


def test_nrfjprog_reads_four_bytes_as_bytes_too(module: nrfjprog.Rig) -> None:
    module.memory = {0x20: bytes(range(16))}
    probe = NrfjprogRunner().open(SERIAL)
    assert probe.read_memory(0x20, 4) == b"\0\1\2\3"
    assert probe.read_memory(0x20, 16) == bytes(range(16))


def test_nrfjprog_lists_probes(module: nrfjprog.Rig) -> None:
    assert NrfjprogRunner().serials() == ["683000001", "683000002"]
    assert NrfjprogRunner().readiness().version == "pynrfjprog 10.24.2"


def test_nrfjprog_without_a_jlink_library_is_not_taken_for_no_boards(module: nrfjprog.Rig) -> None:
    module.library = False
    found = NrfjprogRunner().readiness()
    assert not found.ready
    assert "J-Link library" in found.problem
    assert "segger.com" in found.mend


def test_nrfjprog_with_a_library_and_no_boards_is_ready(module: nrfjprog.Rig) -> None:
    module.serials = []
    runner = NrfjprogRunner()
    assert runner.readiness().ready
    assert runner.serials() == []


def test_nrfjprog_that_loses_the_library_later_says_so(module: nrfjprog.Rig) -> None:
    module.library = False
    with pytest.raises(ProbeLostError, match=r"no J-Link library \(error -101\)"):
        NrfjprogRunner().open(SERIAL).protection()


def test_nrfjprog_error_names_the_probe_and_shows_the_librarys_words(
    module: nrfjprog.Rig,
) -> None:
    module.fails = -11
    with pytest.raises(ProbeLostError, match=r"probe 683000001: .* DLL: -11"):
        NrfjprogRunner().open(SERIAL).reset()
    assert module.open_probes == 0


def test_nrfjprog_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys  # noqa: PLC0415

    monkeypatch.setitem(sys.modules, "pynrfjprog", None)
    assert NrfjprogRunner().readiness().mend == "pip install pynrfjprog"


# Choosing


def test_the_first_ready_runner_is_taken() -> None:
    first, second = FakeRunner(name="a", problem="broken"), FakeRunner(name="b")
    assert choose("", [first, second, FakeRunner(name="c")]) is second


def test_a_runner_that_the_bench_file_names_is_never_replaced() -> None:
    with pytest.raises(NoRunnerError, match="asks for 'a', but broken"):
        choose("a", [FakeRunner(name="a", problem="broken"), FakeRunner(name="b")])


def test_without_any_runner_each_ones_reason_is_told(programs: Programs) -> None:
    with pytest.raises(NoRunnerError) as caught:
        choose("", [JlinkRunner(), OpenocdRunner(), PyocdRunner(), NrfutilRunner()])
    for name in ("JLinkExe", "openocd", "pyocd", "nrfutil"):
        assert f"{name} is not installed" in caught.value.message
    assert "apt-get install openocd" in caught.value.mend


def test_a_chips_identity_is_read_from_ficr() -> None:
    """Words as nRF52840 PS v1.7 section 4.4 lays them out; VARIANT 0x41414430 is 'AAD0'."""
    probe = FakeProbe("1", FakeChip((0x11223344, 0x55667788)))
    assert read_chip(probe) == ChipInfo(0x5566778811223344, 0x52840, "AAD0", 256, 1024)


def test_probes_are_found_on_usb_without_any_program(tmp_path: Path) -> None:
    def device(name: str, **attributes: str) -> None:
        folder = tmp_path / "sys" / name
        folder.mkdir(parents=True)
        for key, value in attributes.items():
            (folder / key).write_text(value + "\n")

    common = {"busnum": "1", "devnum": "7"}
    device("1-1", idVendor="1366", serial="000683000001", product="J-Link", **common)
    device("1-1:1.0", bInterfaceClass="02")
    device("1-2", idVendor="046d", serial="123", product="Mouse", **common)
    device("1-3", idVendor="0d28", serial="0240ab", product="BBC CMSIS-DAP", **common)
    found = usb.find_probes(tmp_path / "sys", tmp_path / "dev")
    assert [probe.serial for probe in found] == ["0240ab", "683000001"]
    assert found[1].device == tmp_path / "dev/001/007"
    assert not found[1].writable
    found[1].device.parent.mkdir(parents=True)
    found[1].device.touch()
    assert found[1].writable
