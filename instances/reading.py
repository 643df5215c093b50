"""Models in files of any format: the choice of the model, and messages on what is missing."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InvalidData, UnknownName, UnsupportedOption, suggestion
from ..models.conversion import as_model
from ..models.fields import show
from ..models.model import Model
from ..models.problems import loadable_models, resolve
from .file_format import FileFormat, Head, Target
from .formats import file_formats, recognise
from .storage import ReferredFiles, model_of_table, read_model

if TYPE_CHECKING:
    from .rows import TableOptions

__all__ = ["read_file", "read_instance", "read_table_file"]

#: Text after the example of a command.
_EXAMPLE = "(values are examples; in Python: model=…, data={…})"


def read_file(
    file: Path,
    *,
    data: Mapping[str, Any],
    model: str | None,
    trusted: bool = False,
    folder: str | os.PathLike[str] | None = None,
    table_options: TableOptions,
) -> Model[Any]:
    """Return the model in a file of any format; see :func:`crosstrack.load` for the parameters."""
    if file.is_file() and not file.stat().st_size:
        raise InvalidData(f"{file}: the file is empty")
    if not file.is_file() and (data or model is not None or table_options):
        raise InvalidData(
            f"{file}: a pipe must hold an instance in JSON; save other data to a file"
        )
    form = recognise(file)
    if form is None:
        known = ", ".join(item.name for item in file_formats() if item.targets)
        raise InvalidData(
            f"{file}: its format is unknown; convert it to one that crosstrack reads, such as CSV, "
            f"GeoJSON or an instance in JSON (all formats: {known})"
        )
    if not form.targets:
        raise InvalidData(f"{file} is {form.title}: {form.remedy.format(file=file)}")
    roots = [file.parent] if folder is None else [file.parent, Path(folder)]
    context = {
        "model": model,
        "trusted": trusted,
        "folder": folder,
        "form": form.name,
        "table_options": table_options,
    }
    task = _Task(file, form, dict(data), context, ReferredFiles(file.parent, roots))
    targets = form.targets
    if model is not None and "" not in targets:
        if model not in targets:
            raise UnknownName(f"model that {form.title} can become", model, targets)
        targets = {model: targets[model]}
    return _model(task, targets)


class _Task(NamedTuple):
    """File to read, its format, the data and options of the user, and the files beside it."""

    file: Path
    form: FileFormat
    data: dict[str, Any]
    context: dict[str, Any]
    files: ReferredFiles


def _model(task: _Task, targets: Mapping[str, Target]) -> Model[Any]:
    """Return the model of the only target that the data fit, or raise with the way to choose."""
    file, form, data = task.file, task.form, task.data
    complete = {kind: item for kind, item in targets.items() if item.needs.keys() <= data.keys()}
    if len(targets) == 1 and complete:
        [(kind, target)] = complete.items()
        return _built(task, kind, target)
    models: dict[str, Model[Any]] = {}
    reasons: dict[str, InvalidData] = {}
    for kind, target in complete.items():
        try:
            models[kind] = _built(task, kind, target)
        except InvalidData as error:
            reasons[kind] = error
    if len(models) == 1:
        return next(iter(models.values()))
    if models:
        names = " or ".join(f"--as {kind}" for kind in models)
        raise InvalidData(f"{file} is {form.title}, and the data fit several models: add {names}")
    if len(set(map(str, reasons.values()))) == 1:
        raise next(iter(reasons.values()))
    partial = [kind for kind, item in targets.items() if item.needs.keys() & data.keys()]
    lines = []
    for kind in reasons or partial or targets:
        lacking = {key: text for key, text in targets[kind].needs.items() if key not in data}
        lines.append(
            f"{kind}: {reasons[kind]}"
            if kind in reasons
            else f"{kind} needs {', '.join(lacking)}: {_command(file, kind, data, lacking)}"
        )
    title = f"{file} is {form.title}, which lacks data"
    raise InvalidData(
        f"{title}: {lines[0]} {_EXAMPLE}"
        if len(lines) == 1
        else f"{title}; it can become several models: choose with --as\n  "
        + "\n  ".join(lines)
        + f"\n{_EXAMPLE}"
    )


def _command(file: Path, kind: str, data: Mapping[str, Any], more: Mapping[str, str]) -> str:
    """Return the command that solves `file` with its data, and `more` as JSON text."""
    values = {**{key: json.dumps(value, default=str) for key, value in data.items()}, **more}
    options = (word for key, text in values.items() for word in ("--data", f"{key}={text}"))
    return shlex.join(["crosstrack", "solve", str(file), "--as", kind, *options])


def _built(task: _Task, kind: str, target: Target) -> Model[Any]:
    """Return the model from the reader of a target."""
    file, data = task.file, task.data
    context = {**task.context, "find": task.files.find}
    reader = resolve(target.reader)
    parameters = dict(inspect.signature(reader).parameters)
    first = next(iter(parameters))
    passed = {name: value for name, value in context.items() if name in parameters}
    open_ended = any(item.kind is item.VAR_KEYWORD for item in parameters.values())
    known = [
        name
        for name, item in parameters.items()
        if name not in (first, *context) and item.kind is not item.VAR_KEYWORD
    ]
    if (data and not known and not open_ended) or (
        not kind and context["model"] is not None and "model" not in parameters
    ):
        raise UnsupportedOption(
            f"{file} is read as a whole instance: data and model are for files that hold a part of one, "
            "such as CSV or GeoJSON"
        )
    if context["table_options"] and "table_options" not in parameters:
        names = ", ".join(context["table_options"])
        raise UnsupportedOption(
            f"{file} is {task.form.title}: only CSV and Excel files have {names}"
        )
    for key in data:
        if key in (first, *context) or (not open_ended and key not in known):
            raise InvalidData(
                f"{file}: unknown key {show(key)} of --data; {suggestion(key, known)}"
                f"allowed: {', '.join(known) or 'the fields of the model'}",
                field=str(key),
            )
    try:
        result: Model[Any] = as_model(reader(file, **data, **passed))
    except InvalidData as error:
        trusted = task.context["trusted"]
        message = str(error if trusted else task.files.without_content(error))
        if str(file) not in message:
            message = f"{file}: {message}"
        if task.form.remedy:
            message += f"; {task.form.remedy}"
        if error.field and error.field in target.may and error.field not in data:
            lacking = {error.field: target.may[error.field]}
            message += f"\n  {_command(file, kind, data, lacking)} {_EXAMPLE}"
        raise InvalidData(message, field=error.field) from None
    return result if result.name else result.renamed(file.name.partition(".")[0])


def read_table_file(
    path: Path, *, model: str | None, table_options: TableOptions, **data: Any
) -> Model[Any]:
    """Return the model of a table and of further data; see :func:`.storage.model_of_table`."""
    return model_of_table(path, data, model, table_options)


def read_instance(
    path: Path, *, trusted: bool, folder: str | os.PathLike[str] | None
) -> Model[Any]:
    """Return the instance in a JSON file, or raise if it contains a plan."""
    keys = Head.of(path).keys.keys()
    if keys and not keys & {"model", "data"}:
        kinds = [
            kind
            for kind, cls in loadable_models()
            if dataclasses.is_dataclass(cls.plan_type)
            and keys <= {"ids", *(field.name for field in dataclasses.fields(cls.plan_type))}
        ]
        if kinds:
            raise InvalidData(
                f"{path}: a plan (for {', '.join(kinds)}), but an instance is needed: verify it "
                f"with crosstrack check INSTANCE {path}"
            )
    loaded = read_model(path, trusted=trusted, folder=folder)
    return loaded if loaded.name else loaded.renamed(path.stem)
