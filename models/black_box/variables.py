"""Kinds of variables of black boxes: real, integer, category, and variables with a condition."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Declared
from ..fields import Optional, Real, Spec, Text, Whole, declared, show
from ..inputs import Field
from ..records import Member

__all__ = ["Condition", "Layout", "Variable", "VariableSpec", "VariableType"]

Floats = NDArray[np.float64]

#: Largest absolute bound of an integer variable; floats represent all integers up to it.
_LARGEST = 2.0**53


class VariableType(StrEnum):
    """Kinds of variables."""

    REAL = "real"  #: any number within the bounds
    INTEGER = "integer"  #: a whole number within the bounds
    CATEGORY = "category"  #: one of several values without an order; the variable is its index


class Condition(NamedTuple):
    """Condition under which a variable matters: another variable has one of several values.

    Parameters
    ----------
    variable : int
        Index of the other variable, an integer or a category.
    among : tuple of str or float
        Values for which the condition holds: labels of a category or their indices, or integers. The
        key in JSON is ``in``.
    """

    variable: int
    among: tuple[str | float, ...]


def _labels(name: str, value: Any) -> tuple[str | float, ...]:
    """Return a tuple of different strings and numbers, or raise."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Sequence):
        raise InvalidData(f"{name} must be a list, got {show(value)}", field=name)
    entries = tuple(
        (Text() if isinstance(entry, str) else Real()).coerce(f"{name}[{k}]", entry, {})
        for k, entry in enumerate(value)
    )
    if not entries or len(set(entries)) < len(entries):
        raise InvalidData(
            f"{name} must hold at least one value, each once, got {show(value)}", field=name
        )
    return entries


@dataclass(frozen=True)
class _Labels(Spec):
    """Tuple of different strings and numbers."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Any:
        return _labels(name, value)

    def encode(self, value: Any) -> Any:
        return list(value)


@dataclass(frozen=True)
class _ConditionSpec(Spec):
    """A :class:`Condition`, or its JSON data ``{"variable": k, "in": [...]}``."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Condition:
        if isinstance(value, Condition):
            value = {"variable": value.variable, "in": value.among}
        if not isinstance(value, Mapping) or set(value) != {"variable", "in"}:
            raise InvalidData(
                f"{name} must be an object with the keys 'variable' and 'in', got {show(value)}",
                field=name,
            )
        index = Whole(0).coerce(f"{name}.variable", value["variable"], {})
        return Condition(index, _labels(f"{name}.in", value["in"]))

    def encode(self, value: Condition) -> Any:
        return {"variable": value.variable, "in": list(value.among)}

    def feed(self, value: Condition) -> Iterable[bytes]:
        yield repr(tuple(value)).encode()


@dataclass(frozen=True, eq=False, repr=False)
class Variable(Declared):
    """Kind of one variable, and the condition under which it matters.

    Parameters
    ----------
    type : VariableType or str
        Kind of the variable.
    values : list of str or float, optional
        Values of a category. The function receives the index of the value, as a float.
    when : Condition or mapping, optional
        Condition, in JSON ``{"variable": k, "in": [...]}``. If it fails, or if variable `k` has itself a
        condition that fails, the variable has its lower bound, so that equal designs are equal points.
    """

    type: Field[str, VariableType] = declared(Member(VariableType), default=VariableType.REAL)
    values: Field[Sequence[str | float] | None, tuple[str | float, ...] | None] = declared(
        Optional(_Labels()), default=None, added=True
    )
    when: Field[Condition | Mapping[str, Any] | None, Condition | None] = declared(
        Optional(_ConditionSpec()), default=None, added=True
    )

    def check(self) -> None:
        """Raise for a category without values, and for values of another kind of variable."""
        if (self.type is VariableType.CATEGORY) != (self.values is not None):
            problem = "needs values" if self.values is None else "has no values"
            raise InvalidData(
                f"a variable of type {str(self.type)!r} {problem}: values belong to the type 'category'",
                field="values",
            )

    @property
    def is_discrete(self) -> bool:
        """Whether the variable is an integer or a category."""
        return self.type is not VariableType.REAL


