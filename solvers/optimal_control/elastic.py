"""Elastic programs: limits with slacks, for the smallest relaxation that makes a program feasible."""

from __future__ import annotations

from dataclasses import dataclass

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram
from ...models.programs.triplets import dm

__all__ = ["Elastic", "elastic"]

Vector = NDArray[np.float64]

#: Weight of the distance from the guess relative to the relaxation; it makes the optimum unique.
NEAR = 1e-6


@dataclass(frozen=True, eq=False)
class Elastic:
    """Program with relaxed limits: the original columns, then one slack per group.

    The groups are blocks of rows or columns of the original program with relaxed bounds. Each slack is
    in units of its group's typical size, one of `scales`.
    """

    program: NonlinearProgram
    groups: tuple[Block, ...]
    scales: Vector


def elastic(program: NonlinearProgram, rows: list[Block], columns: list[Block]) -> Elastic:
    """Return `program` with the bounds of `rows` and `columns` relaxed by one slack per block.

    All other rows and bounds are unchanged. The objective is the sum of the slacks relative to their
    block's typical size. As a sum, it relaxes few blocks if few suffice.
    """
    n, rest, groups = program.size, program.row_count, [*rows, *columns]
    # Bounded quantities of the original program: rows first, then columns.
    low = np.concatenate([program.row_lower, program.column_lower])
    high = np.concatenate([program.row_upper, program.column_upper])
    sizes = np.concatenate([program.row_scale, program.column_scale])
    relaxed = [np.arange(rest + n)[block.slice] for block in rows]
    relaxed += [rest + np.arange(n)[block.slice] for block in columns]
    scales = np.array([sizes[indices].max() for indices in relaxed])
    # The kept rows, then each finite bound of a relaxed block, plus or minus its group's slack.
    unchanged = np.setdiff1d(np.arange(rest), np.concatenate([*relaxed, np.empty(0)]))
    places, widths = [unchanged], [np.zeros((unchanged.size, len(groups)))]
    lower, upper = [low[unchanged]], [high[unchanged]]
    for number, indices in enumerate(relaxed):
        for edge, sign in ((low, 1.0), (high, -1.0)):
            finite = indices[np.isfinite(edge[indices])]
            places.append(finite)
            widths.append(
                np.outer(np.ones(finite.size), sign * scales * np.eye(len(groups))[number])
            )
            lower.append(edge[finite] if sign > 0 else np.full(finite.size, -np.inf))
            upper.append(edge[finite] if sign < 0 else np.full(finite.size, np.inf))
    place, width = np.concatenate(places), sp.csc_array(np.concatenate(widths))
    chosen = sp.csc_array(
        (np.ones(place.size), (np.arange(place.size), place)), (place.size, rest + n)
    )
    of_rows, of_columns, wide = (dm(part) for part in (chosen[:, :rest], chosen[:, rest:], width))
    x = casadi.MX.sym("x", n + len(groups))
    original, slack = x[:n], x[n:]
    duals, scale = casadi.MX.sym("lam_g", place.size), casadi.MX.sym("lam_f")
    constrained = of_rows @ program.function(original)[1] + of_columns @ original + wide @ slack
    first = casadi.horzcat(of_rows @ program.first_order(original)[1] + of_columns, wide)
    distance = (original - program.guess) / program.column_scale
    cost = casadi.sum1(slack) + 0.5 * NEAR * casadi.sumsqr(distance)
    gradient = casadi.vertcat(
        NEAR * distance / program.column_scale, casadi.MX(casadi.DM.ones(len(groups)))
    )
    curved = program.second_order(original, 0.0, casadi.densify(of_rows.T @ duals))
    curved = curved + scale * casadi.diag(casadi.DM(NEAR / program.column_scale**2))
    hessian = casadi.diagcat(curved, casadi.MX(len(groups), len(groups)))
    is_relaxed = np.isin(np.arange(n), np.concatenate([*relaxed, np.empty(0)]) - rest)
    # Initial slacks, which make the guess feasible.
    values = program.values(program.guess)[1]
    violation = np.nan_to_num(np.maximum(low[:rest] - values, values - high[:rest]), posinf=1.0)
    needed = np.array(
        [violation[indices].max(initial=0.0) for indices in relaxed[: len(rows)]]
        + [0.0] * len(columns)
    )
    needed = needed / scales + 0.1
    elastic_program = NonlinearProgram(
        name=f"{program.name}, with limits that give",
        function=casadi.Function(
            "elastic", [x], [cost, casadi.densify(constrained)], ["x"], ["f", "g"]
        ),
        row_lower=np.concatenate(lower),
        row_upper=np.concatenate(upper),
        column_lower=np.concatenate(
            [np.where(is_relaxed, -np.inf, low[rest:]), np.zeros(len(groups))]
        ),
        column_upper=np.append(
            np.where(is_relaxed, np.inf, high[rest:]), np.full(len(groups), np.inf)
        ),
        guess=np.concatenate([program.guess, needed]),
        column_scale=np.concatenate([program.column_scale, np.ones(len(groups))]),
        derivatives=casadi.Function("first", [x], [gradient, first], ["x"], ["grad_f", "jac_g"]),
        hessian=casadi.Function(
            "second", [x, scale, duals], [casadi.triu(hessian)], ["x", "lam_f", "lam_g"], ["hess"]
        ),
    )
    return Elastic(elastic_program, tuple(groups), scales)
