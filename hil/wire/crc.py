# SPDX-License-Identifier: Apache-2.0
"""CRC-16/IBM-3740 (CCITT-FALSE), of one message and of many equally long messages at once.

Polynomial ``x^16 + x^12 + x^5 + 1`` (0x1021), seed 0xFFFF, not reflected, no final XOR; its check
value, the CRC of ``b"123456789"``, is 0x29B1.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from fastcrc.crc16 import ibm_3740
from numpy.typing import NDArray

POLYNOMIAL: Final = 0x1021
SEED: Final = 0xFFFF


def crc16(data: bytes) -> int:
    """CRC of one message."""
    return ibm_3740(data)


def crc16_rows(rows: NDArray[np.uint8], zeros: int) -> NDArray[np.uint16]:
    """CRC of every row of an (n, 2k) array, without the first ``zeros`` bytes of each row.

    Those bytes must be 0: they let a message of any length fill whole 16-bit words, and are
    made ineffective by a seed that turns into the real one behind them.

    The register is as wide as a word, so one look-up moves it past two bytes: ``state`` becomes
    ``TABLE[state ^ word]``. Words are read little-endian although the CRC runs big-endian; the
    register is kept byte-swapped instead of each word being swapped.
    """
    table = _two_byte_table()
    state = np.full(len(rows), _seed_before(zeros), np.uint16).byteswap()
    for word in rows.view("<u2").T:
        state = table.take(state ^ word)
    return state.byteswap()


@lru_cache(maxsize=1)
def _two_byte_table() -> NDArray[np.uint16]:
    """Register after two zero bytes for each register before them, both byte-swapped."""
    register = np.arange(1 << 16, dtype=np.uint16)
    for _ in range(16):
        carry = register >> np.uint16(15)
        register = register << np.uint16(1) ^ carry * np.uint16(POLYNOMIAL)
    swapped = np.arange(1 << 16, dtype=np.uint16).byteswap()
    return register[swapped].byteswap()


@lru_cache(maxsize=4)
def _seed_before(zeros: int) -> int:
    """The register that ``zeros`` zero bytes turn into the seed: the shifts run backwards."""
    register = SEED
    for _ in range(8 * zeros):
        carry = register & 1
        register = (register ^ carry * POLYNOMIAL) >> 1 | carry << 15
    return register
