# SPDX-License-Identifier: Apache-2.0
"""Libraries that only some formats need, each brought by an extra of this package."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Final

from hil.errors import HilError

EXTRAS: Final = {
    "h5py": "hdf5",
    "pyarrow": "parquet",
    "pyarrow.parquet": "parquet",
    "mcap_protobuf.writer": "foxglove",
    "foxglove_schemas_protobuf.Log_pb2": "foxglove",
    "foxglove_schemas_protobuf.FrameTransform_pb2": "foxglove",
}
"""Module -> the extra of this package that brings it."""


def module(name: str) -> ModuleType:
    """The module ``name`` of :data:`EXTRAS`.

    Raises:
        HilError: it is not installed; the message says which extra brings it.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise HilError(
            f"this format needs {name.partition('.')[0]}, which is not installed",
            f"pip install 'hil[{EXTRAS[name]}]'",
        ) from error
