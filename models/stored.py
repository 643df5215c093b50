"""Stored records: checks, verifications and those of other modules, also of earlier versions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..errors import InvalidData
from .records import Sequence
from .specs import Optional, Real, Spec, Text, show

__all__ = ["check_fields", "recorded", "verification_fields"]

#: Entries of stored checks and verifications; null means infinity.
_CHECK: dict[str, Spec] = {
    "name": Text(),
    "equation": Text(),
    "worst": Optional(Real()),
    "unit": Text(),
    "tolerance": Optional(Real()),
    "where": Text(),
    "rounding": Optional(Real()),
    "scale": Optional(Real()),
    "limit": Optional(Real()),
}
_VERIFICATION: dict[str, Spec] = {
    "objective": Optional(Real()),
    "checks": Sequence(),
    "spread": Real(0.0),
    "scale": Optional(Real()),
    "bound": Optional(Real()),
    "proof": Text(),
}


def recorded(
    what: str, data: Any, specs: Mapping[str, Spec], defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the checked entries of a stored record; entries of later versions are omitted.

    Parameters
    ----------
    what : str
        Name of the record in messages.
    data : mapping
        The record.
    specs : mapping of str to Spec
        Specification of each entry.
    defaults : mapping
        Values of entries that older records lack. Entries without a default are required.

    Raises
    ------
    InvalidData
        An entry is missing or invalid.
    """
    if not isinstance(data, Mapping):
        raise InvalidData(f"{what} must be an object, got {show(data)}", field="data")
    for key in specs:
        if key not in data and key not in defaults:
            raise InvalidData(f"key {key!r} is missing in {what}", field=key)
    return {
        key: spec.coerce(key, data[key], {}) if key in data else defaults[key]
        for key, spec in specs.items()
    }


def check_fields(data: Any, defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the checked entries of a stored check; the parameters are those of :func:`recorded`."""
    entries = recorded("a check", data, _CHECK, defaults)
    infinite = ("worst", "tolerance", "rounding", "scale")
    return {**entries, **{key: _infinity_if_none(entries[key]) for key in infinite}}


def verification_fields(data: Any, defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the checked entries of a stored verification, its checks as entries, too."""
    entries = recorded("a verification", data, _VERIFICATION, defaults)
    return {**entries, "scale": _infinity_if_none(entries["scale"])}


def _infinity_if_none(value: float | None) -> float:
    return math.inf if value is None else value
