"""Algorithm 4 of the paper: an encounter that happens earlier on the way is moved there.

Where the path enters a vehicle's disc before it is to meet that vehicle, the encounter takes place
there: the vehicle's place in the order, its direction and the intervals around change. The paper's
Proposition 1 says that the path is not lengthened. That is no theorem: the leg through the new
encounter is decoded as a path of the same length with free end heading, which need not be the path
that was flown, so later legs begin with other headings and may have to be repaired. So every
transformation is decoded, and undone where the tour ends later.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from .decoding import along, copy_tour, decode

__all__ = ["entry", "transform"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Steps in a turn at least, and halvings of the one that crosses a boundary.
_STEPS, _HALVINGS = 128.0, 48


@kernel
def _beyond(
    poses: Floats, legs: Floats, k: int, fleet: Floats, craft: Floats, j: int, m: int,
    x: float, y: float, h: float, s: float, before: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return how far (m) beyond the disc of `j` the UAV is, and where it is seen from `j`."""
    x, y, h = along(x, y, h, s, legs[k, 3 + m], craft[4])
    t = poses[k, 3] + (before + s) / craft[3]
    dx = x - fleet[j, 0] - fleet[j, 2] * t
    dy = y - fleet[j, 1] - fleet[j, 3] * t
    return math.hypot(dx, dy) - fleet[j, 4], dx, dy


@kernel
def _on_arc(
    poses: Floats, legs: Floats, k: int, fleet: Floats, craft: Floats, j: int, m: int,
    x: float, y: float, h: float, before: float, within: bool,
) -> float:  # fmt: skip
    """Return where (m) primitive `m` of leg `k` first crosses the boundary of the disc; inf if never.

    Steps are as long as it is away at most, or a small share of the turn, so that a touch may be
    missed.
    """
    length = legs[k, m]
    least = length / _STEPS
    rate = 1.0 + math.hypot(fleet[j, 2], fleet[j, 3]) / craft[3]
    s = 0.0
    gap, _, _ = _beyond(poses, legs, k, fleet, craft, j, m, x, y, h, s, before)
    while s < length:
        low, s = s, min(s + max(abs(gap) / rate, least), length)
        gap, _, _ = _beyond(poses, legs, k, fleet, craft, j, m, x, y, h, s, before)
        if (gap <= 0.0) == within:
            continue
        high = s
        for _ in range(_HALVINGS):
            s = 0.5 * (low + high)
            gap, _, _ = _beyond(poses, legs, k, fleet, craft, j, m, x, y, h, s, before)
            if (gap <= 0.0) == within:
                low = s
            else:
                high = s
        crossing: float = high
        return crossing
    return math.inf


@kernel
def _on_line(dx: float, dy: float, wx: float, wy: float, radius: float, within: bool) -> float:
    """Return where the line (dx, dy) + s (wx, wy) first crosses a circle; inf if it never does."""
    pace = math.hypot(wx, wy)
    if pace == 0.0:
        return math.inf
    aside = (dx * wy - dy * wx) / pace
    if abs(aside) > radius:
        return math.inf
    half = math.sqrt(radius * radius - aside * aside)
    s = (half if within else -half) - (dx * wx + dy * wy) / pace
    return s / pace if s >= 0.0 else math.inf


