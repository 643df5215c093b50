"""Files of weights: arrays by name and one text that says what they are; reading one runs no code.

A file is a NumPy archive (``.npz``). Beside the arrays it holds the text ``about``, a JSON object with
the kind of the network, its architecture, and how the weights came about.
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

from ..errors import InvalidData, show
from ..files import as_path, write_bytes

__all__ = ["Weights", "read_arrays", "read_weights", "write_arrays", "write_weights"]

#: Bytes that the arrays of a file may take, unpacked.
MOST = 256 << 20
#: The entry of an archive that holds its text.
_ABOUT = "about"

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Weights:
    """The weights of a network.

    Parameters
    ----------
    kind : str
        Which network they are of, such as ``"small-vin"``.
    arrays : mapping of str to ndarray
        By the names of the network's parameters.
    architecture : mapping
        The sizes that the network is built with.
    made : mapping
        How they came about: seed, epochs, what was learned from, the command.
    """

    kind: str
    arrays: Arrays
    architecture: Mapping[str, int] = field(default_factory=dict)
    made: Mapping[str, Any] = field(default_factory=dict)

    def fit(self, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, NDArray[np.float32]]:
        """Return the arrays as float32 after a check of names, shapes, types and values.

        Parameters
        ----------
        shapes : mapping of str to tuple of int
            What the network has.

        Raises
        ------
        InvalidData
            Naming the array and what is allowed.
        """
        for name in sorted({*shapes, *self.arrays}):
            if name not in self.arrays or name not in shapes:
                fault = "is missing" if name in shapes else "belongs to no part of the network"
                raise InvalidData(f"weights of {self.kind}: {show(name)} {fault}", field=name)
            found = self.arrays[name]
            if found.shape != tuple(shapes[name]):
                raise InvalidData(
                    f"weights of {self.kind}: {name} must have shape {tuple(shapes[name])}, got "
                    f"{found.shape}",
                    field=name,
                )
            if found.dtype.kind != "f":
                raise InvalidData(
                    f"weights of {self.kind}: {name} must hold floating-point numbers, got {found.dtype}",
                    field=name,
                )
        return {name: np.ascontiguousarray(self.arrays[name], np.float32) for name in shapes}

    def require_finite(self) -> None:
        """Raise ``InvalidData``, naming array and place, where a weight is infinite or no number."""
        for name, found in self.arrays.items():
            wrong = ~np.isfinite(found)
            if wrong.any():
                at = tuple(np.argwhere(wrong)[0].tolist())
                raise InvalidData(
                    f"weights of {self.kind}: {name}{list(at)} must be finite, got {found[at]}",
                    field=name,
                )


def write_weights(
    path: str | os.PathLike[str], weights: Weights, *, dtype: str = "float32"
) -> None:
    """Write `weights` in one step, as ``float32`` or ``float16``."""
    about = {
        "kind": weights.kind,
        "architecture": dict(weights.architecture),
        "made": dict(weights.made),
    }
    arrays = {name: np.asarray(one, dtype) for name, one in weights.arrays.items()}
    write_arrays(path, arrays, about)


def read_weights(path: str | os.PathLike[str], kind: str) -> Weights:
    """Return the weights in a file.

    Parameters
    ----------
    path : str or path-like
        What :func:`write_weights` wrote, or a stranger.
    kind : str
        The network that they must be of.

    Raises
    ------
    InvalidData
        The file cannot be read, is no archive of arrays, or holds another network's weights; or a
        weight is infinite or no number.
    """
    arrays, about = read_arrays(path)
    found = about.get("kind")
    if found != kind:
        raise InvalidData(f"{path}: must hold the weights of {kind}, got {show(found)}")
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
    for name, one in arrays.items():
        if one.dtype not in (np.float16, np.float32):
            raise InvalidData(
                f"{path}: {name} must hold float16 or float32, got {one.dtype}", field=name
            )
    weights.require_finite()
    return weights


def write_arrays(path: str | os.PathLike[str], arrays: Arrays, about: Mapping[str, Any]) -> None:
    """Write arrays and one JSON object in one step."""
    text = np.array(json.dumps(about, sort_keys=True, ensure_ascii=True))
    raw = io.BytesIO()
    named = {_ABOUT: text, **{f"array.{name}": one for name, one in arrays.items()}}
    np.savez_compressed(raw, allow_pickle=False, **named)
    write_bytes(path, raw.getvalue())


def read_arrays(path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the arrays and the JSON object of a file; ``InvalidData`` where it is no such file."""
    file = as_path(path)
    try:
        with file.open("rb") as stream:
            _require_small(file, stream)
            with np.load(stream, allow_pickle=False) as archive:
                found = {name: archive[name] for name in archive.files}
        about = json.loads(str(found.pop(_ABOUT)))
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
    for name in found:
        if not name.startswith("array."):
            raise InvalidData(f"{file}: holds {show(name)}, which is no array of weights")
    return {name.removeprefix("array."): one for name, one in found.items()}, about


def _require_small(file: os.PathLike[str], stream: Any) -> None:
    """Raise where an archive would unpack to more than :data:`MOST` bytes."""
    with zipfile.ZipFile(stream) as archive:
        size = math.fsum(one.file_size for one in archive.infolist())
    if size > MOST:
        raise InvalidData(f"{file}: holds more than {MOST} bytes of arrays")
    stream.seek(0)
