# SPDX-License-Identifier: Apache-2.0
"""The bench file: what it may say, and how each mistake is told, with file, line and key."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hil.bench import inventory, pins, setup, wiring
from hil.bench.errors import InventoryError, ProbeMissingError
from hil.bench.inventory import Board, Signal, normal_serial

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "boards" / "bench.example.toml"

GOOD = """\
format = 1

[boards.leader]
probe = "000683000001"
vcom = 2
device_id = "0x0123456789abcdef"

[boards.follower]
probe = 1050000002

[analyser]
kind = "sigrok"
driver = "fx2lafw"
samplerate_hz = 8_000_000

[analyser.channels]
D0 = "leader.radio_end"
D1 = "follower.P1.02"
D2 = "follower.d2"

[[wires]]
from = "leader.pulse"
to = "follower.pulse_in"

[probes]
runner = "openocd"

[labgrid]
place = "desk"
"""


def wrong(old: str, new: str) -> InventoryError:
    assert GOOD.count(old) >= 1
    with pytest.raises(InventoryError) as caught:
        inventory.parse(GOOD.replace(old, new, 1), Path("b.toml"))
    return caught.value


def test_a_whole_bench_file_is_read() -> None:
    bench = inventory.parse(GOOD, Path("b.toml"))
    assert bench.boards == {
        "leader": Board("leader", "683000001", 2, 0x0123456789ABCDEF),
        "follower": Board("follower", "1050000002", 0, None),
    }
    assert bench.runner == "openocd"
    assert bench.place == inventory.Place("desk", "labgrid-client")
    assert bench.analyser is not None
    assert dict(bench.analyser.channels) == {
        "D0": Signal("leader", "radio_end"),
        "D1": Signal("follower", "radio_end"),
        "D2": Signal("follower", "pulse"),
    }
    assert [(str(w.start), str(w.end)) for w in bench.wires] == [
        ("leader.pulse", "follower.pulse_in")
    ]


def test_the_example_is_a_whole_bench() -> None:
    bench = inventory.load(EXAMPLE)
    assert wiring.advice(bench) == ["every signal that the checks use is wired"]
    assert len(bench.wires) == 2


def test_the_examples_commented_lines_are_right_too() -> None:
    text = EXAMPLE.read_text()
    text = re.sub(r"^# (\[probes\]|\[labgrid\]|\w+ = \S+)", r"\1", text, flags=re.MULTILINE)
    bench = inventory.parse(text, Path("b.toml"))
    assert bench.runner == "openocd"
    assert bench.place is not None
    assert bench.place.client.endswith("labgrid-client")
    assert bench.boards["leader"].device_id == 0x0123456789ABCDEF


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "said"),
    [
        ("probe = 1050000002", 'probe = "683000001"', 9, "boards.follower.probe", "both roles"),
        ("vcom = 2", 'vcom = "COM3"', 5, "boards.leader.vcom", "whole number"),
        ("vcom = 2", "vcom = 99", 5, "boards.leader.vcom", "from 0 to 15"),
        ("vcom = 2", "vcom = true", 5, "boards.leader.vcom", "whole number"),
        ("vcom", "vcmo", 5, "boards.leader.vcmo", "did you mean 'vcom'?"),
        ("[boards.follower]", "[boards.folower]", 8, "boards.folower", "did you mean 'follower'"),
        ("probe = 1050000002", "", 8, "boards.follower", "'probe' is missing"),
        ('"000683000001"', '"68 3"', 4, "boards.leader.probe", "no serial number"),
        ('"000683000001"', "6.8", 4, "boards.leader.probe", "serial number is needed"),
        ("0x0123456789abcdef", "0x12", 6, "boards.leader.device_id", "no FICR DEVICEID"),
        ("follower.P1.02", "follower.P1.07", 18, "analyser.channels.D1", "no pin of the map"),
        ("follower.P1.02", "folower.pulse", 18, "analyser.channels.D1", "mean 'follower'?"),
        ("follower.P1.02", "follower.puls", 18, "analyser.channels.D1", "mean 'pulse'?"),
        ("follower.d2", "leader.D1", 19, "analyser.channels.D2", "on channel D0 already"),
        ('"follower.d2"', "3", 19, "analyser.channels.D2", "a signal is needed"),
        ("8_000_000", "0", 14, "analyser.samplerate_hz", "whole number"),
        ('kind = "sigrok"', 'kind = "sirgok"', 12, "analyser.kind", "did you mean 'sigrok'?"),
        ('driver = "fx2lafw"', "", 11, "analyser.driver", "name of a driver"),
        ('"follower.pulse_in"', '"leader.pulse_in"', 23, "wires.to", "tells nothing"),
        ('"leader.pulse"', '"leader.pulse_in"', 23, "wires.to", "tells nothing"),
        ('from = "leader', 'form = "leader', 22, "wires.form", "did you mean 'from'?"),
        ('runner = "openocd"', 'runner = "opencd"', 26, "probes.runner", "mean 'openocd'?"),
        ('place = "desk"', 'place = "-x"', 29, "labgrid.place", "no name of a place"),
        ("format = 1", "format = 2", 1, "format", "write format = 1"),
        ("[probes]", "[prob]", 25, "prob", "did you mean 'probes'?"),
    ],
)
def test_each_mistake_is_told_with_its_line_and_key(
    old: str, new: str, line: int, key: str, said: str
) -> None:
    error = wrong(old, new)
    assert f"b.toml:{line}: {key}: " in error.message
    assert said in str(error)
    assert error.mend


def test_two_wires_to_one_pin_are_told_with_the_second_ones_line() -> None:
    second = '\n[[wires]]\nfrom = "leader.radio_end"\nto = "follower.pulse_in"\n'
    with pytest.raises(InventoryError, match=r"two wires drive follower\.pulse_in"):
        inventory.parse(GOOD + second, Path("b.toml"))


def test_the_same_chip_for_both_roles_is_refused() -> None:
    new = 'probe = 1050000002\ndevice_id = "0x0123456789ABCDEF"'
    assert "named for both roles" in wrong("probe = 1050000002", new).message


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(InventoryError, match="hil bench init"):
        inventory.load(tmp_path / "bench.toml")


def test_what_is_no_toml_is_told_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(InventoryError, match=r"is not TOML: .*line 2"):
        inventory.parse("format = 1\n= 3\n", Path("b.toml"))


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a = " + b"[" * 60_000, b"#" * 100_000])
def test_hostile_files_are_one_clear_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "b.toml").write_bytes(content)
    with pytest.raises(InventoryError, match=r"b\.toml"):
        inventory.load(tmp_path / "b.toml")


@pytest.mark.parametrize("line", ["[" + " " * 60_000, "a" * 60_000, "'" * 4 + " " * 60_000])
def test_finding_the_line_takes_no_time_whatever_the_text(line: str) -> None:
    import time  # noqa: PLC0415

    text = f'{GOOD}client = """\n{line}\n"""\n[zzz]\n'
    start_s = time.monotonic()
    with pytest.raises(InventoryError, match="unknown key 'zzz'"):
        inventory.parse(text, Path("b.toml"))
    assert time.monotonic() - start_s < 2


@pytest.mark.parametrize("old", ["[boards.leader]", "format = 1", "[analyser.channels]"])
@pytest.mark.parametrize("new", ["", "boards = 3", "[[boards]]", "analyser = []"])
def test_any_structure_that_is_not_a_bench_is_an_inventory_error(old: str, new: str) -> None:
    assert wrong(old, new).message.startswith("b.toml")


@pytest.mark.parametrize(
    ("written", "normal"),
    [("000683298616", "683298616"), (683298616, "683298616"), ("0240AB", "0240AB"), ("000", "0")],
)
def test_serial_numbers_are_compared_without_usbs_padding(written: str | int, normal: str) -> None:
    assert normal_serial(written) == normal


# The pin map


def test_the_pin_map_is_that_of_the_boards_folder() -> None:
    """boards/README.md and pins.dtsi are what the firmware is built from."""
    table = (ROOT / "boards/README.md").read_text()
    rows = re.findall(r"^\| ([a-zA-Z0-9 ]+) \| (P1\.\d\d) \| (D\d) \| (out|in)", table, re.M)
    documented = {pin: (header, way) for _, pin, header, way in rows}
    for pin in pins.PINS.values():
        assert documented[pin.pin] == (pin.header, "out" if pin.is_output else "in")
    dtsi = (ROOT / "boards/pins.dtsi").read_text()
    for name in ("radio_end", "pulse", "pulse_in"):
        found = re.search(rf"\t{name.replace('_', '-')}-gpios = <&gpio1 (\d+) ", dtsi)
        assert found is not None
        assert pins.PINS[name].pin == f"P1.{int(found[1]):02d}"


# Drawing


def test_every_channel_and_wire_is_in_the_drawing() -> None:
    lines = wiring.draw(inventory.load(EXAMPLE))
    text = "\n".join(lines)
    assert max(map(len, lines)) <= 78
    for leader, follower, name, pin in (
        ("D0", "D3", "radio_end", "P1.02"),
        ("D1", "D4", "pulse", "P1.03"),
        ("D2", "D5", "imu_int1", "P1.05"),
    ):
        row = rf"{pin}  {name} +├─+┤ {leader} +{follower} ├─+┤ +{name}  {pin}"
        assert re.search(row, text), row
    assert re.search(r"leader +P1\.03  pulse +─+▶ P1\.04  pulse_in +follower", text)
    assert re.search(r"follower +P1\.03  pulse +─+▶ P1\.04  pulse_in +leader", text)


def test_boxes_of_the_drawing_are_straight() -> None:
    drawn = wiring.draw(inventory.load(EXAMPLE))
    lines = [line for line in drawn if line.startswith(("  ┌", "  │", "  └"))]
    assert len(lines) == 6
    assert len({len(line) for line in lines}) == 1


def test_the_drawing_can_do_without_special_characters() -> None:
    "\n".join(wiring.draw(inventory.load(EXAMPLE), ascii_only=True)).encode("ascii")


def test_what_is_not_wired_is_said() -> None:
    bench = inventory.parse(GOOD, Path("b.toml"))
    (said,) = wiring.advice(bench)
    assert said.startswith("not on the analyser: leader.pulse, leader.imu_int1, follower.imu_int1;")
    bare = inventory.parse(GOOD[: GOOD.index("[analyser]")], Path("b.toml"))
    assert "no analyser, and not both pulse wires" in wiring.advice(bare)[0]


# A new bench file


def test_a_new_file_with_an_analyser_is_complete() -> None:
    bench = inventory.parse(setup.text(("1", "2"), driver="fx2lafw:conn=1.7"), Path("b.toml"))
    assert (bench.boards["leader"].probe, bench.boards["follower"].probe) == ("1", "2")
    assert bench.analyser is not None
    assert bench.analyser.driver == "fx2lafw:conn=1.7"
    assert wiring.advice(bench) == ["every signal that the checks use is wired"]


def test_a_new_file_without_an_analyser_has_the_pulse_wires() -> None:
    bench = inventory.parse(setup.text(("1", "2")), Path("b.toml"))
    assert bench.analyser is None
    assert wiring.advice(bench) == ["every signal that the checks use is wired"]


def test_a_file_is_never_written_over_without_force(tmp_path: Path) -> None:
    path = tmp_path / "boards" / "bench.toml"
    setup.write(path, setup.text(("1", "2")))
    with pytest.raises(InventoryError, match="already"):
        setup.write(path, setup.text(("3", "4")))
    assert inventory.load(path).boards["leader"].probe == "1"
    setup.write(path, setup.text(("3", "4")), force=True)
    assert inventory.load(path).boards["leader"].probe == "3"
    assert [p.name for p in path.parent.iterdir()] == ["bench.toml"]


def test_a_text_that_is_no_bench_is_never_written(tmp_path: Path) -> None:
    with pytest.raises(InventoryError):
        setup.write(tmp_path / "b.toml", "format = 7")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("probes", "leader", "follower", "expected"),
    [
        (["1", "2"], "", "", None),
        (["1", "2"], "2", "", ("2", "1")),
        (["1", "2"], "", "0002", ("1", "2")),
        (["1", "2", "3"], "3", "1", ("3", "1")),
    ],
)
def test_roles_are_given_out(
    probes: list[str], leader: str, follower: str, expected: tuple[str, str] | None
) -> None:
    assert setup.roles(probes, leader, follower) == expected


@pytest.mark.parametrize(
    ("probes", "leader", "said"),
    [
        ([], "", "no debug probe is connected"),
        (["7"], "", "only one debug probe is connected (7)"),
        (["1", "2", "3"], "", "3 debug probes are connected: 1, 2, 3"),
        (["1", "2", "3"], "1", "--leader SERIAL --follower SERIAL"),
        (["1", "2"], "9", "probe 9 (--leader) is not connected; connected: 1, 2"),
    ],
)
def test_too_few_and_too_many_probes_are_explained(
    probes: list[str], leader: str, said: str
) -> None:
    with pytest.raises((InventoryError, ProbeMissingError)) as caught:
        setup.roles(probes, leader, "")
    assert said in str(caught.value)
    assert caught.value.mend