@kernel
def entry(
    poses: Floats, legs: Floats, k: int, fleet: Floats, craft: Floats, j: int, interior: bool
) -> tuple[float, float, float]:
    """Return how long (s) after the start of leg `k` the UAV crosses the boundary of `j`'s disc.

    inf where it does not.

    Returns
    -------
    tuple of 3 float
        The time, the direction ψ (rad), and the share ρ of the radius: 1, or less where the leg
        begins inside the disc and `interior` counts that as an encounter.
    """
    x, y, h = poses[k, 0], poses[k, 1], poses[k, 2]
    gap, dx, dy = _beyond(poses, legs, k, fleet, craft, j, 0, x, y, h, 0.0, 0.0)
    within = gap <= 0.0
    radius = fleet[j, 4]
    if within and interior:
        return 0.0, math.atan2(dy, dx), (gap + radius) / radius if radius > 0.0 else 1.0
    before = 0.0
    for m in range(3):
        length, code = legs[k, m], legs[k, 3 + m]
        if length == 0.0:
            continue
        if craft[4] == 0.0 or code == 0.0:
            ahead = code if craft[4] == 0.0 else h
            wx = math.cos(ahead) - fleet[j, 2] / craft[3]
            wy = math.sin(ahead) - fleet[j, 3] / craft[3]
            _, dx, dy = _beyond(poses, legs, k, fleet, craft, j, m, x, y, h, 0.0, before)
            s = _on_line(dx, dy, wx, wy, radius, within)
        else:
            s = _on_arc(poses, legs, k, fleet, craft, j, m, x, y, h, before, within)
        if s <= length:
            _, dx, dy = _beyond(poses, legs, k, fleet, craft, j, m, x, y, h, s, before)
            return (before + s) / craft[3], math.atan2(dy, dx), 1.0
        x, y, h = along(x, y, h, length, code, craft[4])
        before += length
    return math.inf, 0.0, 1.0


@kernel
def _moved(order: Ints, genes: Floats, k: int, place: int, passed: float, trial: Ints) -> None:
    """Fill `trial` with the order in which the vehicle at `place` comes at `k`, and its intervals.

    The leg is split where `passed` seconds of it are flown; the two legs at the old place are joined.
    """
    j, i = order[place], order[k]
    for m in range(len(order)):
        trial[m] = order[m]
    if place > k:
        if place + 1 < len(order):
            genes[order[place + 1], 1] += genes[j, 1]
        for m in range(place, k, -1):
            trial[m] = order[m - 1]
        trial[k] = j
        genes[i, 1] -= passed
    genes[j, 1] = passed


@kernel
def transform(
    order: Ints, genes: Floats, fleet: Floats, craft: Floats, timed: bool, interior: bool,
    flag: NDArray[np.int8], poses: Floats, legs: Floats,
) -> int:  # fmt: skip
    """Move encounters to where they happen first, while the tour ends no later.

    Each is tried with the intervals that follow from the times so far, as in the paper, and (ours)
    with first interceptions from there on.

    Parameters
    ----------
    order, genes, poses, legs : ndarray
        An individual and its path (see :mod:`.decoding`); updated.
    fleet, craft : ndarray
        The problem.
    timed, interior : bool
        As in :func:`~.decoding.decode`.
    flag : ndarray of int8
        Not 0 asks to stop.

    Returns
    -------
    int
        How many were moved.
    """
    n = len(order)
    trial, trial_genes = np.empty(n, np.int64), np.empty((n, 3))
    trial_poses, trial_legs = np.empty((n + 1, 4)), np.empty((n, 6))
    moved, k = 0, 0
    while k < n and moved < 4 * n and flag[0] == 0:
        # Encounters of this leg that would come earlier than at its end.
        soonest, place, psi, rho = (poses[k + 1, 3] - poses[k, 3]) * (1.0 - 1e-9), -1, 0.0, 1.0
        for m in range(k, n):
            passed, direction, share = entry(poses, legs, k, fleet, craft, order[m], interior)
            if passed < soonest:
                soonest, place, psi, rho = passed, m, direction, share
        accepted = False
        if place >= 0:
            copy_tour(0, order, genes, poses, legs, trial, trial_genes, trial_poses, trial_legs)
            _moved(order, trial_genes, k, place, soonest, trial)
            j = trial[k]
            trial_genes[j, 0], trial_genes[j, 2] = psi, rho
            for kept in (True, False):
                if kept and not timed:
                    continue
                end = decode(
                    trial, trial_genes, fleet, craft, k, kept, interior, math.inf,
                    trial_poses, trial_legs,
                )  # fmt: skip
                if end <= poses[n, 3] * (1.0 + 1e-13):
                    accepted = True
                    copy_tour(
                        0, trial, trial_genes, trial_poses, trial_legs, order, genes, poses, legs
                    )
        if accepted:
            moved += 1
        else:
            k += 1
    return moved
