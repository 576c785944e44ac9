# SPDX-License-Identifier: Apache-2.0
"""Writes ``firmware/lib/wire/wire.h`` from the protocol table.

``python -m hil.wire.cgen`` writes the header, ``--check`` compares it with the table and exits
with 1 and a diff when it is stale. The output depends on the table alone, so the committed
header can be held against it byte by byte.
"""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from hil.wire import messages as table
from hil.wire.messages import Field, Group, Message, WireError

HEADER: Final = Path(__file__).parents[2] / "firmware" / "lib" / "wire" / "wire.h"

C_TYPES: Final[Mapping[str, str]] = {
    "u8": "uint8_t",
    "i8": "int8_t",
    "u16": "uint16_t",
    "i16": "int16_t",
    "u32": "uint32_t",
    "i32": "int32_t",
    "f32": "float",
    "u64": "uint64_t",
    "i64": "int64_t",
}

ENUMS: Final[Mapping[str, Mapping[str, int]]] = {
    "role": table.ROLES,
    "target": table.TARGETS,
    "sync_state": table.SYNC_STATES,
    "pulse_flag": table.PULSE_FLAGS,
    "imu_flag": table.IMU_FLAGS,
    "fault_code": table.FAULT_CODES,
    "cal_origin": table.CAL_ORIGINS,
    "cal_reason": table.CAL_REASONS,
    "boot_check": table.BOOT_CHECKS,
    "node_command": table.NODE_COMMANDS,
    "link_key_origin": table.LINK_KEY_ORIGINS,
    "rep_kind": table.REP_KINDS,
    "rep_flag": table.REP_FLAGS,
}
"""Singular name of each set of named values; it becomes the prefix of the enumerators."""

PREAMBLE: Final = """\
/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Generated from hil/wire/messages.py by `python -m hil.wire.cgen`; edit the table, not this file.
 *
 * Payloads are little-endian and unaligned. Every access goes byte by byte through the functions
 * below: no packed structures, no casts of buffers. Members hold raw counts; the physical value is
 * raw * scale, where a scale other than 1 is WIRE_<MESSAGE>_<FIELD>_SCALE.
 *
 * size_t wire_<message>_put(buf, m)       writes the payload, returns its size; buf must hold
 *                                         _SIZE (or _MAX_SIZE) bytes; 0 when a count is too large
 * bool   wire_<message>_get(m, buf, len)  false when len does not fit the message or a count is too
 *                                         large; rows beyond the count are left as they were
 */
#ifndef WIRE_H_
#define WIRE_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
"""

ACCESSORS: Final = """\
static inline void wire_put_u8(uint8_t *buf, uint8_t value)
{
	buf[0] = value;
}

static inline void wire_put_u16(uint8_t *buf, uint16_t value)
{
	buf[0] = (uint8_t)(value & 0xFFu);
	buf[1] = (uint8_t)(value >> 8);
}

static inline void wire_put_u32(uint8_t *buf, uint32_t value)
{
	wire_put_u16(buf, (uint16_t)(value & 0xFFFFu));
	wire_put_u16(buf + 2, (uint16_t)(value >> 16));
}

static inline void wire_put_u64(uint8_t *buf, uint64_t value)
{
	wire_put_u32(buf, (uint32_t)(value & 0xFFFFFFFFu));
	wire_put_u32(buf + 4, (uint32_t)(value >> 32));
}

static inline void wire_put_i8(uint8_t *buf, int8_t value)
{
	wire_put_u8(buf, (uint8_t)value);
}

static inline void wire_put_i16(uint8_t *buf, int16_t value)
{
	wire_put_u16(buf, (uint16_t)value);
}

static inline void wire_put_i32(uint8_t *buf, int32_t value)
{
	wire_put_u32(buf, (uint32_t)value);
}

static inline void wire_put_i64(uint8_t *buf, int64_t value)
{
	wire_put_u64(buf, (uint64_t)value);
}

static inline void wire_put_f32(uint8_t *buf, float value)
{
	uint32_t bits;

	memcpy(&bits, &value, sizeof(bits));
	wire_put_u32(buf, bits);
}

static inline uint8_t wire_get_u8(const uint8_t *buf)
{
	return buf[0];
}

static inline uint16_t wire_get_u16(const uint8_t *buf)
{
	return (uint16_t)(buf[0] | ((uint32_t)buf[1] << 8));
}

static inline uint32_t wire_get_u32(const uint8_t *buf)
{
	return wire_get_u16(buf) | ((uint32_t)wire_get_u16(buf + 2) << 16);
}

static inline uint64_t wire_get_u64(const uint8_t *buf)
{
	return wire_get_u32(buf) | ((uint64_t)wire_get_u32(buf + 4) << 32);
}

static inline int8_t wire_get_i8(const uint8_t *buf)
{
	return (int8_t)wire_get_u8(buf);
}

static inline int16_t wire_get_i16(const uint8_t *buf)
{
	return (int16_t)wire_get_u16(buf);
}

static inline int32_t wire_get_i32(const uint8_t *buf)
{
	return (int32_t)wire_get_u32(buf);
}

static inline int64_t wire_get_i64(const uint8_t *buf)
{
	return (int64_t)wire_get_u64(buf);
}

static inline float wire_get_f32(const uint8_t *buf)
{
	uint32_t bits = wire_get_u32(buf);
	float value;

	memcpy(&value, &bits, sizeof(value));
	return value;
}
"""


