"""Solution of the KKT system of a transcribed phase, interval by interval.

The defects of an interval are eliminated by a factorisation of their Jacobian with respect to the states
after the interval's start (condensing). The controls of the interval are then eliminated from the last
interval to the first, as in a Riccati recursion; a Cholesky factor of their curvature exists only near a
strict minimum. Free times, integrals, parameters and boundary conditions are eliminated last. J. B.
Rawlings, D. Q. Mayne, M. M. Diehl, "Model Predictive Control", 2nd ed. (2017), section 8.8.
"""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dsytrf, dsytrs

from .elimination import Front, Group, Singular
from .parametric import Parametric

__all__ = ["NotStaged", "Stages"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


class NotStaged(Exception):
    """The program does not have the structure; the message gives the reason."""


class Stages:
    """Structure of the program of one phase, and the solution of its KKT system.

    `jacobian` and `hessian` are the patterns of the rows' Jacobian and of the upper triangle of the
    Lagrangian's Hessian. Several phases, path equations, and terms that couple distant intervals nonlinearly
    raise ``NotStaged``.
    """

    def __init__(self, posed: Parametric, jacobian: Any, hessian: Any) -> None:
        self.posed = posed
        layout = posed.formulation.layout
        if len(layout.phases) > 1:
            raise NotStaged(f"the problem has {len(layout.phases)} phases")
        self._phase = layout.phases[0]
        bounds = posed.bounds
        self._bounded = np.isfinite(bounds["lbg"]) | np.isfinite(bounds["ubg"])
        self._equal = bounds["lbg"] == bounds["ubg"]
        to_z = np.full(posed.program.size, -1)
        to_z[posed.free] = np.arange(posed.free.size)
        self._to_row = np.full(posed.program.row_count, -1)
        self._to_row[posed.rows] = np.arange(posed.rows.size)
        row, column = (np.array(part, np.int64) for part in jacobian.get_triplet())
        starts, inner, controls = self._columns(to_z)
        #: Interval that eliminates each column; -1 for the first start, -2 for shared columns.
        owner = np.full(posed.free.size, -2)
        owner[starts[0]] = -1
        for k, parts in enumerate(zip(inner, controls, strict=True)):
            owner[np.concatenate(parts)] = k
        self._owner, shared = owner, np.flatnonzero(owner == -2)
        defects, paths = self._rows(to_z)
        local = np.concatenate([*defects, *paths])
        rest = np.setdiff1d(np.flatnonzero(self._bounded), local)
        far = np.isin(rest, row[owner[column] >= 0])
        #: Rows whose multipliers are shared by all intervals, and rows of the first start only.
        self.carried, self.first = rest[far], rest[~far]
        self.shared_rows = np.concatenate([self.carried, self.first])
        self.root_columns = np.concatenate([starts[0], shared])
        self._build(starts, inner, controls, defects, paths, shared)
        self._scatter(row, column, *(np.array(part, np.int64) for part in hessian.get_triplet()))

    # -- structure -------------------------------------------------------------------------------

    def _columns(self, to_z: Whole) -> tuple[list[Whole], list[Whole], list[Whole]]:
        """Return the free columns of each start, then those of each interval's later states and controls.

        The last start is the phase's end.
        """
        phase = self._phase
        result: tuple[list[Whole], list[Whole], list[Whole]] = ([], [], [])
        for k, scheme in enumerate(phase.schemes):
            visits = np.arange(phase.visit_starts[k], phase.visit_starts[k + 1])
            at_start = phase.visit_point[visits] == phase.starts[k]
            states = phase.state_columns[:, phase.starts[k] : phase.starts[k] + scheme.points.size]
            controls = phase.control_columns[:, phase.visit_control[visits]]
            parts = (
                np.concatenate([states[:, 0], controls[:, at_start].reshape(-1)]),
                states[:, 1:].reshape(-1),
                controls[:, ~at_start].reshape(-1),
            )
            for group, part in zip(result, parts, strict=True):
                group.append(to_z[part][to_z[part] >= 0])
        end = states[:, -1]
        if scheme.shared:
            end = np.append(end, phase.control_columns[:, -1])
        result[0].append(to_z[end][to_z[end] >= 0])
        return result

    def _rows(self, to_z: Whole) -> tuple[list[Whole], list[Whole]]:
        """Return the defects and the path rows of each interval."""
        phase, defects, paths = self._phase, [], []
        first = np.arange(phase.nx)[:, None] * phase.defects
        ends_fixed = np.flatnonzero(to_z[phase.state_columns[:, -1]] < 0)
        interval = phase.visit_interval[phase.owners]
        for k in range(len(phase.schemes)):
            rows = first + np.arange(phase.row_starts[k], phase.row_starts[k + 1])
            is_local = np.ones(rows.shape, bool)
            if k == len(phase.schemes) - 1:
                is_local[ends_fixed, -1] = False
            defects.append(self._to_row[rows[is_local]])
            points = np.flatnonzero(interval == k)
            rows = phase.nx * phase.defects + np.arange(phase.paths)[:, None] * phase.collocated
            found = self._to_row[(rows + points).reshape(-1)]
            found = found[found >= 0]
            paths.append(found[self._bounded[found]])
        if self._equal[np.concatenate(paths)].any():
            raise NotStaged("a path constraint is an equation")
        return defects, paths

    def _build(self, starts: Any, inner: Any, controls: Any, defects: Any, paths: Any, shared: Whole) -> None:  # fmt: skip
        """Order the unknowns of every interval, and stack intervals of the same shape."""
        fronts: list[Front] = []
        for k, start in enumerate(starts[:-1]):
            outer = start.size + shared.size + self.carried.size
            reduced = outer + 1 + controls[k].size
            if defects[k].size != inner[k].size:
                raise NotStaged("a state has the same lower and upper bound")
            columns = np.concatenate([start, shared, controls[k], inner[k]])
            width = reduced + inner[k].size
            kept = np.delete(np.arange(width), np.arange(start.size + shared.size, outer + 1))
            unknown = np.full(self.posed.free.size, -1)
            unknown[columns] = kept
            following = np.append(unknown[starts[k + 1]], np.arange(start.size, outer))
            fronts.append(
                Front(columns, kept, outer, reduced, width, following, defects[k], paths[k])
            )
        self.fronts = tuple(fronts)
        size = sum(f.width * (f.width + f.inner + f.paths.size) for f in fronts)
        self._buffer = np.zeros(size + self.root_size**2)
        self.groups: list[Group] = []
        place = 0
        for _, group in groupby(fronts, key=Front.shape):
            self.groups.append(Group([*group], self._buffer, place))
            place = self.groups[-1].end

    def _scatter(self, row: Whole, column: Whole, left: Whole, right: Whole) -> None:
        """Assign the nonzeros of Jacobian and Hessian, the barrier and the right-hand side to positions."""
        size, owner, fronts, groups = self.posed.free.size, self._owner, self.fronts, self.groups
        position = np.full((len(fronts) + 1, size), -1)
        for k, front in enumerate(fronts):
            position[k, front.columns] = front.kept
        position[-1, self.root_columns] = np.arange(self.root_columns.size)
        widths = np.array([*(front.width for front in fronts), self.root_size])
        outers = np.array([front.outer for front in fronts])
        matrices, defects, paths = (np.concatenate([g.places[k] for g in groups]) for k in range(3))
        begins = np.append(matrices, groups[-1].end)

        def entry(front: Whole, first: Whole, second: Whole) -> Whole:
            place: Whole = begins[front] + first * widths[front] + second
            return place

        # Hessian, both triangles.
        front = np.maximum(np.maximum(owner[left], owner[right]), -1)
        first, second = position[front, left], position[front, right]
        if (np.minimum(first, second) < 0).any():
            raise NotStaged("the two ends, or distant intervals, are coupled nonlinearly")
        self._off = off = np.flatnonzero(left != right)
        self._hessian = np.concatenate(
            [entry(front, first, second), entry(front[off], second[off], first[off])]
        )
        # Diagonal and right-hand side of every column.
        own = np.maximum(owner, -1)
        at = position[own, np.arange(size)]
        self._diagonal = entry(own, at, at)
        self._inside = inside = np.flatnonzero(own >= 0)
        self._right = entry(own[inside], at[inside], outers[own[inside]])
        # Jacobian: defects and path rows of an interval, and shared rows, which are symmetric entries.
        base, line = np.full(self.posed.rows.size, -1), np.full(self.posed.rows.size, -1)
        of = np.full(self.posed.rows.size, -1)
        for k, front_ in enumerate(fronts):
            for rows, begin in ((front_.defects, defects[k]), (front_.paths, paths[k])):
                of[rows], base[rows], line[rows] = k, begin, np.arange(rows.size)
        self._local = local = np.flatnonzero(of >= 0)
        self._local_right = base[local] + line[local] * widths[of[local]] + outers[of[local]]
        self._jacobian_from = inside = np.flatnonzero(of[row] >= 0)
        lines = row[inside]
        at = position[of[lines], column[inside]]
        if (at < 0).any():
            raise NotStaged("a constraint couples distant intervals")
        self._jacobian_to = base[lines] + line[lines] * widths[of[lines]] + at
        number = np.full(self.posed.rows.size, -1)
        number[self.shared_rows] = np.arange(self.shared_rows.size)
        among = np.flatnonzero(number[row] >= 0)
        front = own[column[among]]
        starts = np.append(outers - self.carried.size, self.root_columns.size)
        pair = starts[front] + number[row[among]], position[front, column[among]]
        self._shared_from = np.concatenate([among, among])
        self._shared_to = np.concatenate([entry(front, *pair), entry(front, *pair[::-1])])

    @property
    def root_size(self) -> int:
        """Number of unknowns that are eliminated last."""
        return int(self.root_columns.size + self.shared_rows.size)

    # -- solution --------------------------------------------------------------------------------

    def solve(
        self,
        jacobian: Floats,
        hessian: Floats,
        diagonal: Floats,
        gradient: Floats,
        residual: Floats,
        weight: Floats,
    ) -> tuple[Floats, Floats]:
        """Return the step of z and the new multipliers of the rows.

        The step minimises ``gradient·d + d·(hessian + diagonal) d / 2`` subject to the linearised
        equations ``J d + residual = 0``. Inequality rows have a positive weight w and add
        ``w |J d + residual|² / 2``; their multiplier is ``w (J d + residual)``. Weights of equations are
        infinite. Jacobian and Hessian are nonzeros. ``Singular`` is raised far from a strict minimum.
        """
        buffer = self._buffer
        buffer[:] = 0.0
        buffer[self._hessian] = np.concatenate([hessian, hessian[self._off]])
        buffer[self._diagonal] += diagonal
        buffer[self._right] = gradient[self._inside]
        buffer[self._jacobian_to] = jacobian[self._jacobian_from]
        buffer[self._local_right] = residual[self._local]
        buffer[self._shared_to] = jacobian[self._shared_from]
        ends = self.fronts[-1].following.size
        tail = np.zeros((ends, ends + 1))
        for group in self.groups[::-1]:
            group.condense(weight)
            tail = group.sweep(tail)
        outer = self.fronts[0].outer
        root = buffer[self.groups[-1].end :].reshape(self.root_size, self.root_size)
        root[:outer, :outer] += tail[:, :outer]
        shared = np.arange(self.root_columns.size, self.root_size)
        root[shared, shared] -= 1.0 / weight[self.shared_rows]
        factor, pivots, failure = dsytrf(root, lower=1)
        # A block of two rows, with a negative pivot index, has one eigenvalue of each sign.
        single = pivots >= 0
        negative = (factor.diagonal()[single] < 0).sum() + (~single).sum() // 2
        if failure or negative != shared.size:
            raise Singular("the last elimination has the wrong inertia")
        right = np.concatenate([gradient[self.root_columns], residual[self.shared_rows]])
        right[:outer] += tail[:, outer]
        unknown = dsytrs(factor, pivots, -right, lower=1)[0]
        step, duals = np.zeros(gradient.size), np.zeros(residual.size)
        count = self.root_columns.size
        step[self.root_columns], duals[self.shared_rows] = unknown[:count], unknown[count:]
        begin = unknown[:outer]
        for group in self.groups:
            begin = group.back(begin, step, duals, weight)
        return step, duals
