"""Diagnosis of unreachable targets on the true maps: enclosing obstacles, and obstacles to remove."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ...models.unknown_grid.checks import has_way
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.scenes import Corners
from ..run.diagnosis import Diagnosis, Finding

__all__ = ["diagnose_unknown_grid", "opening"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

_METHOD = "the free cells that are joined to start and target, and shortest ways on the true maps"
#: Maximum number of cells in a text, and of cells in a map for the search of an opening.
_NAMED, _MOST = 4, 1_000_000


def diagnose_unknown_grid(
    model: UnknownGridNavigation, time_limit: float | None = None
) -> Diagnosis:
    """Return the scenes whose target is unreachable within the step limit, with the causes.

    A plan always exists, because a run may end with ``NO_WAY``. A policy may need more steps than the
    shortest path, because it has only the view.

    Parameters
    ----------
    model : UnknownGridNavigation
        Model with its true maps.
    time_limit : float, optional
        Unused, because the diagnosis takes at most two searches per map.

    Returns
    -------
    Diagnosis
        A summary, and one finding per scene whose target is too far or enclosed.
    """
    fewest = model.fewest_steps()
    ends = zip(model.blocked, model.starts.tolist(), model.targets.tolist(), strict=True)
    ways = np.array(
        [has_way(cells, (a, b), (c, d), model.corners) for cells, (a, b), (c, d) in ends]
    )
    closed = np.flatnonzero(~ways).tolist()
    far = np.flatnonzero(ways & (fewest > model.steps))
    far = far[np.argsort(fewest[far], kind="stable")]
    enclosed = sorted((_enclosed(model, k) for k in closed), key=_obstacles)
    findings = (*(_distant(model, k, fewest[k]) for k in far.tolist()), *enclosed)
    within = fewest[fewest <= model.steps]
    limits = "" if not within.size else f", in {_range(within)} of {model.steps} steps"
    if model.scenes == 1:
        text = (
            f"the target can be reached{limits}"
            if within.size
            else "there is no way to the target"
            if closed
            else f"the target cannot be reached in the {model.steps} steps that are allowed"
        )
    else:
        which = "all" if within.size == model.scenes else f"{within.size} of"
        text = f"the target can be reached in {which} {model.scenes} scenes{limits}"
        text += f"; {len(closed)} without a way" if closed else ""
        text += f"; {len(far)} with a way that is too long" if len(far) else ""
    summary = f"a plan exists, for a run may say that there is no way; {text}"
    return Diagnosis(model.name, True, _METHOD, summary, findings)


def opening(blocked: Truths, start: Ints, target: Ints, diagonal: bool = False) -> Ints:
    """Return a smallest set of obstacles whose removal opens a path, in the order from the start, shape (n, 2).

    The nodes of the search graph are the connected parts of free cells and the single obstacles. An edge
    into an obstacle costs 1. The result is empty if a path exists. If `diagonal`, paths may pass any corner.
    """
    from scipy.ndimage import label
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    parts, count = label(~blocked, np.ones((3, 3)) if diagonal else None)
    # Nodes 1 … count are parts, larger numbers are obstacles.
    nodes = parts.astype(np.int64)
    walls = np.argwhere(blocked)
    nodes[blocked] = count + 1 + np.arange(len(walls))
    size = count + 1 + len(walls)
    pairs = np.concatenate(
        [
            np.column_stack([nodes[:-1].ravel(), nodes[1:].ravel()]),
            np.column_stack([nodes[:, :-1].ravel(), nodes[:, 1:].ravel()]),
            *[
                np.column_stack([nodes[:-1, first].ravel(), nodes[1:, last].ravel()])
                for first, last in ((slice(-1), slice(1, None)), (slice(1, None), slice(-1)))
                if diagonal
            ],
        ]
    )
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    once = np.unique(np.concatenate([pairs @ [size, 1], pairs @ [1, size]]))
    into = once % size
    # The costs of all parts together are below the cost of one obstacle.
    costs = np.where(into > count, 1.0, 0.5 / size)
    graph = csr_array((costs, (once // size, into)), shape=(size, size))
    first, last = int(nodes[tuple(start)]), int(nodes[tuple(target)])
    before = dijkstra(graph, indices=first, return_predecessors=True)[1]
    cells, node = [], last
    while node != first:
        if node > count:
            cells.append(walls[node - count - 1])
        node = int(before[node])
    return np.array(cells[::-1], np.int64).reshape(-1, 2)


def _distant(model: UnknownGridNavigation, scene: int, steps: float) -> Finding:
    if steps == np.inf:
        text = f"the target cannot be reached past the moving obstacles in {model.steps} steps"
        return Finding(_scene(model, scene) + text, "", f"scene {scene}", {"scene": scene})
    text = (
        f"{_scene(model, scene)}the shortest way has {steps:.0f} steps, {steps - model.steps:.0f} more than the "
        f"{model.steps} that are allowed"
    )
    return Finding(text, "", f"scene {scene}", {"scene": scene, "steps": int(steps)})


def _enclosed(model: UnknownGridNavigation, scene: int) -> Finding:
    """Return a finding that names the enclosed end, its obstacles and an opening."""
    from scipy.ndimage import binary_dilation, label

    blocked, start, target = model.blocked[scene], model.starts[scene], model.targets[scene]
    diagonal = model.corners is Corners.ANY
    parts, _ = label(~blocked, np.ones((3, 3)) if diagonal else None)
    joined = parts == parts[tuple(start)]
    beyond = parts == parts[tuple(target)]
    reached, left = int(np.count_nonzero(joined)), int(np.count_nonzero(beyond))
    # The smaller part is reported as enclosed.
    name, inner, size, cell = (
        ("target", beyond, left, target) if left <= reached else ("start", joined, reached, start)
    )
    ring = np.argwhere(binary_dilation(inner, np.ones((3, 3)) if diagonal else None) & blocked)
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
        removed = opening(blocked, start, target, diagonal)
        text += f"; without {_count(len(removed), 'obstacle')}, such as {_cells(removed)}, there would be one"
        data["opening"] = removed.tolist()
    return Finding(text, "", f"scene {scene}", data)


def _obstacles(finding: Finding) -> int:
    """Return the size of a finding's opening, or a large number if it was not computed."""
    return len((finding.data or {}).get("opening", range(_MOST)))


def _scene(model: UnknownGridNavigation, scene: int) -> str:
    return f"scene {scene}: " if model.scenes > 1 else ""


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'s' if number != 1 else ''}"


def _cells(cells: Iterable[Ints]) -> str:
    """Return text such as ``"at row 1, column 2 and row 3, column 4"`` for the first few cells."""
    texts = [f"row {row}, column {column}" for row, column in cells]
    if len(texts) > _NAMED:
        texts = [*texts[:_NAMED], f"{len(texts) - _NAMED} more"]
    return "at " + " and ".join(texts)


def _range(steps: NDArray[np.float64]) -> str:
    low, high = int(steps.min()), int(steps.max())
    return str(low) if low == high else f"{low} to {high}"