def header(messages: Sequence[Message] = table.MESSAGES) -> str:
    """The text of ``wire.h``.

    Raises:
        WireError: two parts of the table would claim the same C identifier.
    """
    sections = [
        PREAMBLE,
        "\n".join(_constants(messages)) + "\n",
        *("\n".join(_enum(name, values)) + "\n" for name, values in ENUMS.items()),
        ACCESSORS,
        *("\n".join(_message(m)) + "\n" for m in messages),
        "#endif /* WIRE_H_ */\n",
    ]
    text = "\n".join(sections)
    _require_unique_identifiers(text)
    return text


def _constants(messages: Sequence[Message]) -> Iterator[str]:
    yield f"#define WIRE_PROTOCOL_VERSION {table.PROTOCOL_VERSION}u"
    yield f"#define WIRE_SCHEMA_HASH UINT64_C(0x{table.schema_hash(tuple(messages)):016X})"
    yield f"#define WIRE_TICK_RATE_HZ {table.TICK_RATE_HZ}u"
    yield "/* Size of the largest payload of all messages. */"
    yield f"#define WIRE_MAX_PAYLOAD_SIZE {max(m.max_size for m in messages)}u"


def _enum(name: str, values: Mapping[str, int]) -> Iterator[str]:
    # No tag: struct and enum share one namespace in C, and `sync_state` is a message as well.
    yield "enum {"
    for key, value in values.items():
        yield f"\tWIRE_{name.upper()}_{key.upper()} = {value},"
    yield "};"


def _message(m: Message) -> Iterator[str]:
    macro = f"WIRE_{m.name.upper()}"
    yield f"/* {m.meaning} */"
    yield f"#define {macro}_ID {m.id}u"
    yield f"#define {macro}_SIZE {m.fixed_size}u"
    if m.group:
        yield f"#define {macro}_MAX_COUNT {m.group.max_count}u"
        yield f"#define {macro}_MAX_SIZE {m.max_size}u"
    yield from _field_macros(macro, m.fields)
    if m.group:
        row = f"{macro}_{m.group.name.upper()}"
        yield f"#define {row}_SIZE {m.group.size}u"
        yield from _field_macros(row, m.group.fields)
        yield ""
        yield from _struct(f"wire_{m.name}_{m.group.name}", m.group.fields)
    yield ""
    yield from _struct(f"wire_{m.name}", m.fields, m)
    yield ""
    yield from _put(m, macro)
    yield ""
    yield from _get(m, macro)


def _field_macros(prefix: str, fields: Sequence[Field]) -> Iterator[str]:
    offset = 0
    for f in fields:
        name = f"{prefix}_{f.name.upper()}"
        yield f"#define {name}_OFFSET {offset}u"
        if f.count > 1:
            yield f"#define {name}_COUNT {f.count}u"
        if f.scale != 1.0:
            yield f"#define {name}_SCALE {f.scale!r}"
        offset += f.size


def _struct(name: str, fields: Sequence[Field], owner: Message | None = None) -> Iterator[str]:
    yield f"struct {name} {{"
    for f in fields:
        array = f"[{f.count}]" if f.count > 1 else ""
        yield f"\t/* {f.meaning} {_quantity(f)} */"
        yield f"\t{C_TYPES[f.type]} {f.name}{array};"
    if owner and owner.group:
        rows = f"{owner.group.name}[WIRE_{owner.name.upper()}_MAX_COUNT]"
        yield f"\tstruct wire_{owner.name}_{owner.group.name} {rows};"
    yield "};"


def _quantity(f: Field) -> str:
    unit = f.unit if f.scale == 1.0 else f"{f.scale!r} {f.unit}"
    return f"[{unit}, {f.clock} clock]" if f.clock else f"[{unit}]"


def _put(m: Message, macro: str) -> Iterator[str]:
    yield f"static inline size_t wire_{m.name}_put(uint8_t *buf, const struct wire_{m.name} *m)"
    yield "{"
    if m.group:
        yield f"\tif (m->{m.group.count_field} > {macro}_MAX_COUNT) {{"
        yield "\t\treturn 0;"
        yield "\t}"
    for f in m.fields:
        yield from _put_field(f, "buf", "m->", macro, "\t")
    if m.group:
        rows, row_macro = m.group.name, f"{macro}_{m.group.name.upper()}"
        yield from _row_loop(m.group, macro, "uint8_t *row = ")
        for f in m.group.fields:
            yield from _put_field(f, "row", f"m->{rows}[r].", row_macro, "\t\t")
        yield "\t}"
    yield f"\treturn {_total(m, macro)};"
    yield "}"


