# SPDX-License-Identifier: Apache-2.0
"""CRC-16/IBM-3740 (CCITT-FALSE) of one message.

Polynomial ``x^16 + x^12 + x^5 + 1`` (0x1021), seed 0xFFFF, not reflected, no final XOR; its check
value, the CRC of ``b"123456789"``, is 0x29B1.
"""

from __future__ import annotations

from fastcrc.crc16 import ibm_3740


def crc16(data: bytes) -> int:
    """CRC of one message."""
    return ibm_3740(data)
