"""Reader of path problems of SPPRCLIB and PathWyse.

Sources: M. Jepsen, B. Petersen, S. Spoorendonk and D. Pisinger, SPPRCLIB, 2008 (``.sppcc``); M. Salani, S. Basso and
V. Giuffrida, "PathWyse: a flexible, open-source library for the resource constrained shortest path problem",
Optimization Methods and Software 39, 2024, doi 10.1080/10556788.2023.2296978 (the instance format).
"""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from ...errors import InvalidData, UnsupportedFormulation
from ...files import as_path, read_text
from ...models.resource_routing.model import ResourceRouting
from ...models.resource_routing.resource import Resource
from ..tables import number

__all__ = ["read_spprclib"]

#: Sections with their numbers of columns.
_SECTIONS = {
    "RES_TYPE": 2, "RES_BOUND": 3, "RES_NODE_BOUND": 4, "EDGE_COST": 3, "EDGE_CONSUMPTION": 4,
    "NODE_COST": 2, "NODE_CONSUMPTION": 3, "COORD": 3,
}  # fmt: skip
#: Heads that describe the graph: 0 or 1. The rows of EDGE_COST list the arcs.
_DESCRIPTIONS = ("CYCLIC", "COMPLETE", "SYMMETRIC")
_HEADS = (
    "NAME", "COMMENT", "SIZE", "DIRECTED", "ORIGIN", "DESTINATION", "RESOURCES", "RES_NAMES",
    *_DESCRIPTIONS,
)  # fmt: skip


def read_spprclib(path: str | os.PathLike[str], **fields: Any) -> ResourceRouting:
    """Return the path problem in a file of SPPRCLIB or PathWyse (``A-n54-k7-149.sppcc``, …).

    Costs of nodes become prizes. Without a destination, the path returns to a copy of the origin, which is the
    last point. Resources of the type CAP are used at nodes and TIME at arcs and nodes, NODELIM counts the arcs, and
    TW has windows with waiting, and the use of a node as service time. As in PathWyse, the use at the origin
    counts for TW alone, the copy of the origin has no window, and a row of ``RES_BOUND`` has no effect on TW,
    which its windows limit. ``CYCLIC``, ``COMPLETE`` and ``SYMMETRIC`` describe the listed arcs and change nothing.

    Parameters
    ----------
    path : path-like
        The file.
    **fields
        Other fields of :class:`~crosstrack.models.ResourceRouting`, such as ``routes``.

    Returns
    -------
    ResourceRouting
        The model; its points are the nodes of the file.

    Raises
    ------
    InvalidData
        A section or number is missing or malformed, two rows give an arc different costs, or a row has an unknown
        resource. The message names the file, and the line if it applies.
    UnsupportedFormulation
        The file has a section or a type of resource that the model does not express.
    """
    file = as_path(path)
    heads, rows = _sections(file)
    size = _head(file, heads, "SIZE", 1, 1_000_000)
    origin = _head(file, heads, "ORIGIN", 0, size - 1, 0)
    end = _head(file, heads, "DESTINATION", 0, size - 1, origin)
    end = size if end == origin else end
    directed = _head(file, heads, "DIRECTED", 0, 1, 1)
    for key in _DESCRIPTIONS:
        _head(file, heads, key, 0, 1, 0)

    def node(value: float) -> int:
        if not (value.is_integer() and 0 <= value < size):
            raise InvalidData(
                f"{file}: nodes must be in 0 … {size - 1}, got {value:g}", field="line"
            )
        return int(value)

    def pairs(tail: float, head: float) -> list[tuple[int, int]]:
        """Return the arcs of an edge, with those into the origin at its copy; none for a loop."""
        ends = [(node(tail), node(head)), (node(head), node(tail))][: 2 - directed]
        return [(i, end if j == origin and end == size else j) for i, j in ends if i != j]

    costs: dict[tuple[int, int], float] = {}
    for tail, head, cost in rows["EDGE_COST"]:
        for pair in pairs(tail, head):
            if costs.setdefault(pair, cost) != cost:
                raise InvalidData(
                    f"{file}: EDGE_COST must give an arc one cost, got {costs[pair]:g} and {cost:g} for "
                    f"{tail:g} {head:g}",
                    field="line",
                )
    arcs = np.array(list(costs), np.int64).reshape(-1, 2)
    place = {pair: k for k, pair in enumerate(costs)}
    kinds = [f"node {k}" for k in range(max(size, end + 1))]
    prizes = np.zeros(len(kinds))
    for at, cost in rows["NODE_COST"]:
        prizes[node(at)] = -cost
    types = dict(rows["RES_TYPE"])
    _head(file, heads, "RESOURCES", len(types), len(types), len(types))
    for section in ("RES_BOUND", "RES_NODE_BOUND", "EDGE_CONSUMPTION", "NODE_CONSUMPTION"):
        for key in {row[0] for row in rows[section]} - types.keys():
            raise InvalidData(
                f"{file}: {section} must name resources of RES_TYPE, got {key:g}", field="line"
            )
    resources, uses = [], np.zeros((len(arcs), len(types)))
    for column, (key, word) in enumerate(types.items()):
        low, high = next((row[1:] for row in rows["RES_BOUND"] if row[0] == key), (0.0, math.inf))
        windows = {node(row[1]): row[2:] for row in rows["RES_NODE_BOUND"] if row[0] == key}
        at_node = np.zeros(len(kinds))
        for _, at, use in (row for row in rows["NODE_CONSUMPTION"] if row[0] == key):
            at_node[node(at)] = use
        for _, tail, head, use in (row for row in rows["EDGE_CONSUMPTION"] if row[0] == key):
            for pair in pairs(tail, head):
                if pair in place and word in ("TIME", "TW"):
                    uses[place[pair], column] = use
        # The use of a node is service time after the arrival for windows, and counts on arrival otherwise.
        uses[:, column] += 1.0 if word == "NODELIM" else at_node[arcs[:, 0 if word == "TW" else 1]]
        most = dict.fromkeys(range(len(kinds)), high if word != "TW" else math.inf)
        most.update({k: min(most[k], window[1]) for k, window in windows.items()})
        opens = {kinds[k]: window[0] for k, window in windows.items() if window[0] > 0}
        least = {kinds[end]: low} if low > 0 and word != "TW" else {}
        if word != "TW":  # only time windows wait
            least = opens | {kind: max(low, opens.get(kind, 0.0)) for kind in least}
        resources.append(
            Resource(
                f"resource {key:g}", initial=float(word == "NODELIM"),
                limits={kinds[k]: limit for k, limit in most.items() if limit < math.inf},
                floors=opens if word == "TW" else {}, lower_limits=least,
            )
        )  # fmt: skip
    data = {
        "kinds": kinds, "resources": resources, "start": origin, "end": end, "arcs": arcs,
        "lengths": np.array(list(costs.values())), "uses": uses if resources else None,
        "prizes": prizes, **fields,
    }  # fmt: skip
    return ResourceRouting.from_data(data, name=file.stem)


