"""Files of arrays: MATLAB files and NumPy archives."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...models.programs.base import RowProgram
from ...models.programs.sources.arrays import program_of_arrays
from .compressed import read_raw

__all__ = ["read_mat", "read_npz"]

#: Largest size in bytes of all arrays in a file after decompression.
_LARGEST = 1 << 30


def read_mat(path: Path) -> RowProgram:
    """Return the program in a MATLAB file with ``P, q, A, l, u, r`` in OSQP's convention."""
    from scipy.io import loadmat

    raw = read_raw(path)
    try:
        _check_compressed(path, raw)
        content = loadmat(io.BytesIO(raw), squeeze_me=False)
    except InvalidData:
        raise
    except Exception as error:  # SciPy raises many types for damaged files
        raise InvalidData(f"{path}: not a MATLAB file up to version 7: {error}") from None
    content = {name: value for name, value in content.items() if not name.startswith("__")}
    for name in ("n", "m"):  # the sizes, in some files
        content.pop(name, None)
    return program_of_arrays(content)


def _check_compressed(path: Path, raw: bytes) -> None:
    """Raise if the compressed elements of a MATLAB file, of type 15, are too large for SciPy's reader."""
    size, place, form = 0, 128, "<II" if raw[126:128] == b"IM" else ">II"
    while place + 8 <= len(raw):
        kind, count = struct.unpack_from(form, raw, place)
        place += 8 + count
        stream, rest = zlib.decompressobj(), raw[place - count : place] if kind == 15 else b""
        while rest:
            size += len(stream.decompress(rest, 1 << 20))
            rest = stream.unconsumed_tail
            if size > _LARGEST:
                raise InvalidData(f"{path}: more than {_LARGEST} bytes after decompression")


def read_npz(path: Path) -> RowProgram:
    """Return the program in a NumPy archive with arrays of one convention; sparse ones in parts.

    A sparse matrix `A` consists of ``A_data, A_indices, A_indptr, A_shape`` in compressed rows.
    """
    raw = read_raw(path)
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            if sum(item.file_size for item in archive.infolist()) > _LARGEST:
                raise InvalidData(f"{path}: more than {_LARGEST} bytes after decompression")
        with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
            content: dict[str, Any] = {name: arrays[name] for name in arrays.files}
        for name in {key.removesuffix("_indptr") for key in content if key.endswith("_indptr")}:
            keys = {part: f"{name}_{part}" for part in ("data", "indices", "indptr", "shape")}
            content[name] = {part: content.pop(key) for part, key in keys.items() if key in content}
    except InvalidData:
        raise
    except Exception as error:  # NumPy and SciPy raise many types for damaged files
        raise InvalidData(f"{path}: not an archive of arrays: {error}") from None
    return program_of_arrays(content)
