"""Shortest paths without curvature limit for a given order, by Clarabel with prepared matrices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.messenger.model import MessengerTour
from ...models.messenger.relaxation import Field
from .bound_kernels import Data, ascend, omissions, prove_length

__all__ = ["Chains", "Path"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


#: Tolerance of Clarabel.
TOLERANCE = 1e-9


class Path(NamedTuple):
    """Shortest path over L + 1 stops up to the solver's tolerance, and a proven lower bound.

    `bound` is a lower bound on the length of every path over the stops, in the field's unit, and
    `directions` (L, 2) are the dual directions that prove it. `points` (L + 1, 2) and `times`
    (L + 1,) are the place and time of each encounter.
    """

    bound: float
    directions: Floats
    points: Floats
    times: Floats


class Chains:
    """Solver of the relaxation for a sequence of orders; `curved` bounds use the curvature limit."""

    def __init__(self, model: MessengerTour, curved: bool = False) -> None:
        import clarabel  # type: ignore[import-untyped]

        self.field = field = Field.of(model)
        self.curved = curved and model.turning_radius > 0
        self.solved = 0
        self.data = Data(
            field.centres, field.velocities, field.radii, _gaps(field),
            model.turning_radius / field.unit if self.curved else 0.0,
            model.heading is not None, model.heading or 0.0,
        )  # fmt: skip
        self._clarabel = clarabel
        self._settings = settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.presolve_enable = False
        for name in ("tol_feas", "tol_gap_abs", "tol_gap_rel"):
            setattr(settings, name, TOLERANCE)
        self._shapes: dict[int, Any] = {}

    def prove(self, stops: Indices, directions: Floats) -> float:
        """Return the lower bound that `directions` prove, in the field's unit."""
        return float(prove_length(self.data, stops, directions))

    def solve(self, stops: Indices) -> Path:
        """Return the shortest path over the indices `stops`, shape (L + 1,)."""
        field, legs = self.field, len(stops) - 1
        centres, velocities = field.centres[stops], field.velocities[stops]
        if legs < 2 and stops[0] == stops[-1]:
            # Only one place: the path has length 0.
            return Path(0.0, np.zeros((legs, 2)), centres, np.zeros(legs + 1))
        self.solved += 1
        radii = field.radii[stops].copy()
        if not field.free:
            radii[0] = 0.0
        matrix, sources, signs = self._shape(legs)
        values = np.concatenate([[1.0], velocities.ravel(), np.repeat(radii, 2)])
        matrix.data = values[sources] * signs
        right = np.zeros(matrix.shape[0])
        right[: 3 * legs].reshape(-1, 3)[:, 1:] = np.diff(centres, axis=0)
        right[3 * legs :: 3] = 1.0
        cost = np.zeros(matrix.shape[1])
        cost[legs - 1] = 1.0
        cones = [self._clarabel.SecondOrderConeT(3)] * (2 * legs + 1)
        solution = self._clarabel.DefaultSolver(
            sp.csc_matrix((len(cost), len(cost))), cost, matrix, right, cones, self._settings
        ).solve()
        x = np.array(solution.x, float)
        pull = np.array(solution.z[: 3 * legs], float).reshape(-1, 3)
        if not (np.isfinite(x).all() and np.isfinite(pull).all()):
            # Any directions prove a valid bound, so a failed solve needs no special case.
            x, pull = np.nan_to_num(x), np.nan_to_num(pull)
        directions = -pull[:, 1:] / np.maximum(pull[:, :1], 1e-300)
        times = np.append(0.0, x[:legs])
        offsets = x[legs:].reshape(-1, 2)
        if field.free:
            offsets[-1] = offsets[0]
            radii[-1] = radii[0]
        points = centres + velocities * times[:, None] + radii[:, None] * offsets
        bound = self.prove(stops, directions)
        if self.curved:
            bound, directions = self._ascend(stops, directions)
            bound = max(bound, self._omit_stops(bound, stops, directions))
        return Path(bound, directions, points, times)

    def _ascend(self, stops: Indices, directions: Floats) -> tuple[float, Floats]:
        result = np.empty_like(directions)
        return float(ascend(self.data, stops, directions, result)), result

    def _omit_stops(self, bound: float, stops: Indices, directions: Floats) -> float:
        """Return the best bound after greedily omitting stops, as long as this increases the bound."""
        while len(stops) > 2:
            bounds = np.empty(len(directions))
            omissions(self.data, stops, directions, bounds)
            k = int(bounds.argmax())
            # The merged leg starts from the direction of the longer one.
            first, second = self.data.gaps[stops[k], stops[k + 1]], -1.0
            if k + 1 < len(directions):
                second = self.data.gaps[stops[k + 1], stops[k + 2]]
            stops = np.delete(stops, k + 1)
            fewer = np.delete(directions, k + int(first >= second >= 0), axis=0)
            candidate, directions = self._ascend(stops, fewer)
            if not candidate > bound:
                break
            bound = candidate
        return bound

    def _shape(self, legs: int) -> tuple[Any, Indices, Floats]:
        """Return the matrix of a path with `legs` legs, and the source and sign of each entry.

        Columns: s of all stops but the first, then all offsets. Rows: legs, then discs. Sources: 1, velocities, radii.
        """
        if legs in self._shapes:
            shape: tuple[Any, Indices, Floats] = self._shapes[legs]
            return shape
        # Without a fixed start, the last stop is the first one.
        leg, stop = np.arange(legs), np.arange(legs + 1)
        place = np.where(self.field.free & (stop == legs), 0, stop)
        # Row, column, source and sign of the entries.
        blocks = [(3 * leg, leg, 0 * leg, 1), (3 * leg[1:], leg[:-1], 0 * leg[1:], -1)]
        for axis in range(2):
            row, velocity, radius = 3 * leg + 1 + axis, 1 + axis, 1 + 2 * (legs + 1) + axis
            blocks += [
                (row, leg, velocity + 2 * stop[1:], 1),
                (row[1:], leg[:-1], velocity + 2 * stop[1:-1], -1),
                (row, legs + 2 * place[1:] + axis, radius + 2 * place[1:], 1),
                (row, legs + 2 * place[:-1] + axis, radius + 2 * place[:-1], -1),
                (3 * (legs + stop) + 1 + axis, legs + 2 * stop + axis, 0 * stop, 1),
            ]
        rows, columns, sources = (np.concatenate([block[k] for block in blocks]) for k in range(3))
        # The solver's rows are right - matrix @ x.
        signs = np.concatenate([np.full(len(block[0]), -float(block[3])) for block in blocks])
        number = np.arange(1, len(rows) + 1)
        size = (3 * (2 * legs + 1), legs + 2 * (legs + 1))
        matrix = sp.csc_matrix(sp.coo_matrix((number, (rows, columns)), size), dtype=float)
        at = matrix.data.astype(int) - 1
        self._shapes[legs] = matrix, sources[at], signs[at]
        return self._shapes[legs]  # type: ignore[no-any-return]


def _gaps(field: Field) -> Floats:
    """Return the least lengths of flights between any two stops, which drive by |W| L at most: (n + 1, n + 1)."""
    apart = field.centres[None] - field.centres[:, None]
    drift = field.velocities[None] - field.velocities[:, None]
    speed = (drift**2).sum(axis=2)
    nearest = np.maximum(-(apart * drift).sum(axis=2) / np.where(speed > 0, speed, 1.0), 0.0)
    distance = np.hypot(*np.moveaxis(apart + drift * nearest[:, :, None], 2, 0))
    free = distance - field.radii[:, None] - field.radii[None]
    gaps: Floats = np.maximum(free, 0.0) / (1 + np.hypot(*field.velocities.T)) * (1 - 1e-12)
    return gaps
