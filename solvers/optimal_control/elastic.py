"""A program with limits that give: the least widening that lets everything hold together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.blocks import Block
from ...models.programs.nonlinear import NonlinearProgram
from ...models.programs.triplets import dm

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

    n, rest, groups = program.size, program.row_count, [*rows, *columns]
    # Rows first, then columns, of the original: what is bounded.
    low = np.concatenate([program.row_lower, program.column_lower])
    high = np.concatenate([program.row_upper, program.column_upper])
    sizes = np.concatenate([program.row_scale, program.column_scale])
    giving = [np.arange(rest + n)[block.slice] for block in rows]
    giving += [rest + np.arange(n)[block.slice] for block in columns]
    scales = np.array([sizes[at].max() for at in giving])
    # Rows that are kept, then each finite edge of what gives, plus or minus its group's slack.
    kept = np.setdiff1d(np.arange(rest), np.concatenate([*giving, np.empty(0)]))
    places, widths = [kept], [np.zeros((kept.size, len(groups)))]
    lower, upper = [low[kept]], [high[kept]]
    for number, at in enumerate(giving):
        for edge, sign in ((low, 1.0), (high, -1.0)):
            known = at[np.isfinite(edge[at])]
            places.append(known)
            widths.append(
                np.outer(np.ones(known.size), sign * scales * np.eye(len(groups))[number])
            )
            lower.append(edge[known] if sign > 0 else np.full(known.size, -np.inf))
            upper.append(edge[known] if sign < 0 else np.full(known.size, np.inf))
    place, width = np.concatenate(places), sp.csc_array(np.concatenate(widths))
    chosen = sp.csc_array(
        (np.ones(place.size), (np.arange(place.size), place)), (place.size, rest + n)
    )
    of_rows, of_columns, wide = (dm(part) for part in (chosen[:, :rest], chosen[:, rest:], width))
    x = casadi.MX.sym("x", n + len(groups))
    own, slack = x[:n], x[n:]
    duals, scale = casadi.MX.sym("lam_g", place.size), casadi.MX.sym("lam_f")
    given = of_rows @ program.function(own)[1] + of_columns @ own + wide @ slack
    first = casadi.horzcat(of_rows @ program.first_order(own)[1] + of_columns, wide)
    away = (own - program.guess) / program.column_scale
    cost = casadi.sum1(slack) + 0.5 * NEAR * casadi.sumsqr(away)
    gradient = casadi.vertcat(
        NEAR * away / program.column_scale, casadi.MX(casadi.DM.ones(len(groups)))
    )
    curved = program.second_order(own, 0.0, casadi.densify(of_rows.T @ duals))
    curved = curved + scale * casadi.diag(casadi.DM(NEAR / program.column_scale**2))
    hessian = casadi.diagcat(curved, casadi.MX(len(groups), len(groups)))
    loose = np.isin(np.arange(n), np.concatenate([*giving, np.empty(0)]) - rest)
    # The slacks that the guess needs.
    values = program.values(program.guess)[1]
    off = np.nan_to_num(np.maximum(low[:rest] - values, values - high[:rest]), posinf=1.0)
    needed = np.array(
        [off[at].max(initial=0.0) for at in giving[: len(rows)]] + [0.0] * len(columns)
    )
    needed = needed / scales + 0.1
    made = NonlinearProgram(
        name=f"{program.name}, with limits that give",
        function=casadi.Function("elastic", [x], [cost, casadi.densify(given)], ["x"], ["f", "g"]),
        row_lower=np.concatenate(lower),
        row_upper=np.concatenate(upper),
        column_lower=np.concatenate([np.where(loose, -np.inf, low[rest:]), np.zeros(len(groups))]),
        column_upper=np.append(np.where(loose, np.inf, high[rest:]), np.full(len(groups), np.inf)),
        guess=np.concatenate([program.guess, needed]),
        column_scale=np.concatenate([program.column_scale, np.ones(len(groups))]),
        derivatives=casadi.Function("first", [x], [gradient, first], ["x"], ["grad_f", "jac_g"]),
        hessian=casadi.Function(
            "second", [x, scale, duals], [casadi.triu(hessian)], ["x", "lam_f", "lam_g"], ["hess"]
        ),
    )
    return Elastic(made, tuple(groups), scales)
