# SPDX-License-Identifier: Apache-2.0
"""Parquet: flat columns of numbers and truth values; columns of anything else are left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.exchange.sheets import BYTES_MAX, RefusedError, Sheet, check_claim
from hil.extras import module

STRINGS_MAX: Final = 1 << 26
BATCH_ROWS: Final = 65_536


def read(path: Path) -> list[Sheet]:
    """The one sheet of a file.

    Raises:
        RefusedError: not Parquet, damaged, or too much of anything.
    """
    pa, parquet = module("pyarrow"), module("pyarrow.parquet")
    try:
        with parquet.ParquetFile(
            path,
            memory_map=False,
            thrift_string_size_limit=STRINGS_MAX,
            thrift_container_size_limit=1 << 20,
        ) as file:
            return [_sheet(pa, path, file)]
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        text = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise RefusedError(f"{path}: damaged, or not Parquet: {text}", "save it again") from error


def _sheet(pa: Any, path: Path, file: Any) -> Sheet:
    about, schema = file.metadata, file.schema_arrow
    if len(set(schema.names)) < len(schema.names):
        raise RefusedError(f"{path}: a column name occurs twice", "rename it")
    kinds = pa.types
    usable = [
        f.name
        for f in schema
        if kinds.is_floating(f.type) or kinds.is_integer(f.type) or kinds.is_boolean(f.type)
    ]
    check_claim(str(path), dict.fromkeys(usable or [""], (about.num_rows,)))
    held = 0
    for group in range(about.num_row_groups):
        part = about.row_group(group)
        held += sum(part.column(k).total_uncompressed_size for k in range(part.num_columns))
    if held > BYTES_MAX:
        raise RefusedError(f"{path}: {held} bytes unpacked, the limit is {BYTES_MAX}")
    pieces: dict[str, list[NDArray[Any]]] = {name: [] for name in usable}
    rows = 0
    for batch in file.iter_batches(BATCH_ROWS, columns=usable):
        rows += len(batch)
        if rows > about.num_rows:
            raise RefusedError(f"{path}: holds more than the {about.num_rows} rows that it claims")
        for name in usable:
            pieces[name].append(_numbers(batch.column(batch.schema.get_field_index(name))))
    found = {n: np.concatenate(p) if p else np.zeros(0) for n, p in pieces.items()}
    texts = [name for name in schema.names if name not in usable]
    return Sheet(str(path), found, None, {"texts": texts})


def _numbers(column: Any) -> NDArray[Any]:
    """A column without a value here and there has NaN there."""
    return np.asarray(column.to_numpy(zero_copy_only=False))
