"""Specifications of fields: how a value is coerced, checked, frozen and written as JSON.

A model declares each field with a :class:`Spec`; :class:`~crosstrack.models.model.Model` applies
them. Strings are never converted to numbers and NaN is always rejected. Infinity is allowed only if
its spec has an ``infinity``, and JSON writes it as ``null``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .arrays import Array as Array, Broadcast as Broadcast, NumberTuple as NumberTuple
    from .specs import (
        TRUSTED as TRUSTED,
        Flag as Flag,
        Optional as Optional,
        Real as Real,
        Spec as Spec,
        Text as Text,
        Whole as Whole,
        declared as declared,
        frozen as frozen,
        required as required,
        show as show,
        unwritable as unwritable,
    )

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__package__, __file__)
