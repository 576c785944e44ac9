# SPDX-License-Identifier: Apache-2.0
"""A folder of Parquet files: one table each, with units in the fields and provenance in all."""

from __future__ import annotations

import json
from pathlib import Path

from hil.exchange.csv_files import write_provenance
from hil.exchange.table import Contents
from hil.extras import module

PROVENANCE = "hil.provenance"


def write(contents: Contents, folder: Path) -> None:
    """Write every table into ``folder``, which is there.

    Raises:
        ExchangeError: pyarrow is not installed.
    """
    pa, parquet = module("pyarrow"), module("pyarrow.parquet")
    known = json.dumps(dict(contents.provenance), allow_nan=False)
    for name, table in contents.tables.items():
        arrays = [
            pa.array(
                c.values.tolist() if c.is_text else c.values, pa.string() if c.is_text else None
            )
            for c in table.columns
        ]
        fields = [
            pa.field(c.name, a.type, metadata={"unit": c.unit, "meaning": c.meaning})
            for c, a in zip(table.columns, arrays, strict=True)
        ]
        schema = pa.schema(fields, metadata={PROVENANCE: known})
        parquet.write_table(
            pa.Table.from_arrays(arrays, schema=schema),
            folder / f"{name}.parquet",
            compression="zstd",
        )
    write_provenance(contents, folder)
