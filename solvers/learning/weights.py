"""Files of weights: named arrays and a JSON description. Reading one executes no code.

A file is a NumPy archive (``.npz``). In addition to the arrays it contains the text ``about``, a JSON
object with the kind of the network, its architecture and the origin of the weights.
"""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, show
from ...files import as_path, write_bytes

__all__ = ["Weights", "read_arrays", "read_weights", "write_arrays", "write_weights"]

#: Largest size of the unpacked arrays of a file, in bytes.
MOST = 256 << 20
#: Name of the archive's entry with the JSON text.
_ABOUT = "about"

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Weights:
    """Weights of a network.

    Parameters
    ----------
    kind : str
        Kind of the network, such as ``"small-vin"``.
    arrays : mapping of str to ndarray
        Arrays by the names of the network's parameters.
    architecture : mapping
        Sizes from which the network is built.
    made : mapping
        Origin: seed, epochs, training examples, command.
    """

    kind: str
    arrays: Arrays
    architecture: Mapping[str, int] = field(default_factory=dict)
    made: Mapping[str, Any] = field(default_factory=dict)

    def fit(self, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, NDArray[np.float32]]:
        """Return the arrays as float32 after checking their names, shapes and types.

        Parameters
        ----------
        shapes : mapping of str to tuple of int
            Shapes of the network's parameters.

        Raises
        ------
        InvalidData
            An array is missing, unknown, or has another shape or type.
        """
        for name in sorted({*shapes, *self.arrays}):
            if name not in self.arrays or name not in shapes:
                fault = "is missing" if name in shapes else "belongs to no part of the network"
                raise InvalidData(f"weights of {self.kind}: {show(name)} {fault}", field=name)
            array = self.arrays[name]
            if array.shape != tuple(shapes[name]):
                raise InvalidData(
                    f"weights of {self.kind}: {name} must have shape {tuple(shapes[name])}, got "
                    f"{array.shape}",
                    field=name,
                )
            if array.dtype.kind != "f":
                raise InvalidData(
                    f"weights of {self.kind}: {name} must hold floating-point numbers, got {array.dtype}",
                    field=name,
                )
        return {name: np.ascontiguousarray(self.arrays[name], np.float32) for name in shapes}

    def require_finite(self) -> None:
        """Raise ``InvalidData`` if a weight is infinite or NaN; the message gives array and index."""
        for name, array in self.arrays.items():
            invalid = ~np.isfinite(array)
            if invalid.any():
                index = tuple(np.argwhere(invalid)[0].tolist())
                raise InvalidData(
                    f"weights of {self.kind}: {name}{list(index)} must be finite, got {array[index]}",
                    field=name,
                )


def write_weights(
    path: str | os.PathLike[str], weights: Weights, *, dtype: str = "float32"
) -> None:
    """Write weights to a file, which is replaced atomically.

    Parameters
    ----------
    path : str or path-like
        Name of the file.
    weights : Weights
        The weights.
    dtype : {"float32", "float16"}
        Type of the stored arrays.
    """
    about = {
        "kind": weights.kind,
        "architecture": dict(weights.architecture),
        "made": dict(weights.made),
    }
    arrays = {name: np.asarray(array, dtype) for name, array in weights.arrays.items()}
    write_arrays(path, arrays, about)


def read_weights(path: str | os.PathLike[str], kind: str) -> Weights:
    """Return the weights in a file.

    Parameters
    ----------
    path : str or path-like
        Name of a file, written by :func:`write_weights` or from another source.
    kind : str
        Required kind of the network.

    Raises
    ------
    InvalidData
        The file cannot be read, is not an archive of arrays, or contains weights of another
        network or weights that are not finite.
    """
    arrays, about = read_arrays(path)
    stored_kind = about.get("kind")
    if stored_kind != kind:
        raise InvalidData(f"{path}: must hold the weights of {kind}, got {show(stored_kind)}")
    parts = {name: about.get(name) for name in ("architecture", "made")}
    for name, part in parts.items():
        if not isinstance(part, dict):
            raise InvalidData(f"{path}: {name} must be an object, got {show(part)}")
    for name, size in (parts["architecture"] or {}).items():
        if type(size) is not int or not 1 <= size <= 4096:
            raise InvalidData(
                f"{path}: architecture, {show(name)} must be a whole number from 1 to 4096, got "
                f"{show(size)}"
            )
    weights = Weights(kind, arrays, parts["architecture"] or {}, parts["made"] or {})
    for name, array in arrays.items():
        if array.dtype not in (np.float16, np.float32):
            raise InvalidData(
                f"{path}: {name} must hold float16 or float32, got {array.dtype}", field=name
            )
    weights.require_finite()
    return weights


def write_arrays(path: str | os.PathLike[str], arrays: Arrays, about: Mapping[str, Any]) -> None:
    """Write arrays and a JSON object to a file, which is replaced atomically.

    Parameters
    ----------
    path : str or path-like
        Name of the file.
    arrays : mapping of str to ndarray
        The arrays.
    about : mapping
        JSON data.
    """
    text = np.array(json.dumps(about, sort_keys=True, ensure_ascii=True))
    raw = io.BytesIO()
    named = {_ABOUT: text, **{f"array.{name}": array for name, array in arrays.items()}}
    np.savez_compressed(raw, allow_pickle=False, **named)
    write_bytes(path, raw.getvalue())


def read_arrays(path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the arrays and the JSON object of a file.

    Parameters
    ----------
    path : str or path-like
        Name of the file.

    Raises
    ------
    InvalidData
        The file cannot be read, is too large, or was not written by :func:`write_arrays`.
    """
    file = as_path(path)
    try:
        with file.open("rb") as stream:
            _require_small(file, stream)
            with np.load(stream, allow_pickle=False) as archive:
                entries = {name: archive[name] for name in archive.files}
        about = json.loads(str(entries.pop(_ABOUT)))
        if not isinstance(about, dict):
            raise ValueError(f"{_ABOUT} must be an object")
    except FileNotFoundError:
        raise InvalidData(f"{file}: no such file") from None
    except OSError as error:
        raise InvalidData(f"{file}: cannot be read: {error.strerror or error}") from None
    except (
        *(ValueError, KeyError, EOFError, RuntimeError, RecursionError, NotImplementedError),
        *(MemoryError, AttributeError, TypeError, zipfile.BadZipFile, zlib.error),
    ) as error:
        raise InvalidData(f"{file}: is no file of weights: {error}") from None
    for name in entries:
        if not name.startswith("array."):
            raise InvalidData(f"{file}: holds {show(name)}, which is not an array of weights")
    return {name.removeprefix("array."): array for name, array in entries.items()}, about


def _require_small(file: os.PathLike[str], stream: Any) -> None:
    """Raise ``InvalidData`` if an archive would unpack to more than :data:`MOST` bytes."""
    with zipfile.ZipFile(stream) as archive:
        size = math.fsum(entry.file_size for entry in archive.infolist())
    if size > MOST:
        raise InvalidData(f"{file}: holds more than {MOST} bytes of arrays")
    stream.seek(0)
