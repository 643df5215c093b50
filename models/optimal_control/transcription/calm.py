"""Rows that hold controls calm: polynomials of half the degree, and what they cost the objective.

On a singular arc a mesh gains by chattering what the problem itself would not, so refinement holds the
controls there to half the degree. At other places, such as a jump of a control, the same rows restrict the
program. Their multipliers tell the two apart: a multiplier is the derivative of the least objective by
the right-hand side of its row.
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
    """Return the rows that hold a phase's controls to half the degree in calm intervals.

    Parameters
    ----------
    one : PhaseLayout
        The phase.
    size : int
        Number of columns of the program.
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
    """Return what the objective may gain, per interval, if its controls are no longer held calm.

    That is the sum of the multipliers' magnitudes times the size of the control. For a convex program
    whose controls stay within that size it is an upper bound on the gain.

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
        In the unit of the objective, one per phase; 0 for intervals that are not calm.
    """
    counts = [
        np.array([one.mesh.calm_rows(k) for k in range(one.mesh.intervals)])
        for one in layout.phases
    ]
    whole = sum(int(own.sum()) * one.nu for own, one in zip(counts, layout.phases, strict=True))
    at = duals.size - whole
    found: list[Floats] = []
    for one, own, size in zip(layout.phases, counts, sizes.phases, strict=True):
        factors = np.concatenate([np.repeat(size.controls, n) for n in own] + [np.zeros(0)])
        shares = np.abs(duals[at : at + factors.size]) * factors
        at += factors.size
        whose = np.repeat(np.arange(own.size), own * one.nu)
        found.append(np.bincount(whose, shares, own.size).astype(float))
    return tuple(found)
