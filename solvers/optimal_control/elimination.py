"""Elimination of the states and controls of intervals of the same shape, see ``stages``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

__all__ = ["Front", "Group", "Singular"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


class Singular(Exception):
    """A factorisation failed, or its inertia is not that of a strict minimum."""


@dataclass(frozen=True, eq=False)
class Front:
    """Positions of one interval in the matrices that eliminate it.

    The unknowns are ordered as outer unknowns (the start, the shared columns, and the multipliers of shared
    rows), the constant 1 (the right-hand side), the interval's controls, and its later states.
    """

    columns: Whole  # of z
    kept: Whole  # unknown of each of `columns`
    outer: int
    reduced: int  # outer unknowns, the constant and the controls
    width: int
    following: Whole  # unknown of each outer unknown of the next interval
    defects: Whole
    paths: Whole

    def shape(self) -> tuple[Any, ...]:
        """Return the sizes and patterns that intervals must share to be stacked."""
        sizes = self.outer, self.reduced, self.width, self.paths.size
        return (*sizes, self.kept.tobytes(), self.following.tobytes())

    @property
    def inner(self) -> int:
        """Number of states after the start."""
        return self.width - self.reduced


class Group:
    """Consecutive intervals of the same shape, whose matrices are stacked."""

    def __init__(self, fronts: list[Front], buffer: Floats, place: int) -> None:
        first, count = fronts[0], len(fronts)
        self.count, self.outer, self.reduced = count, first.outer, first.reduced
        width, paths = first.width, first.paths.size
        shapes = (width, width), (first.inner, width), (paths, width)
        #: Matrices of the unknowns, Jacobians of the defects and of the path rows, (intervals, rows, width).
        self.places, self.views = [], []
        for shape in shapes:
            area = int(np.prod(shape))
            self.places.append(place + area * np.arange(count))
            self.views.append(buffer[place : place + count * area].reshape(count, *shape))
            place += count * area
        self.end = place
        self.columns = np.concatenate([front.columns for front in fronts])
        self.kept = first.kept
        self.defects = np.stack([front.defects for front in fronts])
        self.paths = np.stack([front.paths for front in fronts])
        self.from_states = np.flatnonzero(first.following >= first.reduced)
        self.end_states = first.following[self.from_states] - first.reduced
        ends = first.following.size
        self.link = np.zeros((count, ends, first.reduced))
        #: Matrices that remain after the elimination of all later intervals, with right-hand sides.
        self.tails = np.zeros((count, ends, ends + 1))
        #: Controls as a negative linear function of the outer unknowns.
        self.gains = np.zeros((count, first.reduced - first.outer - 1, first.outer + 1))
        others = np.flatnonzero(first.following < first.reduced)
        self.link[:, others, first.following[others]] = 1.0

    def condense(self, weight: Floats) -> None:
        """Eliminate the states after the start of every interval by the defects."""
        matrix, defect, path = self.views
        cut = self.reduced
        if path.size:
            matrix += (path * weight[self.paths][:, :, None]).transpose(0, 2, 1) @ path
        try:
            self.inverse = np.linalg.inv(defect[:, :, cut:])
        except np.linalg.LinAlgError as error:
            raise Singular("the dynamics cannot be solved for the states") from error
        #: States as a linear function of the other unknowns.
        self.states = -(self.inverse @ defect[:, :, :cut])
        product = matrix[:, :, cut:] @ self.states
        product += matrix[:, :, :cut]
        self.curved, self.pull = product[:, :cut], product[:, cut:]
        self.curved += self.states.transpose(0, 2, 1) @ self.pull
        self.link[:, self.from_states] = self.states[:, self.end_states]

    def sweep(self, tail: Floats) -> Floats:
        """Eliminate the controls from the last interval to the first, and return the matrix that remains."""
        outer = self.outer
        for k in range(self.count - 1, -1, -1):
            link, curved = self.link[k], self.curved[k]
            self.tails[k] = tail
            pulled = tail[:, :-1] @ link
            pulled[:, outer] += tail[:, -1]
            curved += link.T @ pulled
            tail = curved[:outer, : outer + 1]
            if curved.shape[0] > outer + 1:
                triangle, failure = dpotrf(curved[outer + 1 :, outer + 1 :], lower=1)
                if failure:
                    raise Singular("the curvature along the controls is not positive")
                self.gains[k] = dpotrs(triangle, curved[outer + 1 :, : outer + 1], lower=1)[0]
                tail = tail - curved[:outer, outer + 1 :] @ self.gains[k]
        return tail

    def back(self, begin: Floats, step: Floats, duals: Floats, weight: Floats) -> Floats:
        """Compute step and multipliers from the first start, and return the start of the next group."""
        outer, values = self.outer, np.empty((self.count, self.views[0].shape[1]))
        ends = np.empty((self.count, self.link.shape[1]))
        values[:, outer] = 1.0
        starts = values[:, : outer + 1]
        closed = self.link[:, :, : outer + 1] - self.link[:, :, outer + 1 :] @ self.gains
        for k in range(self.count):
            starts[k, :outer] = begin
            ends[k] = begin = closed[k] @ starts[k]
        values[:, outer + 1 : self.reduced] = -(self.gains @ starts[:, :, None])[:, :, 0]
        known = values[:, : self.reduced, None]
        values[:, self.reduced :] = (self.states @ known)[:, :, 0]
        force = self.pull @ known
        costates = (self.tails[:, :, :-1] @ ends[:, :, None])[:, :, 0] + self.tails[:, :, -1]
        force[:, self.end_states, 0] += costates[:, self.from_states]
        duals[self.defects] = -(self.inverse.transpose(0, 2, 1) @ force)[:, :, 0]
        step[self.columns] = values[:, self.kept].reshape(-1)
        if self.paths.size:
            duals[self.paths] = weight[self.paths] * (self.views[2] @ values[:, :, None])[:, :, 0]
        return begin
