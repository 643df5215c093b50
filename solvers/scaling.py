"""A linear or quadratic program in the units of its data, where those are far from 1.

A solver's tolerances are absolute: thresholds of 1e-9 are nothing to it, and data of 1e9 were seen to
be claimed infeasible. Rows, continuous columns and the objective are scaled by powers of two, which
change no digit, one factor a block; what lies in :data:`PLAIN` is left as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..models.programs.blocks import Block
from ..models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..models.verification import ROUNDING
from .backend import Answer, Request

__all__ = ["PLAIN", "Scaling", "common"]

Vector = NDArray[np.float64]

#: Magnitudes that solvers take as they are.
PLAIN = (1e-1, 1e8)


@dataclass(frozen=True)
class Scaling:
    """`program` is the given one in ``x / columns``, its rows times `rows`, its objective / `unit`."""

    program: MixedIntegerProgram | QuadraticProgram
    columns: Vector
    rows: Vector
    unit: float

    @classmethod
    def of(cls, program: MixedIntegerProgram | QuadraticProgram) -> Scaling | None:
        """Return the scaling of `program`, None where its data are of common size."""
        integral = np.zeros(program.size, bool)
        if isinstance(program, MixedIntegerProgram):
            integral = program.integral
        entries = abs(program.matrix)
        bounds = _largest(program.row_lower, program.row_upper)
        whole = entries @ sp.diags_array(integral.astype(float))
        # What the continuous columns of a row are held against.
        constants = np.maximum(bounds, whole.max(axis=1).toarray().ravel() if whole.nnz else 0.0)
        # Bounds that are what rounding left of 0 say nothing of a size.
        constants[constants <= ROUNDING * constants.max(initial=0.0)] = 0.0
        row = np.repeat(np.arange(program.row_count), np.diff(entries.indptr))
        held = constants[row] > 0
        own = _largest(program.column_lower, program.column_upper)
        wanted = np.concatenate([constants[row[held]] / entries.data[held], own[own > 0]])
        place = np.concatenate([entries.indices[held], np.flatnonzero(own)])
        columns = np.ones(program.size)
        for block in program._columns:
            here = (place >= block.start) & (place < block.start + block.size)
            if not integral[block.slice].any() and here.any():
                columns[block.slice] = common(float(np.median(wanted[here])))
        plain = (columns == 1.0).all()
        sized = entries if plain else entries @ sp.diags_array(columns)
        largest = sized.max(axis=1).toarray().ravel() if sized.nnz else np.zeros(program.row_count)
        rows = _by_block(program._rows, 1.0 / np.where(largest > 0, largest, 1.0), largest > 0)
        costs = np.abs(program.cost) * columns
        changed: dict[str, Any] = {}
        if isinstance(program, QuadraticProgram):
            hessian = program.hessian
            if not plain:
                hessian = sp.diags_array(columns) @ hessian @ sp.diags_array(columns)
            costs = np.maximum(costs, np.abs(hessian.diagonal()))
            changed["hessian"] = hessian
        unit = common(float(costs.max(initial=0.0)) or 1.0)
        if plain and (rows == 1.0).all() and unit == 1.0:
            return None
        if "hessian" in changed:
            changed["hessian"] = changed["hessian"] / unit
        scaled = replace(
            program,
            cost=program.cost * columns / unit,
            offset=program.offset / unit,
            matrix=sp.diags_array(rows) @ program.matrix @ sp.diags_array(columns),
            row_lower=program.row_lower * rows,
            row_upper=program.row_upper * rows,
            column_lower=program.column_lower / columns,
            column_upper=program.column_upper / columns,
            **changed,
        )
        return cls(scaled, columns, rows, unit)

    def request(self, request: Request, control: Any) -> Request:
        """Return `request` in the units of the scaled program."""
        warm, cutoff = request.warm_start, request.cutoff
        return replace(
            request,
            control=control,
            warm_start=None if warm is None else np.asarray(warm, float) / self.columns,
            cutoff=None if cutoff is None else cutoff / self.unit,
        )

    def answered(self, request: Request, run: Callable[[Any, Request], Answer]) -> Answer:
        """Return the answer of `run` on the scaled program in the units of the given one."""

        def report(objective: float, point: Any) -> None:
            request.control.incumbent(*self.lifted(objective, point))

        def proven(bound: float) -> None:
            request.control.prove(bound * self.unit)

        with request.control.stage(request.time_limit, report, proven) as control:
            return self.answer(run(self.program, self.request(request, control)))

    def lifted(self, objective: float, point: Any) -> tuple[float, Any]:
        """Return objective and point in the units of the given program."""
        return objective * self.unit, np.asarray(point) * self.columns

    def answer(self, answer: Answer) -> Answer:
        """Return `answer` in the units of the given program."""
        primal, dual, duals = answer.primal_bound, answer.dual_bound, answer.duals
        return replace(
            answer,
            point=None if answer.point is None else answer.point * self.columns,
            primal_bound=None if primal is None else primal * self.unit,
            dual_bound=None if dual is None else dual * self.unit,
            duals=None if duals is None else duals * self.rows * self.unit,
        )


def _largest(lower: Vector, upper: Vector) -> Vector:
    """Return the larger size of two bounds, 0 for what is infinite."""
    sizes = [np.where(np.isfinite(bound), np.abs(bound), 0.0) for bound in (lower, upper)]
    return np.maximum(*sizes)


def _by_block(blocks: Iterable[Block], wanted: Vector, counts: NDArray[np.bool_]) -> Vector:
    """Return one power of two a block: the median of what is wanted, of the entries that count."""
    found = np.ones(wanted.size)
    for block in blocks:
        take = wanted[block.slice][counts[block.slice]]
        if take.size:
            found[block.slice] = 1.0 / common(1.0 / float(np.median(take)))
    return found


def common(magnitude: float) -> float:
    """Return 1 for a magnitude that solvers take as it is, else the power of two next to it."""
    if PLAIN[0] <= magnitude <= PLAIN[1]:
        return 1.0
    return float(2.0 ** np.clip(np.round(np.log2(magnitude)), -500, 500))
