"""Options, precisions and sizes that the backends for quadratic programs share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...models.programs.linear import QuadraticProgram
from ..contract.backend import Option, Request
from ..programs.attempts import Clock, solver_tolerance

__all__ = [
    "EPS",
    "LINEAR_ALGEBRA",
    "POLISH",
    "first_order_precision",
    "prefers_dense",
    "slice_iterations",
    "time_left",
    "told",
    "too_large",
]

#: Option of every quadratic backend, which comparisons set to False.
POLISH = Option(
    True,
    "Whether to make the answer to a quadratic program exact by solving the equations of the "
    "binding rows; off shows the solver's own precision, and is the default of comparisons.",
    bool,
)
#: Option of first-order methods.
EPS = Option(
    None,
    "Absolute and relative precision. Default: a tenth of the tolerance, which polishing improves, "
    "or a thousandth without polishing.",
    float,
    lower=1e-15,
    upper=1.0,
)
#: Option of solvers with dense and sparse factors.
LINEAR_ALGEBRA = Option(
    "choose",
    "Dense or sparse factors. Default: by the share of nonzero entries.",
    str,
    ("choose", "dense", "sparse"),
)
#: Share of nonzero entries above which dense factors are faster.
DENSE = 0.1
#: Largest dense data in gigabytes that a dense solver accepts.
MEMORY = 2.0
#: Entries of the matrices times iterations between two polls of the stop flag, about 0.3 s.
SLICE = 3e7
#: Seconds for solvers that need a number if the run has no time limit.
UNLIMITED = 1e9
#: Smallest and largest number of iterations between two polls. OSQP adapts its weights every 50.
FEWEST, MOST = 50, 20_000
_EPS = ("eps_abs", "eps_rel")
#: Names of the time limit and the tolerances of each solver in libraries over many solvers. A solver
#: that is missing, or has no time limit, runs with its defaults and is stopped with its process.
_TOLD: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "clarabel": ("time_limit", ("tol_feas", "tol_gap_abs", "tol_gap_rel")),
    "daqp": ("", ("primal_tol", "dual_tol")),
    "ecos": ("", ("abstol", "reltol", "feastol")),
    "highs": ("time_limit", ("primal_feasibility_tolerance", "dual_feasibility_tolerance")),
    "osqp": ("time_limit", _EPS),
    "piqp": ("", _EPS),
    "proxqp": ("", _EPS),
    "scs": ("time_limit_secs", _EPS),
}
#: Iteration limits of first-order methods, which need more than their defaults.
_MORE: Mapping[str, Mapping[str, Any]] = {
    "osqp": {"max_iter": 200_000},
    "scs": {"max_iters": 200_000},
}


def first_order_precision(request: Request) -> float:
    """Return the precision for a first-order method: its option, else from the tolerance.

    The last digits take most of its iterations, and polishing finds them with one linear system.
    """
    share = 1.0 if request.options["polish"] else 1e-2
    return request.options.get("eps") or solver_tolerance(request, 1e-11, 1e-6, share=share)


def slice_iterations(*matrices: Any) -> int:
    """Return the iterations, a multiple of 50, after which a solver without a callback polls the stop flag.

    The number depends on the data only, so that the same program takes the same iterations on a busy machine:
    `matrices` are those that an iteration multiplies by or solves with.
    """
    entries = sum(matrix.nnz for matrix in matrices)
    return FEWEST * int(min(max(SLICE / FEWEST / max(entries, 1), 1), MOST // FEWEST))


def time_left(clock: Clock) -> float:
    """Return the seconds that a solve may take, as a positive number for any solver."""
    left = clock.left()
    return UNLIMITED if left is None else max(left, 1e-3)


def prefers_dense(program: QuadraticProgram, request: Request, largest: int) -> bool:
    """Return True if dense factors are requested, or faster up to `largest` rows and columns."""
    choice = request.options["linear_algebra"]
    if choice != "choose":
        return bool(choice == "dense")
    size, total = program.size, program.size + program.row_count
    filled = program.hessian.nnz + program.matrix.nnz
    return total <= largest and (total <= 50 or filled > DENSE * size * total)


def told(solver: str, request: Request) -> tuple[str, dict[str, Any]]:
    """Return the name of a solver's time limit, empty without one, and its options for a request."""
    time_name, tolerances = _TOLD.get(solver, ("", ()))
    tolerance = solver_tolerance(request, 1e-10, 1e-8, share=1e-2)
    return time_name, {**dict.fromkeys(tolerances, tolerance), **_MORE.get(solver, {})}


def too_large(owner: str, program: QuadraticProgram, rows: int | None = None) -> str:
    """Return the reason why a program is too large for dense copies by `owner`, empty if it is not.

    `rows`: number of dense rows, by default those of the program.
    """
    # Hessian and rows, two copies of each.
    count = program.row_count if rows is None else rows
    needed = 16.0 * program.size * (program.size + count) / 1e9
    if needed <= MEMORY:
        return ""
    return (
        f"{owner} is dense: {program.row_count} rows and {program.size} columns would take "
        f"{needed:.1f} GB, and it stops at {MEMORY:g} GB"
    )
