"""Algebraic variables: their equations, solved by Newton's method at single instants.

An algebraic variable is stored as a control, and the equations g(t, x, u, z, p) = 0 that determine it as
path constraints. Programs treat them as such. Integrations of the motion solve the equations at
every evaluation of the rates, which is possible if ∂g/∂z is regular (index 1).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import casadi
import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from .definition import Phase, Quantity, Restriction, entry_names, stacked

__all__ = ["algebraic_entries", "check_index", "solved_controls", "solver_of"]

Floats = NDArray[np.float64]

#: Largest number of Newton steps, and largest final step relative to the variables.
STEPS, CONVERGED = 30, 1e-8
#: Number of random points near the guess at which ∂g/∂z is examined, and their distance relative to the
#: scales of all variables.
POINTS, NEAR = 8, 0.1
#: Smallest singular value of the scaled ∂g/∂z, relative to the largest one, of a regular matrix.
REGULAR = 1e-11


def algebraic_entries(items: Iterable[Quantity] | Iterable[Restriction]) -> NDArray[np.int64]:
    """Return the places of algebraic variables in the stacked controls, or of equations in the paths."""
    marks = [np.full(item.size, item.algebraic) for item in items]
    return np.flatnonzero(np.concatenate([*marks, np.zeros(0, bool)]))


def _residual(
    function: casadi.Function, controls: Sequence[Quantity], paths: Sequence[Restriction]
) -> casadi.Function:
    """Return ``(z, q) -> g`` with z in units of the scales and q, the stacked t, x, u and p."""
    entries = algebraic_entries(controls)
    sizes = [function.size1_in(k) for k in range(4)]
    z, joined = casadi.MX.sym("z", entries.size), casadi.MX.sym("q", sum(sizes))
    t, x, u, p = casadi.vertsplit(joined, np.cumsum([0, *sizes]).tolist())
    u = casadi.MX(u)
    u[entries.tolist()] = z * stacked(controls, "scale")[entries]
    rows = algebraic_entries(paths)
    path = function(t, x, u, p)[1][rows.tolist()]
    residual = (path - stacked(paths, "lower")[rows]) / stacked(paths, "scale")[rows]
    result = casadi.Function("g", [z, joined], [casadi.densify(residual)], ["z", "q"], ["g"])
    try:
        return result.expand()
    except RuntimeError:  # tables have no scalar form
        return result


@lru_cache(maxsize=64)
def solver_of(
    function: casadi.Function, controls: tuple[Quantity, ...], paths: tuple[Restriction, ...]
) -> casadi.Function | None:
    """Return ``(t, x, u, p) -> u`` that solves the equations for the algebraic variables in u.

    Newton's method starts from their values in the argument. They are NaN if it does not converge.
    The result is None without algebraic variables.
    """
    entries = algebraic_entries(controls)
    if not entries.size:
        return None
    residual = _residual(function, controls, paths)
    options = {"max_iter": STEPS, "error_on_fail": False, "show_eval_warnings": False}
    newton = casadi.rootfinder("algebraic", "newton", residual, options)
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    scale, joined = stacked(controls, "scale")[entries], casadi.vertcat(*arguments)
    z = newton(arguments[2][entries.tolist()] / scale, joined)
    jacobian = residual.factory("slope", ["z", "q"], ["jac:g:z"])
    step = casadi.solve(jacobian(z, joined), residual(z, joined))
    converged = casadi.norm_inf(step) <= CONVERGED * casadi.fmax(1.0, casadi.norm_inf(z))
    u = casadi.MX(arguments[2])
    u[entries.tolist()] = casadi.if_else(converged, z, np.nan) * scale
    return casadi.Function("solved", arguments, [u], function.name_in(), ["solved"])


def solved_controls(phase: Phase) -> casadi.Function | None:
    """Return :func:`solver_of` of a phase."""
    return solver_of(phase.function, phase.controls, phase.paths)


def check_index(phase: Phase, parameters: Floats) -> None:
    """Raise if ∂g/∂z is singular near the guess, so that the equations do not determine the variables.

    The error names the variables in the kernel of ∂g/∂z.
    """
    entries = algebraic_entries(phase.controls)
    if not entries.size:
        return
    residual = _residual(phase.function, phase.controls, phase.paths)
    slope = residual.factory("slope", ["z", "q"], ["jac:g:z"])
    draw, guess = np.random.default_rng(0), phase.guess
    scale_x, scale_u = phase.stacked("states", "scale"), phase.stacked("controls", "scale")
    best: tuple[float, Floats] = -1.0, np.ones(entries.size)
    for k in range(POINTS):
        row = k * (guess.fractions.size - 1) // max(POINTS - 1, 1)
        t = guess.start + guess.fractions[row] * (guess.end - guess.start)
        x = guess.states[row] + NEAR * scale_x * draw.normal(size=scale_x.size)
        u = guess.controls[row] + NEAR * scale_u * draw.normal(size=scale_u.size)
        joined = np.concatenate([[t], x, u, parameters])
        table = slope(u[entries] / scale_u[entries], joined).full()
        if not np.isfinite(table).all():
            continue
        table /= np.maximum(np.abs(table).max(axis=1, keepdims=True), 1e-300)
        _, values, kernel = np.linalg.svd(table)
        ratio = values[-1] / max(values[0], 1e-300)
        if ratio > best[0]:
            best = ratio, np.abs(kernel[-1])
        if ratio > REGULAR:
            return
    if best[0] < 0:
        return  # nothing is known where the equations cannot be evaluated
    names = np.array(entry_names(phase.controls))[entries]
    unknown = ", ".join(map(repr, names[best[1] > 0.1 * best[1].max()].tolist()))
    raise InvalidData(
        f"phase {phase.name!r}: the algebraic equations do not determine {unknown}: their derivative by "
        "the algebraic variables is singular (index above 1); differentiate an equation with respect to "
        "time and insert the dynamics until the variables occur in it",
        field="algebraic",
    )
