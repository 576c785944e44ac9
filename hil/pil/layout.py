# SPDX-License-Identifier: Apache-2.0
"""The two files between host and target: the only place where their format is written down.

The target's C++ gets the same structures from :func:`header`, with their sizes and offsets
asserted. Both files are little-endian and every member is aligned to its own size.

``input.bin``: HEADER, the parameters in one 32-bit word each, then for every step STEP, the
leader's SAMPLE and as many SAMPLEs of the follower as STEP says. ``output.bin``: OUTPUT for every
step, then SUMMARY, which is therefore missing from a file that was cut.
"""

from __future__ import annotations

from typing import Final

import numpy as np

Field = tuple[str, str, int]
"""Name, kind (``i8``, ``u4`` or ``f4``), how many."""

VERSION: Final = 1
INPUT_MAGIC: Final = int.from_bytes(b"BVPI", "little")
OUTPUT_MAGIC: Final = int.from_bytes(b"BVPO", "little")
MAX_PARAMETER_WORDS: Final = 256

HEADER_FIELDS: Final[tuple[Field, ...]] = (
    ("magic", "u4", 1),
    ("version", "u4", 1),
    ("parameter_words", "u4", 1),
    ("parameter_names", "u4", 1),
    ("steps", "u4", 1),
    ("followers", "u4", 1),
)
STEP_FIELDS: Final[tuple[Field, ...]] = (("followers", "u4", 1), ("reserved", "u4", 1))
SAMPLE_FIELDS: Final[tuple[Field, ...]] = (
    ("t_ticks", "i8", 1),
    ("accel_mps2", "f4", 3),
    ("gyro_radps", "f4", 3),
    ("t_sigma_s", "f4", 1),
    ("clipped", "u4", 1),
)
OUTPUT_FIELDS: Final[tuple[Field, ...]] = (
    ("t_ticks", "i8", 1),
    ("p", "f4", 3),
    ("v", "f4", 3),
    ("q", "f4", 4),
    ("b_a", "f4", 3),
    ("b_g", "f4", 3),
    ("variance", "f4", 15),
    ("centre_velocity_mps", "f4", 3),
    ("centre_height_m", "f4", 1),
    ("innovation", "f4", 3),
    ("nis", "f4", 1),
    ("gate", "f4", 1),
    ("q_madgwick", "f4", 4),
    ("divergence_rad", "f4", 1),
    ("flags", "u4", 1),
    ("status", "u4", 1),
    ("clock_ticks", "u4", 1),
)
SUMMARY_FIELDS: Final[tuple[Field, ...]] = (
    ("magic", "u4", 1),
    ("steps", "u4", 1),
    ("step_stack_bytes", "u4", 1),
    ("estimator_bytes", "u4", 1),
    ("known_ticks", "u4", 5),
    ("reserved", "u4", 1),
)

STATUS: Final = (
    "ESTIMATED",
    "ALIGNING",
    "TIME_NOT_INCREASING",
    "NOT_FINITE",
    "TOO_MANY_FOLLOWERS",
)
"""Values of OUTPUT's ``status``, in the order of ``bv::Status``."""


def _dtype(fields: tuple[Field, ...]) -> np.dtype[np.void]:
    return np.dtype(
        [(name, f"<{kind}", (n,)) if n > 1 else (name, f"<{kind}") for name, kind, n in fields]
    )


HEADER: Final = _dtype(HEADER_FIELDS)
STEP: Final = _dtype(STEP_FIELDS)
SAMPLE: Final = _dtype(SAMPLE_FIELDS)
OUTPUT: Final = _dtype(OUTPUT_FIELDS)
SUMMARY: Final = _dtype(SUMMARY_FIELDS)

_C_TYPES: Final = {"i8": "std::int64_t", "u4": "std::uint32_t", "f4": "float"}
_STRUCTURES: Final = {
    "Header": (HEADER_FIELDS, HEADER),
    "StepRecord": (STEP_FIELDS, STEP),
    "SampleRecord": (SAMPLE_FIELDS, SAMPLE),
    "OutputRecord": (OUTPUT_FIELDS, OUTPUT),
    "Summary": (SUMMARY_FIELDS, SUMMARY),
}


def header() -> str:
    """The text of ``pil_format.hpp``."""
    lines = [
        "// SPDX-License-Identifier: Apache-2.0",
        "// Made by hil/pil/layout.py, where the format is described.",
        "#ifndef BV_PIL_FORMAT_HPP_",
        "#define BV_PIL_FORMAT_HPP_",
        "#include <cstddef>",
        "#include <cstdint>",
        "namespace pil",
        "{",
        f"constexpr std::uint32_t VERSION = {VERSION};",
        f"constexpr std::uint32_t INPUT_MAGIC = {INPUT_MAGIC:#x};",
        f"constexpr std::uint32_t OUTPUT_MAGIC = {OUTPUT_MAGIC:#x};",
        f"constexpr std::uint32_t MAX_PARAMETER_WORDS = {MAX_PARAMETER_WORDS};",
    ]
    for name, (fields, dtype) in _STRUCTURES.items():
        lines += [f"struct {name} {{", *(f"\t{_member(field)};" for field in fields), "};"]
        lines.append(f"static_assert(sizeof({name}) == {dtype.itemsize});")
        for field, _, _ in fields:
            offset = dtype.fields[field][1] if dtype.fields else 0
            lines.append(f"static_assert(offsetof({name}, {field}) == {offset});")
    return "\n".join([*lines, "} // namespace pil", "#endif", ""])


def _member(field: Field) -> str:
    name, kind, count = field
    return f"{_C_TYPES[kind]} {name}" + (f"[{count}]" if count > 1 else "")
