"""Instance files: models read from JSON and written to it, whatever their kind.

A file holds ``{"model": kind, "name": …, "data": {…}}``. Where a problem keeps part of its data in
a file beside it, as ``"points": "file.csv"``, the function registered for its kind puts the content
in the place of the reference.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import secrets
import stat
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InvalidData
from ..models.fields import show
from ..models.model import Model, parse_json
from ..models.problems import resolve, table

__all__ = [
    "NUMBER",
    "number",
    "read_model",
    "read_plan",
    "read_text",
    "register_references",
    "writable",
    "write_bytes",
    "write_model",
    "write_text",
]

#: Numbers as files may write them.
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")

#: Puts the content of referenced files into the ``data`` of an instance: (data, folder) -> data.
References = Callable[[Mapping[str, Any], Path], dict[str, Any]]

#: Functions of that type that users registered, by model kind.
_REGISTERED: dict[str, References] = {}


def register_references(kind: str, function: References) -> References:
    """Let instance files of the model `kind` refer to other files.

    Parameters
    ----------
    kind : str
        The model's JSON name.
    function : callable
        Takes ``data`` as it stands in the file and the file's folder; returns the ``data`` that
        the model understands.
    """
    _REGISTERED[kind] = function
    return function


def read_model(path: str | os.PathLike[str]) -> Model[Any]:
    """Return the model in a JSON file; file names in it are relative to its folder.

    Raises
    ------
    InvalidData
        Naming the file, and in it the field, the row and the value at fault.
    """
    file = Path(path)
    text = read_text(file)
    try:
        content = parse_json(text)
        if isinstance(content, Mapping):
            kind, data = content.get("model"), content.get("data")
            readers = {**table(__package__, "REFERENCES"), **_REGISTERED}
            if isinstance(kind, str) and isinstance(data, Mapping) and kind in readers:
                data = resolve(readers[kind])(data, file.parent)
                content = {**content, "data": data}
        return Model.from_dict(content)
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None
    except RecursionError:
        raise InvalidData(f"{file}: nested too deeply for an instance") from None


def write_model(model: Model[Any], path: str | os.PathLike[str]) -> Path:
    """Write `model` as JSON, exactly and in one step; return the path.

    Reading the file back gives the same digest. A reader never sees half a file.
    """
    return write_text(path, pretty(model.to_dict()))


def pretty(content: Mapping[str, Any]) -> str:
    """Return the JSON of an instance with one line a field, and one a row of a matrix."""

    def plain(value: Any) -> str:
        return json.dumps(value, allow_nan=False, ensure_ascii=False)

    def field(value: Any) -> str:
        if not isinstance(value, list) or not value or not isinstance(value[0], list):
            return plain(value)
        return "[\n      " + ",\n      ".join(map(plain, value)) + "\n    ]"

    data = ",\n    ".join(f"{plain(k)}: {field(v)}" for k, v in content["data"].items())
    head = [f"{plain(k)}: {plain(v)}" for k, v in content.items() if k != "data"]
    return "{\n  " + ",\n  ".join([*head, f'"data": {{\n    {data}\n  }}']) + "\n}\n"


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the UTF-8 text of a file, without its byte-order mark; lines end as they stand."""
    file = Path(path)
    try:
        raw = file.read_bytes()
    except FileNotFoundError:
        raise InvalidData(f"{file}: no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidData(f"{file}: cannot be read: {reason}") from None
    return _decoded(raw, file)


def _decoded(raw: bytes, file: str | Path) -> str:
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InvalidData(
            f"{file}, line {line}: byte 0x{raw[error.start]:02x} is no UTF-8: save it as UTF-8"
        ) from None


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write `text` as UTF-8 in one step: whoever reads sees the old content or the new.

    Raises
    ------
    InvalidData
        The text or the file cannot be written, or the path leads to no regular file.
    """
    try:
        raw = text.encode()
    except UnicodeEncodeError as error:
        raise InvalidData(f"{path}: {text[error.start]!r} cannot be written as UTF-8") from None
    return write_bytes(path, raw)


def write_bytes(path: str | os.PathLike[str], raw: bytes) -> Path:
    """Write `raw` in one step, as :func:`write_text` does; an existing file keeps its mode."""
    file = Path(path)
    # A link stays a link: what it points at is replaced.
    target = Path(os.path.realpath(file))
    partial = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        old = target.stat() if target.exists() else None
        _require_regular(file, old)
        with partial.open("xb") as stream:
            if old is not None:
                os.fchmod(stream.fileno(), stat.S_IMODE(old.st_mode))
            stream.write(raw)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(target)
    except OSError as error:
        raise InvalidData(f"{file}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()
    return file


def _require_regular(file: Path, found: os.stat_result | None) -> None:
    """Raise where `found` is no regular file: a device or a pipe must not be replaced by a file."""
    if found is not None and not stat.S_ISREG(found.st_mode):
        raise InvalidData(f"{file}: is no regular file, and only such are written", field="file")


def read_plan(model: Model[Any], source: str | os.PathLike[str]) -> Any:
    """Return the plan of `model` in a file.

    Parameters
    ----------
    model : Model
        What the plan is for.
    source : str or path-like
        A JSON file with a plan, with ``{"plan": …}``, or with a whole solution; ``"-"`` reads
        standard input.

    Raises
    ------
    InvalidData
        The file cannot be read, holds no plan, or none of this model.
    """
    text = (
        _decoded(sys.stdin.buffer.read(), "standard input") if source == "-" else read_text(source)
    )
    data = parse_json(text)
    if isinstance(data, Mapping) and "plan" in data:
        if data["plan"] is None:
            state = data.get("termination", "without a plan")
            raise InvalidData(f"{source}: the solution holds no plan ({state})", field="plan")
        data = data["plan"]
    return model.plan_from_data(data)


def writable(path: str | os.PathLike[str], suffixes: Sequence[str] = ()) -> Path:
    """Return the path of a file to write; whatever would keep it from being written raises now.

    Parameters
    ----------
    path : str or path-like
        The file.
    suffixes : sequence of str
        What its name may end in; anything where empty.
    """
    file = Path(path)
    if suffixes and file.suffix.lower() not in suffixes:
        raise InvalidData(
            f"{file}: the file's name must end in {', '.join(suffixes)}", field="file"
        )
    if not file.parent.is_dir():
        raise InvalidData(f"{file}: folder {file.parent} does not exist", field="file")
    exists = file.exists()
    _require_regular(file, file.stat() if exists else None)
    # What replaces the file is written beside it first.
    folder = Path(os.path.realpath(file)).parent
    if not os.access(folder, os.W_OK) or (exists and not os.access(file, os.W_OK)):
        raise InvalidData(f"{file}: cannot be written", field="file")
    return file


def number(text: str, where: str, field: str) -> float:
    """Return the finite number that `text` writes; `where` and `field` go into the message."""
    # float() alone would take nan, inf, 1_000 and the digits of every script.
    stripped = text.strip()
    value = float(stripped) if NUMBER.fullmatch(stripped) else math.nan
    if not math.isfinite(value):
        raise InvalidData(f"{where}: must be a finite number, got {show(text)}", field=field)
    return value
