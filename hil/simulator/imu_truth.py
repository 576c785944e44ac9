# SPDX-License-Identifier: Apache-2.0
"""What a simulated IMU sampled, read from the file that the chip model writes while it runs.

``docs/lsm6dsox.md``, section 6, describes the file.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import RigError
from hil.simulator.tail import Tail

MAGIC: Final = b"BVIMUTRU"
VERSION: Final = 1
HEADER: Final = struct.Struct("<8sII")
RECORD: Final = np.dtype(
    [
        ("run", "<u4"),
        ("slot", "<u4"),
        ("t_us_true", "<f8"),
        ("t_us_local", "<f8"),
        ("counts", "<i2", (6,)),
        ("accel_fs_g", "u1"),
        ("flags", "u1"),
        ("gyro_fs_dps", "<u2"),
    ]
)

Rows = tuple[
    NDArray[np.uint32],
    NDArray[np.uint32],
    NDArray[np.float64],
    NDArray[np.int16],
    NDArray[np.uint8],
]
"""Runs, slots, true times in us, counts (n, 6), flags: as ``Writer.write_imu_truth`` takes them."""


class TruthLog:
    """Reads one node's truth file while it grows; the file may not exist yet."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tail = Tail(path)
        self._partial = b""
        self._begun = False

    def rows(self) -> Rows:
        """What was written since the last call; a record that is not whole yet waits.

        Raises:
            RigError: the file is not a truth file of the version known here.
        """
        data = self._partial + self._tail.read()
        if not self._begun:
            if len(data) < HEADER.size:
                self._partial = data
                data = b""
            else:
                self._check(*HEADER.unpack_from(data))
                self._begun = True
                data = data[HEADER.size :]
        if self._begun:
            whole = len(data) - len(data) % RECORD.itemsize
            data, self._partial = data[:whole], data[whole:]
        table = np.frombuffer(data, RECORD)
        return (
            table["run"].astype(np.uint32),
            table["slot"].astype(np.uint32),
            table["t_us_true"].astype(np.float64),
            table["counts"].astype(np.int16),
            table["flags"].astype(np.uint8),
        )

    def close(self) -> None:
        self._tail.close()

    def _check(self, magic: bytes, version: int, size: int) -> None:
        if magic != MAGIC:
            raise RigError(f"{self._path}: not a truth file of the IMU model: {magic!r}")
        if (version, size) != (VERSION, RECORD.itemsize):
            raise RigError(
                f"{self._path}: version {version} with records of {size} bytes; "
                f"{VERSION} with {RECORD.itemsize} is known",
                "build the simulated bench and the rig from the same revision",
            )
