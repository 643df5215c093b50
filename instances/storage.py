"""Instance files: models of any kind in JSON.

A file contains ``{"model": kind, "name": …, "data": {…}}``. If a problem stores a part of its data in
another file, as ``"points": "file.csv"``, the function registered for its kind replaces the reference
with the content.
"""

from __future__ import annotations

import inspect
import json
import logging
import os
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import BackendBroken, InvalidData, UnknownName
from ..files import LARGEST_FILE, as_path, read_bytes, read_input, read_text, write_text
from ..models.conversion import as_model
from ..models.fields import show
from ..models.json_text import parse_json
from ..models.model import Model
from ..models.problems import loadable, model_type, resolve, table

if TYPE_CHECKING:
    from .rows import TableOptions

__all__ = [
    "Assumed",
    "Find",
    "ReferredFiles",
    "joined",
    "model_of_table",
    "plan_in",
    "read_content",
    "read_model",
    "read_plan",
    "reference",
    "register_references",
    "write_model",
    "write_text",
]

log = logging.getLogger("crosstrack")

#: Function that returns the path of a file to which an instance refers by name, if it may be read.
Find = Callable[[str], Path]
#: Function (data, find) -> data that inserts the content of referenced files into an instance.
References = Callable[[Mapping[str, Any], Find], dict[str, Any]]

#: Functions registered by the user, by model kind.
_REGISTERED: dict[str, References] = {}


@dataclass(frozen=True)
class Assumed:
    """Value that the reader of a CSV or Excel file assumes if the file contains none.

    Parameters
    ----------
    value : object
        Data of the model; the user's data take precedence.
    """

    value: Any


def register_references(kind: str, function: References) -> References:
    """Register a function that resolves references of instance files to other files.

    Parameters
    ----------
    kind : str
        Kind of the model.
    function : callable
        Function from ``data`` as in the file, and a function ``find``, to the ``data`` of the model.
        ``find(name)`` returns the path of a file named in the instance, and raises
        :class:`~crosstrack.errors.InvalidData` if it must not be read.

    Returns
    -------
    callable
        `function`.
    """
    _REGISTERED[kind] = function
    return function


def reference(
    key: str,
    read: Callable[[Path], Mapping[str, Any]],
    *,
    only: bool = False,
    excluded: Sequence[str] = (),
) -> References:
    """Return a function that replaces ``key: "file"`` in an instance by the content of the file.

    Parameters
    ----------
    key : str
        Key of the instance's data whose value may be the name of a file.
    read : callable
        Function from the file to the data in it.
    only : bool
        Whether values other than names of files are refused.
    excluded : sequence of str
        Further keys that an instance with such a file must not have.
    """

    def resolved(data: Mapping[str, Any], find: Find) -> dict[str, Any]:
        result = dict(data)
        if not isinstance(result.get(key), str):
            if only and key in result:
                raise InvalidData(f"{key} must name a file, got {show(result[key])}", field=key)
            return result
        content = read(find(result.pop(key)))
        for name in (*content, *excluded):
            if name in result:
                raise InvalidData(f"{name} must not be given: the file holds it", field=name)
        return {**result, **content}

    resolved.__doc__ = f"Return instance data with a file named in {key!r} replaced by its content."
    return resolved


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
        File to read.
    trusted : bool
        Whether you trust the author. Only then are functions in CasADi's text format read, which
        can run code, and messages quote the files to which the instance refers.
    folder : path-like, optional
        Folder that may contain files to which the instance refers, in addition to the instance's own
        folder.

    Returns
    -------
    Model
        The model.

    Raises
    ------
    InvalidData
        The file is invalid; the message names the file, field, row and value.
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
                references = ReferredFiles(file.parent, roots)
                try:
                    data = resolve(readers[kind])(data, references.find)
                except InvalidData as error:
                    raise error if trusted else references.without_content(error) from None
                content = {**content, "data": data}
        return Model.from_dict(content, trusted=trusted)
    except InvalidData as error:
        raise InvalidData(f"{file}: {error}", field=error.field) from None
    except RecursionError:
        raise InvalidData(f"{file}: nested too deeply for an instance") from None


class ReferredFiles:
    """Files to which an instance refers: regular files below `roots`, of bounded total size."""

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
        # Resolve links first, because a name below the folder may lead out of it.
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
        """Return `error` without quoted content of a referenced file."""
        for file in self.files:
            # Not a longer name: room.map.scen refers to room.map.
            match = re.match(f"({re.escape(str(file))}(?:, line [0-9]+)?)[:, ]", str(error))
            if match:
                return InvalidData(
                    f"{match[1]}: not in the form that the model reads; with "
                    "trusted=True, on the command line with --trusted, the message says why",
                    field=error.field,
                )
        return error


