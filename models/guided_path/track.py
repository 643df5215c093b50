"""Tracks of a guided vehicle other than a line: a loop of a given length, and a tree of edges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Real, Spec, show

__all__ = ["End", "Track", "TrackSpec"]

#: Largest number of edges of a tree; distances between its nodes are a dense matrix.
MOST_EDGES = 1000


@dataclass(frozen=True)
class Track:
    """Loop or tree on which the vehicle moves.

    Parameters
    ----------
    loop : float
        Length of the loop, in m; 0 for a tree. A coordinate is the distance from the origin of the loop in
        its positive direction.
    edges : tuple of (int, int, float)
        Edges of a tree: two nodes, numbered from 0, and the length in m.
    at : tuple of int
        Edge of the start and of each customer. A coordinate is then the distance from the first node of
        the edge.
    """

    loop: float = 0.0
    edges: tuple[tuple[int, int, float], ...] = ()
    at: tuple[int, ...] = ()

    @cached_property
    def nodes(self) -> NDArray[np.float64]:
        """Distances between the nodes of the tree, in m, shape (edges + 1, edges + 1); inf if unconnected."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        tails, heads, lengths = zip(*self.edges, strict=True)
        size = len(self.edges) + 1
        graph = csr_array((lengths, (tails, heads)), shape=(size, size))
        ways: NDArray[np.float64] = dijkstra(graph, directed=False)
        return ways

    def ends(self, k: int, x: float) -> tuple[tuple[int, float], tuple[int, float]]:
        """Return the nodes of the edge of stop `k` at coordinate `x`, each with the distance to it in m."""
        a, b, length = self.edges[self.at[k]]
        return (a, x), (b, length - x)

    def between(self, k: int, x: float, other: int, y: float) -> float:
        """Return the shortest way between stops `k` at `x` and `other` at `y`, in m."""
        if self.loop:
            way = abs(x - y)
            return min(way, self.loop - way)
        if self.at[k] == self.at[other]:
            return abs(x - y)
        return min(
            a + float(self.nodes[node, end]) + b
            for node, a in self.ends(k, x)
            for end, b in self.ends(other, y)
        )


@dataclass(frozen=True)
class TrackSpec(Spec):
    """The word ``"line"``, ``{"loop": length}``, or ``{"tree": edges, "at": edge of each stop}``."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> str | Track:
        if isinstance(value, str) and value == "line":
            return "line"
        if isinstance(value, Track):
            value = self.encode(value)
        keys = set(value) if isinstance(value, Mapping) else set()
        if keys == {"loop"}:
            length = Real(lower=0, strict=True, unit="m").coerce(f"{name}.loop", value["loop"], {})
            return Track(length)
        if keys != {"tree", "at"}:
            raise InvalidData(
                f'{name} must be "line", {{"loop": length}} or {{"tree": edges, "at": edge of each '
                f"stop}}, got {show(value)}",
                field=name,
            )
        rows = Array(("edges", 3), lower=0).coerce(f"{name}.tree", value["tree"], {})
        size = len(rows)
        if not 1 <= size <= MOST_EDGES:
            raise InvalidData(
                f"{name}.tree must have 1 … {MOST_EDGES} edges, got {size}", field=name
            )
        ends = Array(("edges", 2), int, 0, size).coerce(f"{name}.tree", rows[:, :2], {})
        edges = tuple(
            (int(a), int(b), float(row[2])) for (a, b), row in zip(ends, rows, strict=True)
        )
        at = Array(("n",), int, 0, size - 1).coerce(f"{name}.at", value["at"], dict(sizes))
        track = Track(0.0, edges, tuple(at.tolist()))
        if not np.isfinite(track.nodes).all():
            node = int(np.argmax(np.isinf(track.nodes[0])))
            raise InvalidData(
                f"{name}.tree must connect nodes 0 … {size} by {size} edges, node {node} is not connected "
                "to node 0",
                field=name,
            )
        return track

    def encode(self, value: str | Track) -> Any:
        if isinstance(value, str):
            return value
        if value.loop:
            return {"loop": value.loop}
        return {"tree": [list(edge) for edge in value.edges], "at": list(value.at)}


@dataclass(frozen=True)
class End(Spec):
    """End of a tour: None for the start, ``"free"``, or a coordinate."""

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> str | float | None:
        if value is None or (isinstance(value, str) and value == "free"):
            return value
        if isinstance(value, str):
            raise InvalidData(
                f'{name} must be None (the start), "free" or a coordinate in m, got {show(value)}',
                field=name,
            )
        return Real(unit="m").coerce(name, value, sizes)
