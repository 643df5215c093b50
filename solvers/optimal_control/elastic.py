"""A program with limits that give: the least widening that lets everything hold together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram

if TYPE_CHECKING:
    import casadi

__all__ = ["Elastic", "elastic"]

Vector = NDArray[np.float64]

#: Weight of staying near the guess, beside the widening: it makes the answer one point.
NEAR = 1e-6


@dataclass(frozen=True, eq=False)
class Elastic:
    """A program whose limits give, and what its further columns mean.

    Parameters
    ----------
    program : NonlinearProgram
        The columns of the original, then one slack a group, in units of the group's typical size.
    groups : tuple of Block
        Blocks of rows or columns of the original whose bounds give.
    scales : ndarray, shape (groups,)
        Typical size of each group.
    """

    program: NonlinearProgram
    groups: tuple[Block, ...]
    scales: Vector


def elastic(program: NonlinearProgram, rows: list[Block], columns: list[Block]) -> Elastic:
    """Return `program` with the bounds of `rows` and `columns` widened by one slack a block.

    All other rows and bounds hold as they are. The objective is the sum of the slacks, each in terms
    of its block's typical size: a sum, so that few blocks give where few are enough.
    """
    import casadi

    n, groups = program.size, [*rows, *columns]
    scales = np.array(
        [
            *(float(program.row_scale[block.slice].max()) for block in rows),
            *(float(program.column_scale[block.slice].max()) for block in columns),
        ]
    )
    loose = np.zeros(program.row_count, bool)
    for block in rows:
        loose[block.slice] = True
    kept = np.flatnonzero(~loose)
    parts: list[_Part] = [
        _Part(kept, None, 0.0, 0, program.row_lower[kept], program.row_upper[kept])
    ]
    lower, upper = program.column_lower.copy(), program.column_upper.copy()
    for number, block in enumerate(groups):
        on_rows = number < len(rows)
        index = np.arange(block.start, block.start + block.size)
        low = (program.row_lower if on_rows else program.column_lower)[block.slice]
        high = (program.row_upper if on_rows else program.column_upper)[block.slice]
        for edge, sign in ((low, 1.0), (high, -1.0)):
            known = np.isfinite(edge)
            if not known.any():
                continue
            bounds = (edge[known], np.full(known.sum(), np.inf))
            if sign < 0:
                bounds = (np.full(known.sum(), -np.inf), edge[known])
            place = index[known]
            parts.append(
                _Part(place if on_rows else None, None if on_rows else place, sign, number, *bounds)
            )
        if not on_rows:
            lower[block.slice], upper[block.slice] = -np.inf, np.inf
    x = casadi.MX.sym("x", n + len(groups))
    own, slack = x[:n], x[n:]
    g = program.function(own)[1]
    jacobian = program.first_order(own)[1]
    count = sum(part.size for part in parts)
    duals, scale = casadi.MX.sym("lam_g", count), casadi.MX.sym("lam_f")
    given, first, pulled, at = [], [], casadi.MX(program.row_count, 1), 0
    unit = casadi.MX(casadi.Sparsity.diag(n), casadi.DM.ones(n))
    for part in parts:
        place = (part.rows if part.columns is None else part.columns).tolist()  # type: ignore[union-attr]
        values = g[place] if part.columns is None else own[place]
        table = jacobian[place, :] if part.columns is None else unit[place, :]
        widths = casadi.MX(part.size, len(groups))
        if part.sign:
            given.append(values + part.sign * scales[part.group] * slack[part.group])
            widths[:, part.group] = part.sign * scales[part.group]
        else:
            given.append(values)
        first.append(casadi.horzcat(table, widths))
        if part.columns is None:
            spread = casadi.MX(_selection(part.rows, program.row_count))
            pulled = pulled + casadi.mtimes(spread, duals[at : at + part.size])
        at += part.size
    away = (own - program.guess) / program.column_scale
    cost = casadi.sum1(slack) + 0.5 * NEAR * casadi.sumsqr(away)
    gradient = casadi.vertcat(
        NEAR * away / program.column_scale, casadi.MX(casadi.DM.ones(len(groups)))
    )
    curved = program.second_order(own, 0.0, casadi.densify(pulled))
    curved = curved + scale * casadi.diag(casadi.DM(NEAR / program.column_scale**2))
    hessian = casadi.diagcat(curved, casadi.MX(len(groups), len(groups)))
    worst = _needed(program, rows, columns, scales)
    made = NonlinearProgram(
        name=f"{program.name}, with limits that give",
        function=casadi.Function(
            "elastic", [x], [cost, casadi.densify(casadi.vertcat(*given))], ["x"], ["f", "g"]
        ),
        row_lower=np.concatenate([part.lower for part in parts]),
        row_upper=np.concatenate([part.upper for part in parts]),
        column_lower=np.concatenate([lower, np.zeros(len(groups))]),
        column_upper=np.concatenate([upper, np.full(len(groups), np.inf)]),
        guess=np.concatenate([program.guess, worst]),
        column_scale=np.concatenate([program.column_scale, np.ones(len(groups))]),
        derivatives=casadi.Function(
            "first", [x], [gradient, casadi.vertcat(*first)], ["x"], ["grad_f", "jac_g"]
        ),
        hessian=casadi.Function(
            "second", [x, scale, duals], [casadi.triu(hessian)], ["x", "lam_f", "lam_g"], ["hess"]
        ),
    )
    return Elastic(made, tuple(groups), scales)


@dataclass(frozen=True, eq=False)
class _Part:
    """Some rows of the elastic program: rows or columns of the original, plus sign times a slack."""

    rows: NDArray[np.int64] | None
    columns: NDArray[np.int64] | None
    sign: float
    group: int
    lower: Vector
    upper: Vector

    @property
    def size(self) -> int:
        return int(self.lower.size)


def _selection(rows: Any, count: int) -> casadi.DM:
    """Return the matrix that puts values at `rows` of a vector of `count`."""
    import casadi

    size = len(rows)
    return casadi.DM.triplet(
        list(map(int, rows)), list(range(size)), casadi.DM.ones(size), count, size
    )


def _needed(
    program: NonlinearProgram, rows: list[Block], columns: list[Block], scales: Vector
) -> Vector:
    """Return the slacks that the guess needs."""
    values = program.values(program.guess)[1]
    needed = []
    for block in rows:
        off = np.maximum(program.row_lower - values, values - program.row_upper)[block.slice]
        needed.append(float(np.nan_to_num(off, posinf=1.0).max(initial=0.0)))
    needed += [0.0] * len(columns)
    found: Vector = np.maximum(np.array(needed), 0.0) / scales + 0.1
    return found
