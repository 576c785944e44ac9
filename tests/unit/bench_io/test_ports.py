# SPDX-License-Identifier: Apache-2.0
"""Telling serial ports apart by serial number and interface."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from hil.bench.ports import JLINK_VID, PortInfo, find_ports, usb_ports, vcom
from hil.errors import RigError


def listed(device: str, serial: str | None, location: str | None, vid: int | None) -> Any:
    return SimpleNamespace(
        device=device, serial_number=serial, location=location, vid=vid, pid=vid and 0x1051
    )


TWO_DKS = [
    listed("/dev/ttyACM3", "000683459357", "1-2.3:1.2", JLINK_VID),
    listed("/dev/ttyACM0", "001050245678", "1-2.4:1.0", JLINK_VID),
    listed("/dev/ttyACM2", "000683459357", "1-2.3:1.0", JLINK_VID),
    listed("/dev/ttyUSB0", None, "1-5", 0x0403),
    listed("/dev/ttyS0", None, None, None),
    listed("/dev/ttyACM1", "001050245678", "1-2.4:1.2", JLINK_VID),
]


def test_ports_without_usb_are_left_out_and_interfaces_are_read() -> None:
    assert usb_ports(TWO_DKS) == [
        PortInfo("/dev/ttyACM0", "001050245678", 0, JLINK_VID, 0x1051),
        PortInfo("/dev/ttyACM1", "001050245678", 2, JLINK_VID, 0x1051),
        PortInfo("/dev/ttyACM2", "000683459357", 0, JLINK_VID, 0x1051),
        PortInfo("/dev/ttyACM3", "000683459357", 2, JLINK_VID, 0x1051),
        PortInfo("/dev/ttyUSB0", "", 0, 0x0403, 0x1051),
    ]


@pytest.mark.parametrize(
    ("serial", "interface", "path"),
    [
        ("683459357", 2, "/dev/ttyACM3"),
        ("000683459357", 0, "/dev/ttyACM2"),
        ("1050245678", 0, "/dev/ttyACM0"),
    ],
)
def test_a_port_by_serial_number_and_interface(serial: str, interface: int, path: str) -> None:
    assert vcom(serial, interface, usb_ports(TWO_DKS)) == path


def test_what_is_not_there_is_answered_with_what_is() -> None:
    ports = usb_ports(TWO_DKS)
    with pytest.raises(RigError, match="no serial port of the debugger 683") as caught:
        vcom("683000000", 0, ports)
    for port in ports:
        assert str(port) in caught.value.mend
    with pytest.raises(RigError, match="at interface 1") as caught:
        vcom("683459357", 1, ports)
    assert "its interfaces: 0, 2" in caught.value.mend
    with pytest.raises(RigError, match="no serial port") as caught:
        vcom("683459357", 0, [])
    assert "no USB serial port at all" in caught.value.mend


def test_two_devices_with_one_serial_number_are_not_chosen_between() -> None:
    twice = [*usb_ports(TWO_DKS), PortInfo("/dev/ttyACM9", "683459357", 2, JLINK_VID, 0x1051)]
    with pytest.raises(RigError, match="2 ports are interface 2"):
        vcom("683459357", 2, twice)


def test_no_serial_number_is_no_name() -> None:
    ports = [PortInfo("/dev/ttyUSB0", "", 0, 0x0403, 1)]
    with pytest.raises(RigError, match="no serial port"):
        vcom("683459357", 0, ports)


def test_the_ports_of_this_machine_can_be_listed() -> None:
    assert all(port.path.startswith("/dev/") for port in find_ports())