def model_of_table(
    file: Path, given: Mapping[str, Any], kind: str | None, options: TableOptions | None = None
) -> Model[Any]:
    """Return the model of the data in a CSV or Excel file and of the additional data `given`.

    `kind` names the kind of model; by default the first kind that fits is used. A reader receives the
    `options` that are not None, and the given data that it has as keywords, such as ``steering_ratio``.
    """
    if not file.exists():
        raise InvalidData(f"{file}: no such file")
    readers = table(__package__, "TABLE_FILES")
    if kind is not None and kind not in readers:
        raise UnknownName("model that a CSV or Excel file holds data of", kind, readers)
    unread: dict[str, str] = {}
    lacking: dict[str, str] = {}
    for candidate in readers if kind is None else (kind,):
        read = resolve(readers[candidate])
        parameters = inspect.signature(read).parameters
        keywords = [x.name for x in parameters.values() if x.kind is x.KEYWORD_ONLY]
        taken = {key: given[key] for key in keywords if key in given}
        try:
            if options and not any(x.kind is x.VAR_KEYWORD for x in parameters.values()):
                raise InvalidData(f"{', '.join(options)} must be absent: its reader has no options")
            contents = read(file, **taken, **(options or {}))
        except (InvalidData, BackendBroken) as error:
            unread[candidate] = str(error)
            continue
        assumed = {
            key: value.value for key, value in contents.items() if isinstance(value, Assumed)
        }
        try:
            known = {key: value for key, value in contents.items() if key not in assumed}
            rest = {key: value for key, value in given.items() if key not in taken}
            data = {**assumed, **joined(known, rest)}
            result: Model[Any] = model_type(candidate).from_data(data, name=file.stem)
        except InvalidData as error:
            lacking[candidate] = str(error)
            continue
        for key in assumed.keys() - given.keys():
            log.warning("%s: %s is assumed, as the file holds none: data may give it", file, key)
        return result
    if not lacking:
        # The file itself, or an option, is invalid.
        if len(set(unread.values())) == 1 < len(unread):
            raise InvalidData(next(iter(unread.values())))
        _hint(file)
        if kind is not None:
            raise InvalidData(unread[kind])
    reasons: dict[str, str] = {}
    for candidate, reason in (lacking or unread).items():
        reasons[reason] = f"{reasons[reason]}, {candidate}" if reason in reasons else candidate
    description = (
        "data, and no whole instance" if lacking else "data of no model that is known here"
    )
    raise InvalidData(
        f"{file} holds {description}"
        + "".join(f"\n  {kinds}: {reason}" for reason, kinds in reasons.items())
        + "\ngive what is missing with --data KEY=VALUE on the command line or data={…} in Python, or "
        "in an instance file beside it that names this file in its data"
    )


def joined(contents: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields in a file and those that the user gives, or raise for a field in both."""
    for key in contents:
        if key in given:
            raise InvalidData(f"{key} must not be given: the file holds it", field=key)
    return {**contents, **given}


def _hint(file: Path) -> None:
    """Raise a problem's hint on a CSV file that is not part of an instance, if there is one."""
    if file.suffix.casefold() == ".csv":
        text = read_bytes(file).decode(errors="replace")
        first = next((line for line in text.splitlines() if line.strip()), "")
        for _, describe in loadable(__package__, "HINTS"):
            words: str = describe(file, first)
            if words:
                raise InvalidData(f"{file}: {words}")


def write_model(model: Model[Any], path: str | os.PathLike[str]) -> Path:
    """Write `model` as JSON exactly and atomically; return the path.

    Reading the file gives the same digest. Readers see either the old or the new content.

    Parameters
    ----------
    model : Model
        Model to write.
    path : path-like
        File to write.

    Returns
    -------
    pathlib.Path
        `path`.

    Raises
    ------
    InvalidData
        The file cannot be written.
    """
    return write_text(path, pretty(as_model(model).to_dict()))


def pretty(content: Mapping[str, Any]) -> str:
    """Return the JSON of an instance with one line per field and per row of a matrix."""

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
        Model of the plan.
    source : str or path-like
        JSON file with a plan, with ``{"plan": …}``, or with a complete solution; ``"-"`` for
        standard input.

    Returns
    -------
    plan
        Plan of the model's type; it is not verified.

    Raises
    ------
    InvalidData
        The file cannot be read, or contains no plan of this model.
    """
    return plan_in(as_model(model), read_content(source), source)


def read_content(source: str | os.PathLike[str]) -> Any:
    """Return the JSON data in a file, or in standard input for ``"-"``."""
    if isinstance(source, str) and source == "-":
        return parse_json(read_input())
    text = read_text(source)
    try:
        return parse_json(text)
    except InvalidData as error:
        raise InvalidData(f"{source}: {error}", field=error.field) from None


def plan_in(model: Model[Any], data: Any, source: str | os.PathLike[str]) -> Any:
    """Return the plan in the content of a file, whose name `source` is for messages; see :func:`read_plan`."""
    if isinstance(data, Mapping) and "plan" in data:
        if data["plan"] is None:
            state = data.get("termination", "without a plan")
            raise InvalidData(f"{source}: the solution holds no plan ({state})", field="plan")
        data = data["plan"]
    return model.plan_from_data(data)
