# SPDX-License-Identifier: Apache-2.0
"""The report document as a badge, in the form that shields.io's endpoint badge reads.

Source: https://shields.io/badges/endpoint-badge, schema version 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from hil.report import words

COLOURS: Final[Mapping[str, str]] = {
    "pass": "brightgreen",
    "marginal": "yellow",
    "fail": "red",
    "inconclusive": "purple",
    "unset": "lightgrey",
}


def render(document: Mapping[str, Any]) -> dict[str, Any]:
    """The badge: as red as the page, with the sentence that the page begins with."""
    verdict, sentence = words.headline(document)
    return {
        "schemaVersion": 1,
        "label": "hil",
        "message": sentence.rstrip("."),
        "color": COLOURS[verdict],
        "isError": verdict == "fail",
    }
