"""Piecewise polynomials of time, in Lagrange form on distinct nodes of each interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..fields import Array, Whole, frozen, show
from .lagrange import barycentric_weights, differentiation, interpolation

__all__ = ["Piecewise"]

Floats = NDArray[np.float64]

#: Largest distance of a time from the interval that is attributed to rounding, relative to its length.
EDGE = 1e-9
#: Number of points in an interval above which it is evaluated by itself.
CROWD = 64
#: Smallest excess over a saturation limit that is a saturation, relative to the size of the function.
EXCESS = 1e-9
#: Number of points per node at which a polynomial is compared with its limits, and largest share by
#: which it exceeds its largest magnitude there (Ehlich and Zeller, Math. Z. 86, 1964).
DENSITY, BETWEEN = 8, 0.02


def _joined(
    nodes: Sequence[Any], values: Sequence[Any]
) -> tuple[list[Floats], list[Floats]] | None:
    """Return read-only nodes and values, checked all at once; None if one of them is not plain or is wrong."""
    arrays = (*nodes, *values)
    if not all(type(array) is np.ndarray and array.dtype == np.float64 for array in arrays):
        return None
    ranks = {array.ndim for array in nodes}, {array.ndim for array in values}
    if ranks != ({1}, {2}) or len({table.shape[1] for table in values}) > 1:
        return None
    if [len(table) for table in values] != [positions.size for positions in nodes]:
        return None
    distinct = {positions.tobytes(): positions for positions in nodes}
    for key, positions in distinct.items():
        inside = positions.size and positions[0] >= -1.0 and positions[-1] <= 1.0
        if not inside or not (np.diff(positions) > 0).all():
            return None
        distinct[key] = frozen(positions + 0.0)
    table = frozen(np.concatenate(values) + 0.0)
    if not np.isfinite(table).all():
        return None
    cuts = np.cumsum([positions.size for positions in nodes])[:-1]
    return [distinct[positions.tobytes()] for positions in nodes], np.split(table, cuts)


@dataclass(frozen=True, eq=False, repr=False)
class Piecewise:
    """Vector of functions of time, with one polynomial in Lagrange form per interval.

    Parameters
    ----------
    knots : ndarray, shape (intervals + 1,)
        Ends of the intervals, increasing.
    nodes : tuple of ndarray
        Distinct positions of the nodes in [-1, 1], one array per interval; -1 is its start and 1 its
        end.
    values : tuple of ndarray, shape (nodes, size)
        Values at the nodes, one array per interval.
    lower, upper : ndarray, shape (size,), optional
        Saturation limits: values beyond are clipped, as by an actuator.
    """

    knots: Floats
    nodes: tuple[Floats, ...]
    values: tuple[Floats, ...]
    lower: Floats | None = None
    upper: Floats | None = None

    def __post_init__(self) -> None:
        knots = Array(("knots",)).coerce("knots", self.knots, {})
        if knots.size < 2 or not (np.diff(knots) > 0).all():
            raise InvalidData(f"knots must increase, got {show(knots.tolist())}", field="knots")
        count = knots.size - 1
        for name in ("nodes", "values"):
            if not isinstance(getattr(self, name), list | tuple):
                raise InvalidData(
                    f"{name} must be a list with one entry per interval, got {show(getattr(self, name))}",
                    field=name,
                )
        if len(self.nodes) != count or len(self.values) != count:
            raise InvalidData(
                f"{count} intervals need as many nodes and values, "
                f"got {len(self.nodes)} and {len(self.values)}",
                field="nodes",
            )
        sizes: dict[str, tuple[int, str]] = {}
        nodes, values = _joined(self.nodes, self.values) or self._read(sizes)
        sizes["size"] = values[0].shape[1], "values[0]"
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "nodes", tuple(nodes))
        object.__setattr__(self, "values", tuple(values))
        for name, sign in (("lower", -1), ("upper", 1)):
            if getattr(self, name) is not None:
                bound = Array(("size",), infinity=sign).coerce(name, getattr(self, name), sizes)
                object.__setattr__(self, name, bound)

    def _read(self, sizes: dict[str, tuple[int, str]]) -> tuple[list[Floats], list[Floats]]:
        """Return nodes and values, read interval by interval for messages that name the interval."""
        nodes: list[Floats] = []
        values: list[Floats] = []
        for k in range(len(self.nodes)):
            positions = Array(("n",), lower=-1.0, upper=1.0).coerce(
                f"nodes[{k}]", self.nodes[k], {}
            )
            if positions.size == 0 or not (np.diff(positions) > 0).all():
                raise InvalidData(
                    f"nodes[{k}] must increase, got {positions.tolist()}", field="nodes"
                )
            if k and positions.size == nodes[-1].size and (positions == nodes[-1]).all():
                positions = nodes[-1]  # share equal arrays: a mesh has few distinct sets of nodes
            inner = {**sizes, "nodes": (positions.size, f"nodes[{k}]")}
            table = Array(("nodes", "size")).coerce(f"values[{k}]", self.values[k], inner)
            sizes.setdefault("size", (table.shape[1], "values[0]"))
            nodes.append(positions)
            values.append(table)
        return nodes, values

    def __repr__(self) -> str:
        return f"<Piecewise {self.size} functions, {self.intervals} intervals>"

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(self.values[0].shape[1])

    @property
    def intervals(self) -> int:
        """Number of intervals."""
        return int(self.knots.size) - 1

    @cached_property
    def alike(self) -> tuple[NDArray[np.int64], ...]:
        """Indices of the intervals with equal nodes, one array per set of nodes."""
        groups: dict[bytes, list[int]] = {}
        for k, positions in enumerate(self.nodes):
            groups.setdefault(positions.tobytes(), []).append(k)
        return tuple(frozen(np.array(rows)) for rows in groups.values())

    @cached_property
    def weights(self) -> tuple[Floats, ...]:
        """Barycentric weights of the nodes, one array per interval."""
        result: list[Floats] = [np.empty(0)] * self.intervals
        for rows in self.alike:
            shared = frozen(barycentric_weights(self.nodes[rows[0]]))
            for k in rows:
                result[k] = shared
        return tuple(result)

    @cached_property
    def _places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Group of each interval in :attr:`alike`, and its place in the group."""
        group, place = np.empty((2, self.intervals), np.int64)
        for number, rows in enumerate(self.alike):
            group[rows], place[rows] = number, np.arange(rows.size)
        return frozen(group), frozen(place)

    @cached_property
    def _tables(self) -> tuple[Floats, ...]:
        """Values of each group, shape (intervals, nodes, size)."""
        return tuple(frozen(np.stack([self.values[k] for k in rows])) for rows in self.alike)

    def _cut(self, values: Floats) -> Floats:
        if self.lower is None and self.upper is None:
            return values
        return np.clip(values, self.lower, self.upper)

    def on(self, interval: int, points: ArrayLike) -> Floats:
        """Return the values in `interval` at `points` in [-1, 1], shape (points, size)."""
        matrix = interpolation(self.nodes[interval], points, self.weights[interval])
        return self._cut(matrix @ self.values[interval])

    def value(self, interval: int, place: float) -> Floats:
        """Return the values at one position in [-1, 1], shape (size,), several times as fast as :meth:`on`."""
        distance = place - self.nodes[interval]
        if distance.all():
            share = self.weights[interval] / distance
            value: Floats = share @ self.values[interval] / share.sum()
        else:
            value = self.values[interval][int(np.flatnonzero(distance == 0.0)[0])]
        value = value if self.lower is None else np.maximum(value, self.lower)
        return value if self.upper is None else np.minimum(value, self.upper)

    def at(self, intervals: NDArray[np.int64], points: Floats) -> Floats:
        """Return the values at positions `points` in [-1, 1] of `intervals`, shape (points, size)."""
        if intervals.size and (intervals == intervals[0]).all():
            return self.on(int(intervals[0]), points)
        result = np.empty((points.size, self.size))
        group, place = self._places
        order = np.argsort(intervals, kind="stable")
        edges = np.searchsorted(intervals[order], np.arange(self.intervals + 1))
        # A copy of the values per point costs more than a loop over intervals with many points.
        crowded = np.diff(edges) > CROWD
        for k in np.flatnonzero(crowded):
            chosen = order[edges[k] : edges[k + 1]]
            matrix = interpolation(self.nodes[k], points[chosen], self.weights[k])
            result[chosen] = matrix @ self.values[k]
        rest = np.flatnonzero(~crowded[intervals])
        for number in np.unique(group[intervals[rest]]):
            chosen = rest[group[intervals[rest]] == number]
            first = self.alike[number][0]
            matrix = interpolation(self.nodes[first], points[chosen], self.weights[first])
            values = self._tables[number][place[intervals[chosen]]]
            result[chosen] = (matrix[:, None, :] @ values)[:, 0]
        return self._cut(result)

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Floats:
        """Return the values at times `t`, shape (…, size); at a knot, those of the interval after it.

        Parameters
        ----------
        t : array_like
            Times between the first and the last knot.
        derivative : int
            Order of the derivative. Derivatives are those of the polynomials, without saturation.

        Raises
        ------
        InvalidData
            A time is outside of the knots or not a number, or the derivative is not an integer >= 0.
        """
        order = Whole(0).coerce("derivative", derivative, {})
        try:
            times = np.asarray(t, float)
        except Exception:  # custom conversions may raise anything
            raise InvalidData(f"t must be numbers, got {show(t)}", field="t") from None
        flat = times.reshape(-1)
        begin, end = self.knots[0], self.knots[-1]
        slack = EDGE * max(end - begin, abs(begin), abs(end))
        outside = ~((flat >= begin - slack) & (flat <= end + slack))
        if outside.any():
            raise InvalidData(
                f"t must lie in [{begin:g}, {end:g}], got {flat[outside][0]:g}", field="t"
            )
        flat = np.clip(flat, begin, end)
        place = np.clip(np.searchsorted(self.knots, flat, side="right") - 1, 0, self.intervals - 1)
        low, lengths = self.knots[place], np.diff(self.knots)[place]
        tau = 2.0 * (flat - low) / lengths - 1.0
        if order == 0:
            return self.at(place, tau).reshape((*times.shape, self.size))
        result = np.empty((flat.size, self.size))
        for k in np.unique(place):
            inside, table = place == k, self.values[k]
            differentiate = differentiation(self.nodes[k]) * (2.0 / lengths[inside][0])
            for _ in range(order):
                table = differentiate @ table
            result[inside] = interpolation(self.nodes[k], tau[inside], self.weights[k]) @ table
        return result.reshape((*times.shape, self.size))

    def saturations(self, sizes: Floats) -> dict[int, Floats]:
        """Return the times at which a function reaches or leaves a saturation limit, by interval.

        `sizes` are the typical magnitudes of the functions, shape (size,).
        """
        result: dict[int, Floats] = {}
        limits = ((self.lower, -1.0), (self.upper, 1.0))
        limited = [(x, sign) for x, sign in limits if x is not None and np.isfinite(x).any()]
        for rows, table in zip(self.alike, self._tables, strict=True):
            first = rows[0]
            grid = np.cos(np.linspace(0.0, np.pi, DENSITY * table.shape[1]))
            dense = interpolation(self.nodes[first], grid, self.weights[first]) @ table
            for edge, sign in limited if table.shape[1] > 1 else ():
                excess = sign * (dense - edge)
                low, high = excess.min(axis=1), excess.max(axis=1)
                reach = high + BETWEEN * np.maximum(-low, high)
                crossed = (low < 0.0) & (reach > EXCESS * sizes) & np.isfinite(high - low)
                for k, c in np.argwhere(crossed):
                    line = chebyshev.chebfit(grid, excess[k, :, c] / -low[k, c], table.shape[1] - 1)
                    line = chebyshev.chebtrim(line, 1e-15)
                    roots = chebyshev.chebroots(line)
                    tau = np.sort(roots.real[(np.abs(roots.imag) < 1e-6) & (np.abs(roots) < 1.0)])
                    ends = np.concatenate([[-1.0], tau, [1.0]])
                    middle = chebyshev.chebval(0.5 * (ends[1:] + ends[:-1]), line) * -low[k, c]
                    beyond = middle > EXCESS * sizes[c]
                    begin, end = self.knots[rows[k] : rows[k] + 2]
                    tau = tau[beyond[1:] | beyond[:-1]]
                    times = begin + 0.5 * (tau + 1.0) * (end - begin)
                    known = result.get(int(rows[k]), np.empty(0))
                    result[int(rows[k])] = np.unique(np.append(known, times))
        return result

    def to_data(self) -> dict[str, Any]:
        """Return the functions as JSON data."""

        def bound(values: Floats | None, sign: int) -> Any:
            return None if values is None else Array(("n",), infinity=sign).encode(values)

        return {
            "nodes": [positions.tolist() for positions in self.nodes],
            "values": [table.tolist() for table in self.values],
            "lower": bound(self.lower, -1),
            "upper": bound(self.upper, 1),
        }

    @classmethod
    def from_data(cls, data: Any, knots: Any, what: str) -> Piecewise:
        """Return the functions that :meth:`to_data` wrote; invalid data raise ``InvalidData``."""
        keys = {"nodes", "values", "lower", "upper"}
        if not isinstance(data, Mapping) or not {"nodes", "values"} <= set(data) <= keys:
            raise InvalidData(
                f"{what} must be an object with nodes and values (lower, upper), got {show(data)}",
                field=what,
            )
        for key in ("nodes", "values"):
            if not isinstance(data[key], Sequence) or isinstance(data[key], str):
                raise InvalidData(
                    f"{what}: {key} must be a list with one entry per interval, got {show(data[key])}",
                    field=what,
                )
        return cls(
            knots, tuple(data["nodes"]), tuple(data["values"]), data.get("lower"), data.get("upper")
        )
