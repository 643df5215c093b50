"""Reader of constrained shortest paths of the OR-Library.

Source: J. E. Beasley and N. Christofides, "An algorithm for the resource constrained shortest path
problem", Networks 19, 1989; http://people.brunel.ac.uk/~mastjjb/jeb/orlib/rcspinfo.html.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ...errors import InvalidData, UnsupportedFormulation
from ...files import as_path, read_text
from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.resource import Resource
from ..tables import number

__all__ = ["read_rcsp"]

#: Largest number of vertices, arcs and resources.
MOST = 10_000_000


def read_rcsp(path: str | os.PathLike[str], **fields: Any) -> ResourceRouting:
    """Return the shortest path problem in a file of the OR-Library (``rcsp1.txt``, …).

    The file contains the numbers of vertices, arcs and resources, the lower and upper limits of the
    resources, the use at each vertex, and per arc its ends, its cost and its use. The path leads
    from the first to the last vertex. The use at a vertex is added to that of the arcs to it. A
    parallel arc that another one dominates is dropped.

    Parameters
    ----------
    path : path-like
        The file.
    **fields
        Other fields of :class:`~crosstrack.models.ResourceRouting`, such as ``ids``.

    Returns
    -------
    ResourceRouting
        The model; its points are the vertices of the file from 1, in order.

    Raises
    ------
    InvalidData
        A number is missing, malformed or negative, or an arc has an unknown vertex. The message names
        the file, and the line if it applies.
    UnsupportedFormulation
        Two parallel arcs have neither the lower cost and uses, or, with a positive lower limit, two arcs are
        parallel.
    """
    file = as_path(path)
    words = [
        (word, line)
        for line, text in enumerate(read_text(file).splitlines(), 1)
        for word in text.split()
    ]
    values = np.array([number(word, f"{file}, line {line}", "line") for word, line in words])
    sizes = values[:3]
    if (
        len(sizes) < 3
        or (sizes != np.floor(sizes)).any()
        or not 0 <= sizes.min() <= sizes.max() < MOST
    ):
        raise InvalidData(
            f"{file}, line 1: must be the numbers of vertices, arcs and resources", field="line"
        )
    vertices, arcs, kinds = (int(size) for size in sizes)
    parts = np.cumsum([3, kinds, kinds, vertices * kinds])
    count = int(parts[-1]) + arcs * (3 + kinds)
    if len(values) != count:
        raise InvalidData(
            f"{file}: must have {count} numbers for {vertices} vertices, {arcs} arcs and {kinds} "
            f"resources, got {len(values)}",
            field="line",
        )
    if (negative := np.flatnonzero(values < 0)).size:
        word, line = words[negative[0]]
        raise InvalidData(f"{file}, line {line}: must be numbers >= 0, got {word}", field="line")
    lower, upper, at_vertex, rest = (part for part in np.split(values, parts)[1:])
    at_vertex, table = at_vertex.reshape(vertices, kinds), rest.reshape(arcs, 3 + kinds)
    ends = table[:, :2] - 1
    bad = np.flatnonzero(
        (ends != np.floor(ends)).any(1) | (ends < 0).any(1) | (ends >= vertices).any(1)
    )
    if bad.size:
        raise InvalidData(
            f"{file}: arc {int(bad[0]) + 1} must join vertices 1 … {vertices}, got "
            f"{table[bad[0], :2].tolist()}",
            field="arcs",
        )
    ends = ends.astype(np.int64)
    uses = table[:, 3:] + at_vertex[ends[:, 1]]
    # With a lower limit, the arc with the higher use may be needed.
    signs = np.where(lower > 0, -1.0, 1.0)
    values = np.column_stack([table[:, 2], uses, uses * np.minimum(signs, 0.0)])
    rows = _without_dominated(file, ends, values)
    words_of = ["vertex"] * (vertices - 1) + ["end" if (lower > 0).any() else "vertex"]
    resources = [
        Resource(
            f"resource {k + 1}",
            initial=float(at_vertex[0, k]),
            limits=dict.fromkeys(set(words_of), float(upper[k])),
            lower_limits={"end": float(lower[k])} if lower[k] > 0 else {},
        )
        for k in range(kinds)
    ]
    data = {
        "kinds": words_of,
        "resources": resources,
        "start": 0,
        "end": vertices - 1,
        "arcs": ends[rows],
        "lengths": table[rows, 2],
        "uses": uses[rows] if kinds else None,
        "ids": list(range(1, vertices + 1)),
        **fields,
    }
    return ResourceRouting.from_data(data, name=file.stem)


def _without_dominated(file: Any, ends: Any, values: Any) -> list[int]:
    """Return the arcs without loops and without those parallel to one with lower or equal values."""
    best: dict[tuple[int, int], int] = {}
    for row, (tail, head) in enumerate(ends.tolist()):
        if tail == head:
            continue  # no shortest path uses a loop, as values are >= 0
        rival = best.setdefault((tail, head), row)
        if (values[row] <= values[rival]).all():
            best[tail, head] = row
        elif not (values[rival] <= values[row]).all():
            raise UnsupportedFormulation(
                f"{file}: two arcs join vertices {tail + 1} and {head + 1}, and neither has the lower cost "
                "and uses: resource-routing has one arc per pair"
            )
    return sorted(best.values())
