"""Specifications of the fields of fleet routing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, Spec, Whole, declared, frozen, show
from ..inputs import Field
from ..specs import as_number, count_rows

__all__ = [
    "Count", "Depots", "EachVehicle", "Loads", "NameLists", "NodeList", "NodeLists", "Prizes", "Shifts",
    "Spans", "Windows", "added",
]  # fmt: skip

#: Windows of one node, or None for a node without windows.
Spans = tuple[tuple[float, float], ...] | None
#: Types of optional fields: nodes, lists of nodes, and lists of names.
NodeList = Field[Sequence[int] | None, tuple[int, ...] | None]
NodeLists = Field[Sequence[Sequence[int]] | None, tuple[tuple[int, ...], ...] | None]
NameLists = Field[Sequence[Sequence[str]] | None, tuple[tuple[str, ...], ...] | None]


class EachVehicle(Array):
    """Array with one number per vehicle; a scalar applies to all vehicles."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        array = self._numbers(name, value)
        if array.ndim == 0:
            number = float(array)
            if not (self.infinity and number == self.infinity * math.inf):
                number = Real(self.lower).coerce(name, value, {})
            array = np.full(sizes["vehicles"][0], number)
        return super().coerce(name, array, sizes)


class Loads(EachVehicle):
    """Amounts in one dimension, shape (rows,), or in several, shape (rows, dimensions)."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        if len(self.shape) == 1 and self._numbers(name, value).ndim == 2:
            spec = Array((self.shape[0], "dimensions"), lower=self.lower)
            return spec.coerce(name, value, sizes)
        if self.shape[0] != "vehicles":
            return Array.coerce(self, name, value, sizes)
        return super().coerce(name, value, sizes)


class Count(Whole):
    """Number of vehicles, which sets the size of other fields."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> int:
        count = super().coerce(name, value, sizes)
        sizes["vehicles"] = (count, name)
        return count


class Depots(Array):
    """Depot of all vehicles, or one depot per vehicle."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        array = self._numbers(name, value)
        if array.ndim == 0:
            array = np.array([Whole(0).coerce(name, value, {})])
        return super().coerce(name, array, sizes)


class Windows(Spec):
    """For each node None, one window (begin, end), or several; an end of None is infinite."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[Spans, ...]:
        rows = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(rows, list | tuple):
            raise InvalidData(f"{name} must be a list, got {show(value)}", field=name)
        result = tuple(self._node(f"{name}[{k}]", row, name) for k, row in enumerate(rows))
        count_rows(name, len(result), "n", sizes)
        return result

    def _node(self, place: str, value: Any, field: str) -> Spans:
        if value is None:
            return None
        rows = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(rows, list | tuple) or not rows:
            raise InvalidData(
                f"{place} must be None, a pair (begin, end) or a list of pairs, got {show(value)}",
                field=field,
            )
        if not isinstance(rows[0], list | tuple | np.ndarray):
            rows = [rows]
        spans = []
        for row in rows:
            if not isinstance(row, list | tuple | np.ndarray) or len(row) != 2:
                raise InvalidData(
                    f"{place} must hold pairs (begin, end), got {show(row)}", field=field
                )
            begin = as_number(place, row[0], field)
            end = math.inf if row[1] is None else as_number(place, row[1], field)
            if not math.isfinite(begin) or not end >= begin:
                raise InvalidData(
                    f"{place} must begin at a finite time and end no earlier, got ({begin:g}, {end:g})",
                    field=field,
                )
            spans.append((begin + 0.0, end + 0.0))
        return tuple(sorted(spans))

    def encode(self, value: tuple[Spans, ...]) -> Any:
        def pairs(spans: Spans) -> Any:
            return spans and [[a, None if b == math.inf else b] for a, b in spans]

        return [pairs(spans) for spans in value]


class Shifts(Array):
    """Earliest departure and latest return of each vehicle; one pair applies to all vehicles."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        array = self._numbers(name, value)
        if array.shape == (2,):
            array = np.tile(array, (sizes["vehicles"][0], 1))
        return super().coerce(name, array, sizes)


class Prizes(Array):
    """Prize of each node; NaN, or None in JSON, for a node that must be visited."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        rows = value.tolist() if isinstance(value, np.ndarray) and value.ndim == 1 else value
        missing: Any = False
        if isinstance(rows, list | tuple):
            missing = [
                row is None or (isinstance(row, float | np.floating) and math.isnan(row)) for row in rows
            ]  # fmt: skip
            rows = [0.0 if gone else row for row, gone in zip(rows, missing, strict=True)]
        return frozen(np.where(missing, math.nan, super().coerce(name, rows, sizes)))

    def encode(self, value: NDArray[Any]) -> Any:
        return [None if math.isnan(prize) else prize for prize in value.tolist()]


def added(spec: Spec) -> Any:
    """Return the declaration of an optional field that JSON and digests omit if it is absent."""
    return declared(Optional(spec), added=True, default=None)
