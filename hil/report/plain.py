# SPDX-License-Identifier: Apache-2.0
"""Anything a recording or an analysis hands over, as plain JSON that every reader accepts."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import numpy as np

_NOT_TEXT = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]")


def text(value: str) -> str:
    """``value`` with the characters that XML or UTF-8 cannot carry shown as U+FFFD."""
    return _NOT_TEXT.sub("\ufffd", value)


def plain(value: Any, where: str = "value") -> Any:
    """``value`` as dict, list, str, int, float, bool or None; non-finite floats as strings.

    Raises:
        TypeError: something in it has no JSON form; the message says where.
    """
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist(), where)
    if isinstance(value, Mapping):
        return {text(str(k)): plain(v, f"{where}.{k}") for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v, f"{where}[{n}]") for n, v in enumerate(value)]
    if isinstance(value, set | frozenset):
        return sorted(plain(list(value), where), key=str)
    return _scalar(value, where)


def _scalar(value: Any, where: str) -> str | int | float | bool | None:
    match value:
        case None | bool():
            return value
        case str() | PurePath():
            return text(str(value))
        case int():
            return int(value)
        case float():
            return float(value) if math.isfinite(value) else repr(float(value))
        case bytes():
            return value.hex()
    raise TypeError(f"{where} is a {type(value).__name__}, which has no JSON form")
