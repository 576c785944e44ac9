# SPDX-License-Identifier: Apache-2.0
"""HDF5: one sensor's datasets at the root, as BROAD has them, or the tables of an export."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.exchange.sheets import (
    BYTES_MAX,
    COLUMNS_MAX,
    NAME_MAX,
    SENSORS,
    RefusedError,
    Sheet,
    check_claim,
    columns_of,
)
from hil.extras import module

CHUNKS_MAX: Final = 100_000
DEFLATE, SHUFFLE, FLETCHER32 = "1", "2", "3"
BROAD: Final = {"imu_gyr", "imu_acc"}


def read(path: Path) -> list[Sheet]:
    """The sheets of a file; only datasets of numbers that lie in the file itself are read.

    Raises:
        RefusedError: not HDF5, damaged, links that lead elsewhere, or too much of anything.
    """
    h5py = module("h5py")
    try:
        with h5py.File(path, "r") as file:
            tables = file.get("hil") if _is_plain(h5py, file, "hil") else None
            if isinstance(tables, h5py.Group):
                names = [name for name in SENSORS if _is_plain(h5py, tables, name)]
                found = [_sheet(h5py, f"{path}, hil/{name}", tables[name]) for name in names]
                if found:
                    return found
            return [_sheet(h5py, str(path), file)]
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        text = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise RefusedError(f"{path}: damaged, or not HDF5: {text}", "save it again") from error


def _is_plain(h5py: Any, group: Any, name: str) -> bool:
    return isinstance(group.get(name, getlink=True), h5py.HardLink)


def _sheet(h5py: Any, where: str, group: Any) -> Sheet:
    if not isinstance(group, h5py.Group):
        raise RefusedError(f"{where}: is no group of datasets")
    if len(group) > COLUMNS_MAX:
        raise RefusedError(f"{where}: {len(group)} datasets, the limit is {COLUMNS_MAX}")
    usable, texts = {}, []
    for name in group:
        if not _is_plain(h5py, group, name):
            raise RefusedError(
                f"{where}: '{name[:NAME_MAX]}' is a link that leads elsewhere",
                "save the datasets themselves in the file",
            )
        one = group[name]
        if not isinstance(one, h5py.Dataset):
            continue
        if one.dtype.kind in "fiub" and one.dtype.itemsize <= 8 and one.shape is not None:
            usable[name] = one
        else:
            texts.append(name)
    check_claim(where, {name: one.shape for name, one in usable.items()})
    arrays: dict[str, NDArray[Any]] = {}
    for name, one in usable.items():
        if one.ndim in (1, 2):
            _check_storage(f"{where}: '{name[:NAME_MAX]}'", one)
            arrays[name] = np.asarray(one[()])
    attributes: dict[str, Any] = {"texts": texts}
    rate = group.attrs.get("sampling_rate")
    if rate is not None and np.ndim(rate) == 0 and np.asarray(rate).dtype.kind in "fiu":
        attributes["sampling_rate"] = float(rate)
    is_broad = set(arrays) >= BROAD and "sampling_rate" in attributes
    return Sheet(where, columns_of(arrays), None, attributes, is_broad)


def _check_storage(what: str, one: Any) -> None:
    """Refuse data outside the file, unknown filters, and chunks that unpack to more than theirs."""
    if one.external or one.is_virtual:
        raise RefusedError(f"{what} keeps its data in other files", "save it as one file")
    if one.chunks is None:
        if one.id.get_storage_size() not in (0, one.nbytes):
            raise RefusedError(f"{what} holds other than its {one.nbytes} bytes", "save it again")
        return
    nominal = int(np.prod(one.chunks, dtype=object)) * one.dtype.itemsize
    if nominal > BYTES_MAX:
        raise RefusedError(f"{what} has chunks of {nominal} bytes, the limit is {BYTES_MAX}")
    if not set(one._filters) <= {"gzip", "shuffle", "fletcher32"}:
        raise RefusedError(
            f"{what} is packed in another way than gzip", "save it with gzip, or plain"
        )
    count = one.id.get_num_chunks()
    if count > CHUNKS_MAX:
        raise RefusedError(f"{what} has {count} chunks, the limit is {CHUNKS_MAX}")
    for k in range(count if "gzip" in one._filters else 0):
        info = one.id.get_chunk_info(k)
        if info.filter_mask:
            continue
        if info.size > 2 * nominal + 1024:
            raise RefusedError(
                f"{what} has a chunk of {info.size} bytes packed, {nominal} unpacked"
            )
        _, packed = one.id.read_direct_chunk(info.chunk_offset)
        unpacked = zlib.decompressobj()
        try:
            size = len(unpacked.decompress(packed, nominal + 1))
        except zlib.error as error:
            raise RefusedError(f"{what} is damaged: {error}", "save it again") from error
        if size > nominal:
            raise RefusedError(f"{what} unpacks to more than the {nominal} bytes of a chunk")
