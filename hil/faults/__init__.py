# SPDX-License-Identifier: Apache-2.0
"""Faults made on purpose, so that every check is seen to catch what it is there for.

``docs/faults.md`` has the kinds, how they are written, and which check catches each.
"""

from hil.faults.injection import (
    KINDS,
    SYNTAX,
    Injection,
    in_words,
    of_scenario,
    parse_all,
    refuse_unless_possible,
)

__all__ = [
    "KINDS",
    "SYNTAX",
    "Injection",
    "in_words",
    "of_scenario",
    "parse_all",
    "refuse_unless_possible",
]
