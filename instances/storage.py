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
from ..models.fields import required, show
from ..models.model import Model, as_model, parse_json
from ..models.problems import resolve, table

__all__ = [
    "LARGEST_FILE",
    "NUMBER",
    "Find",
    "as_path",
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

#: Bytes that a file may hold, and so may all files together that an instance refers to.
LARGEST_FILE = 256 << 20

#: Returns the path of a file that an instance refers to by name, where it may be read.
Find = Callable[[str], Path]
#: Puts the content of referenced files into the ``data`` of an instance: (data, find) -> data.
References = Callable[[Mapping[str, Any], Find], dict[str, Any]]

#: Functions of that type that users registered, by model kind.
_REGISTERED: dict[str, References] = {}


def register_references(kind: str, function: References) -> References:
    """Let instance files of the model `kind` refer to other files.

    Parameters
    ----------
    kind : str
        The model's JSON name.
    function : callable
        Takes ``data`` as it stands in the file, and a function ``find``; returns the ``data`` that
        the model understands. ``find(name)`` returns the path of a file that the instance names,
        and raises :class:`~crosstrack.errors.InvalidData` where it must not be read.
    """
    _REGISTERED[kind] = function
    return function


def read_model(
    path: str | os.PathLike[str],
    *,
    trusted: bool = False,
    folder: str | os.PathLike[str] | None = None,
) -> Model[Any]:
    """Return the model in a JSON file; file names in it are relative to its folder.

    Parameters
    ----------
    path : path-like
        The file.
    trusted : bool
        Whether you know who wrote it: functions in CasADi's own text, which can run code, are read
        then alone, and messages quote the files that the instance refers to.
    folder : path-like, optional
        Where the files may lie that it refers to; otherwise only below its own folder.

    Raises
    ------
    InvalidData
        Naming the file, and in it the field, the row and the value at fault.
    """
    file = as_path(path)
    text = read_text(file)
    try:
        content = parse_json(text)
        if isinstance(content, Mapping):
            kind, data = content.get("model"), content.get("data")
            readers = {**table(__package__, "REFERENCES"), **_REGISTERED}
            if isinstance(kind, str) and isinstance(data, Mapping) and kind in readers:
                roots = [file.parent] if folder is None else [file.parent, Path(folder)]
                found = _Found(file.parent, roots)
                try:
                    data = resolve(readers[kind])(data, found.find)
                except InvalidData as error:
                    raise error if trusted else found.without_content(error) from None
                content = {**content, "data": data}
        return Model.from_dict(content, trusted=trusted)
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None
    except RecursionError:
        raise InvalidData(f"{file}: nested too deeply for an instance") from None


class _Found:
    """The files that an instance refers to: regular ones below `roots`, of bounded size."""

    def __init__(self, home: Path, roots: Sequence[Path]) -> None:
        self.home = home
        self.roots = [Path(os.path.realpath(root)) for root in roots]
        self.files: list[Path] = []
        self.left = LARGEST_FILE

    def find(self, name: str) -> Path:
        """Return the path of the file called `name`, relative to the instance's folder."""
        label = f"the file {show(name)} that the instance refers to"
        if "\0" in name or Path(name).is_absolute():
            raise InvalidData(f"{label} must be named relative to the instance's folder")
        # Links are followed first: a name below the folder may lead out of it.
        file = Path(os.path.realpath(self.home / name))
        if not any(file.is_relative_to(root) for root in self.roots):
            raise InvalidData(
                f"{label} must lie below the instance's folder, or below one that you name with "
                "folder=, on the command line with --folder"
            )
        try:
            state = file.stat()
        except OSError as error:
            missing = isinstance(error, FileNotFoundError)
            reason = "no such file" if missing else f"cannot be read: {error.strerror}"
            raise InvalidData(f"{file}: {reason}") from None
        if not stat.S_ISREG(state.st_mode):
            raise InvalidData(f"{label} must be a regular file")
        self.left -= state.st_size
        if self.left < 0:
            raise InvalidData(f"{label} is too large: {LARGEST_FILE} bytes may be read in all")
        self.files.append(file)
        return file

    def without_content(self, error: InvalidData) -> InvalidData:
        """Return `error` without what it quotes of a file that was found."""
        for file in self.files:
            if str(error).startswith(str(file)):
                line = re.match(", line [0-9]+", str(error)[len(str(file)) :])
                return InvalidData(
                    f"{file}{line[0] if line else ''}: not in the form that the model reads; with "
                    "trusted=True, on the command line with --trusted, the message says why",
                    field=error.field,
                )
        return error


def write_model(model: Model[Any], path: str | os.PathLike[str]) -> Path:
    """Write `model` as JSON, exactly and in one step; return the path.

    Reading the file back gives the same digest. A reader never sees half a file.
    """
    return write_text(path, pretty(as_model(model).to_dict()))


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


def as_path(path: Any) -> Path:
    """Return `path` as a path; what is none raises."""
    try:
        found = Path(path)
        os.fsencode(found)
        return found
    except (TypeError, UnicodeEncodeError):
        raise InvalidData(f"path must name a file, got {show(path)}", field="path") from None


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the UTF-8 text of a file, without its byte-order mark; lines end as they stand.

    The file may be a pipe; more than :data:`LARGEST_FILE` bytes raise.
    """
    file = as_path(path)
    try:
        with file.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InvalidData(f"{file}: no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidData(f"{file}: cannot be read: {reason}") from None
    if len(raw) > LARGEST_FILE:
        raise InvalidData(f"{file}: holds more than {LARGEST_FILE} bytes")
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
        raw = required("text", text, str).encode()
    except UnicodeEncodeError as error:
        raise InvalidData(f"{path}: {text[error.start]!r} cannot be written as UTF-8") from None
    return write_bytes(path, raw)


def write_bytes(path: str | os.PathLike[str], raw: bytes) -> Path:
    """Write `raw` in one step, as :func:`write_text` does; an existing file keeps its mode."""
    file = as_path(path)
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
    model = as_model(model)
    standard = isinstance(source, str) and source == "-"
    text = _decoded(sys.stdin.buffer.read(), "standard input") if standard else read_text(source)
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
    file = as_path(path)
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
