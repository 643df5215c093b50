"""Conversion of objects that describe a model."""

from __future__ import annotations

from typing import Any

from ..errors import InvalidData
from .model import Model
from .problems import resolve
from .specs import show

__all__ = ["as_model"]


def as_model(value: Any) -> Model[Any]:
    """Return `value` if it is a model, else the model that it describes.

    That is the result of its method ``build()``, or the program of another library's object.

    Raises
    ------
    InvalidData
        `value` is neither a model nor describes one.
    """
    if isinstance(value, Model):
        return value
    convert = resolve(".models.programs.sources.conversion:converted")
    program: Model[Any] | None = convert(value)
    if program is not None:
        return program
    result = value.build() if callable(getattr(value, "build", None)) else value
    if not isinstance(result, Model):
        libraries = resolve(".models.programs.sources.conversion:objects")()
        hint = f"; also accepted: objects of {', '.join(sorted(libraries))}, and arrays by name"
        if isinstance(value, str):
            hint = "; load it first: crosstrack.load(…)"
        raise InvalidData(f"model must be a Model, got {show(value)}{hint}", field="model")
    return result
