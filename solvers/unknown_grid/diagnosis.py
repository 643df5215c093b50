"""Why targets cannot be reached, from the true maps: what encloses them, and what would open a way."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ..diagnosis import Diagnosis, Finding

__all__ = ["diagnose_unknown_grid", "opening"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

_METHOD = "the free cells that are joined to start and target, and shortest ways on the true maps"
#: Cells that a text names at the most, and cells of maps in which an opening is looked for.
_NAMED, _MOST = 4, 1_000_000


def diagnose_unknown_grid(
    model: UnknownGridNavigation, time_limit: float | None = None
) -> Diagnosis:
    """Return in which scenes the target cannot be reached within the steps allowed, and why.

    There always is a plan, for a run may say that there is no way. A policy may need more steps than the
    shortest way, which it does not know.

    Parameters
    ----------
    model : UnknownGridNavigation
        With its true maps.
    time_limit : float, optional
        Not used: the time is that of a search or two over each map.
    """
    fewest = model.fewest_steps()
    closed = np.flatnonzero(np.isinf(fewest)).tolist()
    far = np.flatnonzero(np.isfinite(fewest) & (fewest > model.steps))
    far = far[np.argsort(fewest[far], kind="stable")]
    enclosed = sorted((_enclosed(model, k) for k in closed), key=_obstacles)
    findings = (*(_distant(model, k, int(fewest[k])) for k in far.tolist()), *enclosed)
    within = fewest[fewest <= model.steps]
    told = "" if not within.size else f", in {_range(within)} of {model.steps} steps"
    if model.scenes == 1:
        text = (
            f"the target can be reached{told}"
            if within.size
            else "there is no way to the target"
            if closed
            else f"the target cannot be reached in the {model.steps} steps that are allowed"
        )
    else:
        which = "all" if within.size == model.scenes else f"{within.size} of"
        text = f"the target can be reached in {which} {model.scenes} scenes{told}"
        text += f"; {len(closed)} without a way" if closed else ""
        text += f"; {len(far)} with a way that is too long" if len(far) else ""
    summary = f"a plan exists, for a run may say that there is no way; {text}"
    return Diagnosis(model.name, True, _METHOD, summary, findings)


def opening(blocked: Truths, start: Ints, target: Ints) -> Ints:
    """Return the fewest obstacles without which there would be a way, shape (n, 2).

    Parts of free cells and single obstacles are the nodes of a graph, in which to enter an obstacle costs 1.

    Parameters
    ----------
    blocked : ndarray of bool, shape (rows, columns)
        The map.
    start, target : ndarray of int, shape (2,)
        Free cells.

    Returns
    -------
    ndarray of int, shape (n, 2)
        Rows and columns, from the start to the target; none where there is a way.
    """
    from scipy.ndimage import label
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    parts, count = label(~blocked)
    # Nodes: 1 … count are parts, those after them obstacles.
    nodes = parts.astype(np.int64)
    walls = np.argwhere(blocked)
    nodes[blocked] = count + 1 + np.arange(len(walls))
    size = count + 1 + len(walls)
    pairs = np.concatenate(
        [
            np.column_stack([nodes[:-1].ravel(), nodes[1:].ravel()]),
            np.column_stack([nodes[:, :-1].ravel(), nodes[:, 1:].ravel()]),
        ]
    )
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    once = np.unique(np.concatenate([pairs @ [size, 1], pairs @ [1, size]]))
    into = once % size
    # Parts cost so little that all together cost less than an obstacle.
    costs = np.where(into > count, 1.0, 0.5 / size)
    graph = csr_array((costs, (once // size, into)), shape=(size, size))
    first, last = int(nodes[tuple(start)]), int(nodes[tuple(target)])
    before = dijkstra(graph, indices=first, return_predecessors=True)[1]
    found, at = [], last
    while at != first:
        if at > count:
            found.append(walls[at - count - 1])
        at = int(before[at])
    return np.array(found[::-1], np.int64).reshape(-1, 2)


def _distant(model: UnknownGridNavigation, scene: int, steps: int) -> Finding:
    text = (
        f"{_scene(model, scene)}the shortest way has {steps} steps, {steps - model.steps} more than the "
        f"{model.steps} that are allowed"
    )
    return Finding(text, "", f"scene {scene}", {"scene": scene, "steps": steps})


def _enclosed(model: UnknownGridNavigation, scene: int) -> Finding:
    """Return which of start and target is enclosed, by what, and what would open a way."""
    from scipy.ndimage import binary_dilation, label

    blocked, start, target = model.blocked[scene], model.starts[scene], model.targets[scene]
    parts, _ = label(~blocked)
    joined = parts == parts[tuple(start)]
    beyond = parts == parts[tuple(target)]
    reached, left = int(np.count_nonzero(joined)), int(np.count_nonzero(beyond))
    # The smaller part is the one that is enclosed.
    name, inner, size, cell = (
        ("target", beyond, left, target) if left <= reached else ("start", joined, reached, start)
    )
    ring = np.argwhere(binary_dilation(inner) & blocked)
    edge = bool(inner[[0, -1]].any() or inner[:, [0, -1]].any())
    around = _count(len(ring), "obstacle") + (" and the edge of the map" if edge else "")
    if not len(ring):
        around = "the edge of the map"
    text = (
        f"{_scene(model, scene)}there is no way: {around} enclose the {name} at row {cell[0]}, column "
        f"{cell[1]} in a part of {_count(size, 'free cell')}; {reached} of "
        f"{np.count_nonzero(~blocked)} free cells can be reached from the start"
    )
    data = {
        "scene": scene, "enclosed": name, "cells": size, "reachable": reached,
        "free": int(np.count_nonzero(~blocked)), "edge": edge, "walls": ring.tolist(),
    }  # fmt: skip
    if blocked.size <= _MOST:
        gone = opening(blocked, start, target)
        text += (
            f"; without {_count(len(gone), 'obstacle')}, such as {_cells(gone)}, there would be one"
        )
        data["opening"] = gone.tolist()
    return Finding(text, "", f"scene {scene}", data)


def _obstacles(finding: Finding) -> int:
    """Return how many obstacles keep a target from being reached, as far as it was found."""
    return len((finding.data or {}).get("opening", range(_MOST)))


def _scene(model: UnknownGridNavigation, scene: int) -> str:
    return f"scene {scene}: " if model.scenes > 1 else ""


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'s' if number != 1 else ''}"


def _cells(cells: Iterable[Ints]) -> str:
    """Return ``"at row 1, column 2 and row 3, column 4"``, a few of them."""
    named = [f"row {row}, column {column}" for row, column in cells]
    if len(named) > _NAMED:
        named = [*named[:_NAMED], f"{len(named) - _NAMED} more"]
    return "at " + " and ".join(named)


def _range(steps: NDArray[np.float64]) -> str:
    low, high = int(steps.min()), int(steps.max())
    return str(low) if low == high else f"{low} to {high}"
