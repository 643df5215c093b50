"""Files to fill in: a small valid instance of a model as JSON, or a part of one as CSV or Excel file."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BackendMissing, InvalidData, UnsupportedFormulation, UnsupportedOption
from ..models.model import Model
from ..models.problems import loadable_models, model_type, resolve, table
from ..models.programs import Program
from .catalogue import entries, entry
from .storage import Assumed, pretty
from .tables import table_text

__all__ = ["example", "template", "template_formats"]


def template_formats(kind: str) -> tuple[str, ...]:
    """Return the formats of templates for a kind of model: ``json``, and ``csv`` and ``xlsx`` if a reader exists.

    Parameters
    ----------
    kind : str
        Kind of the model.
    """
    return ("json", "csv", "xlsx") if kind in table(__package__, "TABLE_COLUMNS") else ("json",)


def template(kind: str, form: str = "json") -> tuple[bytes, dict[str, Any]]:
    """Return a file to fill in, and the data that it lacks.

    The file is the smallest instance of the catalogue that its format can express.

    Parameters
    ----------
    kind : str
        Kind of the model.
    form : {"json", "csv", "xlsx"}
        Format of the file.

    Returns
    -------
    content : bytes
        Content of the file.
    data : dict
        Data of the model that complete a CSV or Excel file, for ``load(file, data=data, model=kind)``; empty for JSON.

    Raises
    ------
    UnknownName
        The kind is unknown.
    UnsupportedOption
        The model has no template in this format, or no instance in the catalogue.
    BackendMissing
        The format is ``xlsx``, and openpyxl is not installed.
    """
    model_type(kind)
    if form not in template_formats(kind):
        raise UnsupportedOption(
            f"template must be {' or '.join(template_formats(kind))} for model {kind!r}, got {form!r}"
        )
    if form == "json":
        return pretty(example(kind).to_dict()).encode(), {}
    labels = table(__package__, "TABLE_COLUMNS")[kind]
    for model in _examples(kind):
        columns = {label: _values(model, path) for label, path in labels.items()}
        header = [label for label, values in columns.items() if values is not None]
        rows = [*zip(*(columns[label] for label in header), strict=True)]
        try:
            data = _missing_data(model, table_text(header, rows)) if rows else None
        except InvalidData:  # a table cannot express this instance, such as a free coordinate
            continue
        if data is not None:
            content = (
                table_text(header, rows).encode() if form == "csv" else _workbook(header, rows)
            )
            return content, data
    raise UnsupportedOption(f"the catalogue has no instance of model {kind!r} in a table: use json")


def example(kind: str) -> Model[Any]:
    """Return the smallest instance of a kind in the catalogue, or a small program.

    Parameters
    ----------
    kind : str
        Kind of the model.

    Raises
    ------
    UnknownName
        The kind is unknown.
    UnsupportedOption
        The catalogue has no instance of this kind that a file can hold.
    """
    model = next(_examples(kind), None)
    if model is not None:
        return model
    if issubclass(model_type(kind), Program):
        for other, cls in loadable_models():
            for name in cls.formulations:
                if cls.formulation_type(name).program_type.kind == kind:
                    with suppress(UnsupportedFormulation):
                        program: Model[Any] = example(other).formulate(name).program
                        return program
    raise UnsupportedOption(
        f"the catalogue has no instance of model {kind!r} as an example: add one with register_entry"
    )


def _examples(kind: str) -> Iterator[Model[Any]]:
    """Yield the declared instance of a kind, or those of the catalogue, the shortest JSON text first."""
    declared = table(__package__, "TEMPLATES").get(kind)
    if declared is not None:  # building all instances of the kind takes seconds
        yield entry(declared).build()
        return
    found = []
    for candidate in entries():
        if candidate.model == kind:
            model = candidate.build()
            try:
                found.append((len(model.to_json()), candidate.name, model))
            except InvalidData:  # such as a function of Python
                continue
    yield from (model for _, _, model in sorted(found, key=lambda item: item[:2]))


def _values(model: Model[Any], path: str) -> list[Any] | None:
    """Return the values at a path of attributes and of one column, such as ``points.0``; None if absent."""
    value: Any = model
    for part in path.split("."):
        if part.isdecimal() and value is not None:
            value = value[:, int(part)] if int(part) < value.shape[1] else None
        elif value is not None:
            value = getattr(value, part)
    return None if value is None else np.asarray(value, object).tolist()


def _missing_data(model: Model[Any], text: str) -> dict[str, Any]:
    """Return the data of `model` that its table lacks; without one of them another model results."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "template.csv"
        file.write_text(text, "utf-8")
        contents: Mapping[str, Any] = resolve(table(__package__, "TABLE_FILES")[model.kind])(file)
    assumed = {key: value.value for key, value in contents.items() if isinstance(value, Assumed)}
    known = {**contents, **assumed}
    rest = {key: value for key, value in model.data().items() if key not in known or key in assumed}
    digest = type(model).from_data({**known, **rest}).digest
    for key in tuple(rest):
        fewer = {name: value for name, value in rest.items() if name != key}
        try:
            if type(model).from_data({**known, **fewer}).digest == digest:
                rest = fewer
        except InvalidData:  # the field is required
            continue
    return json.loads(json.dumps(rest))  # type: ignore[no-any-return]


def _workbook(header: list[str], rows: list[tuple[Any, ...]]) -> bytes:
    """Return an Excel file with one sheet."""
    try:
        import openpyxl
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"Excel files need openpyxl, which is not installed ({error}): "
            "pip install 'crosstrack[xlsx]', or use csv"
        ) from None
    book = openpyxl.Workbook()
    for row in (header, *rows):
        book.active.append(list(row))
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()