def _get(m: Message, macro: str) -> Iterator[str]:
    yield f"static inline bool wire_{m.name}_get(struct wire_{m.name} *m, const uint8_t *buf,"
    yield "\t\t\t\t\tsize_t len)"
    yield "{"
    yield f"\tif (len {'<' if m.group else '!='} {macro}_SIZE) {{"
    yield "\t\treturn false;"
    yield "\t}"
    for f in m.fields:
        yield from _get_field(f, "buf", "m->", macro, "\t")
    if m.group:
        rows, row_macro = m.group.name, f"{macro}_{m.group.name.upper()}"
        yield f"\tif (m->{m.group.count_field} > {macro}_MAX_COUNT ||"
        yield f"\t    len != {_total(m, macro)}) {{"
        yield "\t\treturn false;"
        yield "\t}"
        yield from _row_loop(m.group, macro, "const uint8_t *row = ")
        for f in m.group.fields:
            yield from _get_field(f, "row", f"m->{rows}[r].", row_macro, "\t\t")
        yield "\t}"
    yield "\treturn true;"
    yield "}"


def _total(m: Message, macro: str) -> str:
    if not m.group:
        return f"{macro}_SIZE"
    count = f"(size_t)m->{m.group.count_field}"
    return f"{macro}_SIZE + {count} * {macro}_{m.group.name.upper()}_SIZE"


def _row_loop(group: Group, macro: str, declaration: str) -> Iterator[str]:
    yield f"\tfor (size_t r = 0; r < m->{group.count_field}; r++) {{"
    yield f"\t\t{declaration}buf + {macro}_SIZE + r * {macro}_{group.name.upper()}_SIZE;"
    yield ""


def _put_field(f: Field, buf: str, owner: str, macro: str, indent: str) -> Iterator[str]:
    at, member = _element(f, buf, owner, macro)
    yield from _each(f, macro, indent, f"wire_put_{f.type}({at},", f" {member});")


def _get_field(f: Field, buf: str, owner: str, macro: str, indent: str) -> Iterator[str]:
    at, member = _element(f, buf, owner, macro)
    yield from _each(f, macro, indent, f"{member} =", f" wire_get_{f.type}({at});")


def _element(f: Field, buf: str, owner: str, macro: str) -> tuple[str, str]:
    """Address in the payload and the structure's member, of one element when in an array."""
    at = f"{buf} + {macro}_{f.name.upper()}_OFFSET"
    if f.count == 1:
        return at, f"{owner}{f.name}"
    step = "i" if table.TYPE_SIZES[f.type] == 1 else f"{table.TYPE_SIZES[f.type]}u * i"
    return f"{at} + {step}", f"{owner}{f.name}[i]"


def _each(f: Field, macro: str, indent: str, head: str, tail: str) -> Iterator[str]:
    """The statement ``head + tail``, in a loop for an array, broken in two when it is long."""
    inner = indent if f.count == 1 else indent + "\t"
    if f.count > 1:
        yield f"{indent}for (size_t i = 0; i < {macro}_{f.name.upper()}_COUNT; i++) {{"
    if len((inner + head + tail).expandtabs(8)) <= 100:
        yield f"{inner}{head}{tail}"
    else:
        yield f"{inner}{head}"
        yield f"{inner}    {tail.lstrip()}"
    if f.count > 1:
        yield f"{indent}}}"


def _require_unique_identifiers(text: str) -> None:
    defined = re.findall(r"^#define (\w+) |^\t(WIRE_\w+) = ", text, flags=re.MULTILINE)
    seen: set[str] = set()
    for name in (macro or enumerator for macro, enumerator in defined):
        if name in seen:
            raise WireError(f"the table defines the C name {name} twice: rename one of its sources")
        seen.add(name)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point. Returns 0, or 1 when ``--check`` finds the header stale."""
    parser = argparse.ArgumentParser(prog="python -m hil.wire.cgen", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare only; exit 1 with a diff")
    parser.add_argument("--output", type=Path, default=HEADER, help="default: %(default)s")
    args = parser.parse_args(argv)
    path: Path = args.output
    wanted = header()
    found = path.read_text(encoding="utf-8") if path.is_file() else ""
    if found == wanted:
        return 0
    if args.check:
        diff = difflib.unified_diff(
            found.splitlines(keepends=True),
            wanted.splitlines(keepends=True),
            fromfile=str(path),
            tofile="generated from hil/wire/messages.py",
        )
        sys.stdout.writelines(diff)
        print(f"{path} is stale: run `python -m hil.wire.cgen`", file=sys.stderr)
        return 1
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(wanted, encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
