"""Instance files: models read from JSON and written to it, whatever their kind.

A file holds ``{"model": kind, "name": …, "data": {…}}``. Where a problem keeps part of its data in
a file beside it, as ``"points": "file.csv"``, the function registered for its kind puts the content
in the place of the reference.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InvalidData
from ..files import LARGEST_FILE, as_path, read_input, read_text, write_text
from ..models.fields import show
from ..models.model import Model, as_model, parse_json
from ..models.problems import resolve, table

__all__ = [
    "NUMBER",
    "Find",
    "number",
    "read_model",
    "read_plan",
    "register_references",
    "write_model",
    "write_text",
]

#: Numbers as files may write them.
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")

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
    text = read_input() if standard else read_text(source)
    data = parse_json(text)
    if isinstance(data, Mapping) and "plan" in data:
        if data["plan"] is None:
            state = data.get("termination", "without a plan")
            raise InvalidData(f"{source}: the solution holds no plan ({state})", field="plan")
        data = data["plan"]
    return model.plan_from_data(data)


def number(text: str, where: str, field: str) -> float:
    """Return the finite number that `text` writes; `where` and `field` go into the message."""
    # float() alone would take nan, inf, 1_000 and the digits of every script.
    stripped = text.strip()
    value = float(stripped) if NUMBER.fullmatch(stripped) else math.nan
    if not math.isfinite(value):
        raise InvalidData(f"{where}: must be a finite number, got {show(text)}", field=field)
    return value
