"""Laws of the training scenes of networks, and scenes outside them.

A scene is outside the law of a network if the size of its map or view does not occur in training, or if the seen part
of its map is less open than 98 % of the scenes of the law. ``tests/benchmarks/unknown_grid/laws.py`` measures these
limits and the success rates on both sides, and writes them to ``laws.json``.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import BLOCKED, UNKNOWN
from .imitation import TASKS

__all__ = ["MEASURED", "openness", "outside_law", "statement"]

#: File of the measured limits and success rates.
MEASURED = Path(__file__).with_name("laws.json")


@cache
def _measured() -> Any:
    return json.loads(MEASURED.read_text("utf-8"))


def openness(known: NDArray[np.int8]) -> NDArray[np.float64]:
    """Return the share of seen squares of 2 × 2 cells without an obstacle, shape (n,); 1 if no square was seen.

    `known`, shape (n, rows, columns), are the cells seen, see :class:`~.memory.Observation`. The share is 0 in
    corridors of one cell between walls of one cell.
    """
    if min(known.shape[1:]) < 2:
        return np.ones(len(known))
    squares = sliding_window_view(known, (2, 2), axis=(1, 2))
    seen = (squares != UNKNOWN).all(axis=(3, 4))
    blocked = seen & (squares == BLOCKED).any(axis=(3, 4))
    share: NDArray[np.float64] = blocked.sum(axis=(1, 2)) / np.maximum(seen.sum(axis=(1, 2)), 1)
    return 1.0 - share


def outside_law(
    problem: UnknownGridNavigation, law: str, known: Iterable[NDArray[np.int8]]
) -> tuple[NDArray[np.bool_] | None, str]:
    """Return whether each scene is outside a law of training, shape (n,), and the reason.

    `law` may name several laws, separated by commas. A scene is then inside if it is inside one of them. The first
    value is None if a law is not in the table. `known` are arrays of cells, see :func:`openness`.
    """
    limits, laws = _measured()["laws"], [name.strip() for name in law.split(",")]
    if not set(laws) <= set(limits):
        return None, ""
    shares = np.concatenate([openness(cells) for cells in known])
    outside = shares < min(limits[name] for name in laws)
    less_open, reasons = "maps less open than those of the training", []
    for name, size in (("shape", problem.shape), ("view", problem.view)):
        sizes = {getattr(task, name) for task in TASKS}
        if tuple(size.tolist()) not in sizes:
            trained = " or ".join(f"{rows} × {columns}" for rows, columns in sorted(sizes))
            reasons.append(f"{name} {size[0]} × {size[1]}, trained with {trained}")
    if not reasons:
        return outside, less_open
    if outside.mean() > 0.5:  # the measured success is that of the first reason
        reasons.insert(0, less_open)
    return np.ones(len(problem.starts), bool), "; ".join(reasons)


def statement(count: int, scenes: int, law: str, reason: str, kind: str = "") -> str:
    """Return the part of a result's message on `count` of `scenes` that are outside a law, or ``""``.

    The message ends with the measured success of the policy `kind` with the shipped weights, if given.
    """
    if not count:
        return ""
    text = f"{count} of {scenes} scenes lie outside the law this network was trained on ({law}): {reason}"
    if (rates := _measured()["success"].get(kind)) is None:
        return text
    place, share = rates[reason.partition(" ")[0]]  # maps, shape or view
    inside = rates["inside"]
    return f"{text}; measured success: {share:.0f} % in {place}, {inside:.0f} % inside the law"
