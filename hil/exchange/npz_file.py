# SPDX-License-Identifier: Apache-2.0
"""NumPy's .npz: one array per column, ``table/column``; nothing in it needs pickle."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.exchange.table import Contents

PROVENANCE = "provenance_json"


def as_npz(contents: Contents) -> bytes:
    """The archive; texts are of fixed width, units stand in ``table/units``."""
    arrays: dict[str, NDArray[Any]] = {
        PROVENANCE: np.array(json.dumps(dict(contents.provenance), allow_nan=False))
    }
    for name, table in contents.tables.items():
        for column in table.columns:
            values = column.values.astype(np.str_) if column.is_text else column.values
            arrays[f"{name}/{column.name}"] = values
        arrays[f"{name}/units"] = np.array([[c.name, c.unit] for c in table.columns])
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    return stream.getvalue()