@dataclass(frozen=True)
class VariableSpec(Spec):
    """A :class:`Variable`, its JSON data, or the name of its type."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Variable:
        if isinstance(value, Variable):
            return value
        data = {"type": value} if isinstance(value, str) else value
        try:
            return Variable.from_data(data)
        except InvalidData as error:
            raise InvalidData(f"{name}: {error}", field="variables") from error

    def encode(self, value: Variable) -> Any:
        data = value.data()
        return data["type"] if len(data) == 1 else data

    def feed(self, value: Variable) -> Iterable[bytes]:
        return value._feed()


class Layout:
    """Checked variables of a model: which are `discrete`, integers or categories, and when each one matters.

    Bounds that do not suit an integer or a category, and a condition with an unsuitable variable or value, raise
    ``InvalidData``.
    """

    def __init__(self, variables: tuple[Variable, ...] | None, bounds: Floats) -> None:
        self.bounds = bounds
        self.variables = variables or ()
        self.discrete = np.zeros(len(bounds), bool)
        for k, variable in enumerate(self.variables):
            self.discrete[k] = variable.is_discrete
            self._check_bounds(k, variable)
        #: Variable, the variable of its condition, and the values for which this holds; parents first.
        self.conditions: list[tuple[int, int, Floats]] = []
        self._order()

    def _check_bounds(self, k: int, variable: Variable) -> None:
        low, high = self.bounds[k].tolist()
        what, limit = "whole numbers up to 2^53", _LARGEST
        if variable.values is not None:
            last = len(variable.values) - 1
            what, limit = f"indices of its values, whole numbers from 0 to {last}", float(last)
        if variable.is_discrete and (
            low != np.rint(low)
            or high != np.rint(high)
            or high > limit
            or low < (0 if variable.values else -limit)
        ):
            raise InvalidData(
                f"bounds[{k}] of variable {k} of type {str(variable.type)!r} must be {what}, got "
                f"{show([low, high])}",
                field="bounds",
            )

    def _order(self) -> None:
        """Append the conditions so that each follows the condition of its parent."""
        remaining = {k: v.when for k, v in enumerate(self.variables) if v.when is not None}
        while remaining:
            ready = [k for k, when in remaining.items() if when.variable not in remaining]
            if not ready:
                raise InvalidData(
                    f"variables {', '.join(map(str, remaining))} have conditions that depend on one another "
                    "in a circle",
                    field="variables",
                )
            for k in ready:
                self.conditions.append(
                    (k, remaining[k].variable, self._allowed(k, remaining.pop(k)))
                )

    def _allowed(self, k: int, when: Condition) -> Floats:
        """Return the values of the other variable for which the condition of variable `k` holds."""
        where = f"variables[{k}].when"
        if when.variable >= len(self.variables) or not self.variables[when.variable].is_discrete:
            raise InvalidData(
                f"{where}.variable must be the index of an integer or a category, got {when.variable}",
                field="variables",
            )
        low, high = self.bounds[when.variable].tolist()
        labels = self.variables[when.variable].values or ()
        result = []
        for entry in when.among:
            value = labels.index(entry) if entry in labels else entry
            indices = not any(isinstance(label, float) for label in labels) or entry in labels
            whole = not isinstance(value, str) and float(value).is_integer()
            if not (whole and indices and low <= value <= high):
                allowed = ", ".join(map(repr, labels)) or f"{low:g} … {high:g}"
                raise InvalidData(
                    f"{where}.in must hold values of variable {when.variable} within its bounds ({allowed}), "
                    f"got {show(entry)}",
                    field="variables",
                )
            result.append(float(value))
        return np.array(result)

    def active(self, points: Floats) -> NDArray[np.bool_]:
        """Return whether each variable matters at points of shape (…, d)."""
        result = np.ones(points.shape, bool)
        for k, parent, allowed in self.conditions:
            result[..., k] = result[..., parent] & np.isin(points[..., parent], allowed)
        return result

    def canonical(self, points: Floats) -> Floats:
        """Return points of shape (…, d) within the bounds, rounded, with inactive variables at their bound."""
        result: Floats = np.clip(points, self.bounds[:, 0], self.bounds[:, 1])
        if self.discrete.any():
            result[..., self.discrete] = np.rint(result[..., self.discrete])
        if self.conditions:
            result = np.where(self.active(result), result, self.bounds[:, 0])
        return result
