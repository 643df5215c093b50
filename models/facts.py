"""Facts about the fields of a class: type, unit, default and meaning, from its declaration and docstring."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from .declaration import Nested
from .specs import Optional

__all__ = ["Fact", "field_facts"]

#: Section Parameters of a docstring, one of its entries, and a description that refers to another class.
_SECTION = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n--|\Z)", re.M | re.S)
_ENTRY = re.compile(r"^(\w[^\n]*?)(?: : ([^\n]*))?\n((?: [^\n]*(?:\n|\Z)|\n)*)", re.M)
_REFERENCE = re.compile(r"As in :class:`~?(?:[\w.]*\.)?(\w+)`\.?$")


class Fact(NamedTuple):
    """Facts about one field.

    Parameters
    ----------
    name : str
        Name of the constructor's argument and of the key in JSON; ``recording.times`` for a field of
        a nested object.
    type : str
        Type as documented.
    unit : str
        Unit; empty for none, or if it depends on other fields.
    required : bool
        Whether the constructor needs the argument.
    default : object
        Default as JSON data; None for required fields and for fields that are absent by default.
    hidden : bool
        Whether backends do not receive the field.
    meaning : str
        Description in words.
    """

    name: str
    type: str
    unit: str
    required: bool
    default: Any
    hidden: bool
    meaning: str


def field_facts(cls: type, prefix: str = "") -> Iterator[Fact]:
    """Yield the facts about each argument of a class with declared fields, nested objects included.

    Parameters
    ----------
    cls : type
        Subclass of :class:`~crosstrack.models.Model` or another class with declared fields.
    prefix : str
        Text before each name.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}
    texts = _documented(cls)
    for argument in inspect.signature(cls).parameters.values():
        if argument.kind is argument.VAR_KEYWORD:  # of a constructor that returns a builder
            continue
        field = fields.get(argument.name)
        spec = field.metadata.get("spec") if field is not None else None
        spec = spec.spec if isinstance(spec, Optional) else spec
        required = argument.default is argument.empty
        default = None if required else argument.default
        if field is not None and field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        kind, meaning = texts.get(argument.name, ("", ""))
        hidden = field is not None and bool(field.metadata.get("hidden"))
        unit = getattr(spec, "unit", "")
        yield Fact(prefix + argument.name, kind, unit, required, default, hidden, meaning)
        if isinstance(spec, Nested):
            yield from field_facts(spec.kind, f"{prefix}{argument.name}.")


def _documented(cls: type) -> dict[str, tuple[str, str]]:
    """Return documented type and description of each argument, from the classes in order of resolution."""
    result = {"name": ("str", "Label of the instance, which is not part of the content.")}
    for base in cls.__mro__:
        section = _SECTION.search((inspect.getdoc(base) or "").replace("\\\n", ""))
        for names, kind, text in _ENTRY.findall(section[1]) if section else ():
            meaning = " ".join(re.sub(r":\w+:`~?([^`]*)`|``?([^`]*)``?", r"\1\2", text).split())
            reference = _REFERENCE.match(" ".join(text.split()))
            other: dict[str, tuple[str, str]] = {}
            if reference is not None:
                from .. import models

                other = _documented(getattr(models, reference[1]))
            for name in names.split(", "):
                result.setdefault(name, other.get(name, (kind, meaning)))
    return result
