"""Rows that restrict controls to half the degree ("calm"), and their cost in the objective.

On a singular arc a mesh gains by chattering what the problem itself does not allow, so refinement
restricts the controls there to half the degree. Elsewhere, such as at a jump of a control, the same rows
restrict the program. Their multipliers distinguish the two cases: a multiplier is the derivative of the
optimal objective with respect to the right-hand side of its row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ...programs.triplets import Triplets

if TYPE_CHECKING:
    from ..sizes import Sizes
    from .layout import Layout, PhaseLayout

__all__ = ["calm_rows", "calm_strains"]

Floats = NDArray[np.float64]


def calm_rows(one: PhaseLayout, size: int) -> sp.csr_array:
    """Return the rows that restrict a phase's controls to half the degree in calm intervals.

    Parameters
    ----------
    one : PhaseLayout
        Phase.
    size : int
        Number of columns of the program.

    Returns
    -------
    sparse array, shape (rows, size)
        Coefficients; the right-hand sides are 0.
    """
    rows = Triplets()
    count = 0
    for k, scheme in enumerate(one.schemes):
        many = one.mesh.calm_rows(k)
        if not many:
            continue
        nodes = scheme.control_points
        table = np.linalg.inv(legendre.legvander(nodes, nodes.size - 1))[-many:]
        controls = one.visit_control[one.visit_starts[k] : one.visit_starts[k + 1]]
        for number in range(one.nu):
            rows.add(count + np.arange(many)[:, None], one.control_columns[number, controls], table)
            count += many
    r, c, value, _ = rows.joined()
    return sp.csr_array((value, (r, c)), shape=(count, size))


def calm_strains(layout: Layout, sizes: Sizes, duals: Floats) -> tuple[Floats, ...]:
    """Return the possible gain of the objective, per interval, if its controls were not kept calm.

    The gain is the sum of the multipliers' magnitudes times the size of the control. It is an upper
    bound for a convex program whose controls stay within that size.

    Parameters
    ----------
    layout : Layout
        Columns and meshes of the program.
    sizes : Sizes
        Sizes of the controls.
    duals : ndarray, shape (rows,)
        Multipliers of all rows; those of the calm rows come last.

    Returns
    -------
    tuple of ndarray, shape (intervals,)
        One array per phase, in the unit of the objective; 0 for intervals that are not calm.
    """
    counts = [
        np.array([part.mesh.calm_rows(k) for k in range(part.mesh.intervals)])
        for part in layout.phases
    ]
    total = sum(int(rows.sum()) * part.nu for rows, part in zip(counts, layout.phases, strict=True))
    start = duals.size - total
    result: list[Floats] = []
    for part, rows, size in zip(layout.phases, counts, sizes.phases, strict=True):
        factors = np.concatenate([np.repeat(size.controls, n) for n in rows] + [np.zeros(0)])
        shares = np.abs(duals[start : start + factors.size]) * factors
        start += factors.size
        interval_of = np.repeat(np.arange(rows.size), rows * part.nu)
        result.append(np.bincount(interval_of, shares, rows.size).astype(float))
    return tuple(result)