def _head(
    file: Any, heads: dict[str, str], key: str, low: int, high: int, default: int = -1
) -> int:
    """Return the whole number of a head line, in low … high."""
    if key not in heads and default >= 0:
        return default
    value = number(heads.get(key, ""), f"{file}, {key}", "line")
    if not (value.is_integer() and low <= value <= high):
        allowed = f"in {low} … {high}" if low < high else f"{low}"
        raise InvalidData(f"{file}, {key} must be {allowed}, got {value:g}", field="line")
    return int(value)


def _sections(file: Any) -> tuple[dict[str, str], dict[str, list[Any]]]:
    """Return the head lines, and the rows of each section as numbers."""
    heads: dict[str, str] = {}
    rows: dict[str, list[Any]] = {key: [] for key in _SECTIONS}
    section = ""
    for line, text in enumerate(read_text(file).splitlines(), 1):
        place, words = f"{file}, line {line}", text.split()
        key = text.partition(":")[0].strip()
        if not words or words == ["END"]:
            section = "" if words else section
        elif section:
            if len(words) != _SECTIONS[section]:
                raise InvalidData(
                    f"{place}: {section} has {_SECTIONS[section]} columns, got {text.strip()!r}",
                    field="line",
                )
            is_type = section == "RES_TYPE"
            values = [number(word, place, "line") for word in words[: 1 if is_type else None]]
            if is_type and words[1] not in ("CAP", "TIME", "NODELIM", "TW"):
                raise UnsupportedFormulation(
                    f"{place}: the type of resource {words[1]!r} is not supported"
                )
            rows[section].append((*values, *words[1:]) if is_type else tuple(values))
        elif ":" in text and key in _HEADS:
            heads[key] = text.partition(":")[2].strip()
        elif key in _SECTIONS:
            section = key
        else:
            raise UnsupportedFormulation(f"{place}: the section {key!r} is not supported")
    return heads, rows
