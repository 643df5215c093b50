"""Laws of the training scenes of networks, and scenes outside them.

A scene is outside the law of a network if the size of its map or view does not occur in training, if the seen part
of its map is less open than 98 % of the scenes of the law, or if it has a longer wall than 99 % of them.
``tests/benchmarks/unknown_grid/laws.py`` measures these limits and the success rates on both sides, and writes them to
``laws.json``.
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
from ...models.unknown_grid.scenes import TASKS
from ...models.unknown_grid.world import BLOCKED, UNKNOWN

__all__ = ["MEASURED", "openness", "outside_law", "statement", "wall_lengths"]

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


def wall_lengths(known: NDArray[np.int8]) -> NDArray[np.int64]:
    """Return the length of the longest seen wall of one cell in thickness, cells, shape (n,); 0 without a wall.

    `known`, shape (n, rows, columns), are the cells seen. A wall is a run of obstacles along a row or column without an
    obstacle on either side.
    """
    longest = np.zeros(len(known), np.int64)
    for cells in (known, known.swapaxes(1, 2)):
        blocked = np.pad(cells == BLOCKED, ((0, 0), (1, 1), (0, 0)))
        thin = blocked[:, 1:-1] & ~blocked[:, :-2] & ~blocked[:, 2:]
        lengths = np.zeros(thin.shape[:2], np.int64)
        for column in range(thin.shape[2]):
            lengths = np.where(thin[:, :, column], lengths + 1, 0)
            longest = np.maximum(longest, lengths.max(axis=1))
    return longest


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
    seen = [(openness(cells), wall_lengths(cells)) for cells in known]
    shares, lengths = (np.concatenate(values) for values in zip(*seen, strict=True))
    dense = shares < min(limits[name]["openness"] for name in laws)
    walled = lengths > max(limits[name]["wall"] for name in laws)
    outside, less_open, reasons = dense | walled, "maps less open than those of the training", []
    for name, size in (("shape", problem.shape), ("view", problem.view)):
        sizes = {getattr(task, name) for task in TASKS}
        if tuple(size.tolist()) not in sizes:
            trained = " or ".join(f"{rows} × {columns}" for rows, columns in sorted(sizes))
            reasons.append(f"{name} {size[0]} × {size[1]}, trained with {trained}")
    if not reasons:
        longer = "walls longer than those of the training"
        counts = {less_open: int(dense.sum()), longer: int(walled.sum())}
        reasons = [text for text, count in counts.items() if count]
        # The measured success is that of the first reason.
        reasons.sort(key=counts.__getitem__, reverse=True)
        return outside, "; ".join(reasons)
    if dense.mean() > 0.5:
        reasons.insert(0, less_open)
    return np.ones(len(problem.starts), bool), "; ".join(reasons)


def statement(count: int, scenes: int, law: str, reason: str, kind: str = "") -> str:
    """Return the part of a result's message on `count` of `scenes` that are outside a law, or ``""``.

    The message ends with the measured success of the policy `kind` with the shipped weights, if given.
    """
    if not count:
        return ""
    text = f"{count} of {scenes} scenes lie outside the law this network was trained on ({law}): {reason}"
    rates = _measured()["success"].get(kind, {})
    cause = reason.partition(" ")[0]  # maps, walls, shape or view
    if cause not in rates:
        return text
    (place, share), inside = rates[cause], rates["inside"]
    return f"{text}; measured success: {share:.0f} % in {place}, {inside:.0f} % inside the law"
