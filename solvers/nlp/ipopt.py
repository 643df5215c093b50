"""Ipopt: an interior-point method for large sparse programs, through CasADi."""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import BackendBroken
from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending, limit_reached, solver_tolerance
from ..programs.casadi_plugins import ended_by_words, status_of
from .base import COMMON, HESSIAN, most_iterations
from .casadi_nlp import DERIVATIVES, CasadiNlp
from .scaled import Scaled

__all__ = ["Ipopt"]

Vector = NDArray[np.float64]

log = logging.getLogger("crosstrack")

#: Half the width of an equation as a range, relative to the size of the row.
NARROW = 1e-9
#: MUMPS does not permute rows. Its default, a maximum transversal, made the factorisation of a transcribed
#: optimal control problem ten times as slow.
_PERMUTING = 0
#: Numbers of MUMPS's orderings. METIS took 21 % more CPU time per iteration in the median of 23 programs with 357
#: to 15,444 columns, and 17 % less on one with 47,505. With the other one, a problem whose controls are not
#: unique ended infeasible from its guess. It is therefore the default from a warm start only, of programs with
#: at most `_FEW` columns.
_ORDERINGS = {"metis": 5, "minimum-degree": 0}
_FEW = 20_000
#: Mean of the scaled multipliers above which they have diverged: 1e15 with an equation that occurs twice. On 24
#: programs of optimal control the mean was at most 1.5.
DIVERGED = 1e6
#: Largest scaled column of an iterate. Rounding then exceeds the tolerances of equations; at the default, 1e20, the
#: iterates of an unbounded problem of control stall at about 1e18 and use up all iterations.
DIVERGING = 1e12
#: Option that marks a second attempt.
_CAREFUL = "careful"
#: Barrier parameter of a warm start, and its distance from bounds. From an optimum on a coarser mesh,
#: Ipopt takes a third of the iterations of the default, 0.1.
NEAR = 1e-5
#: Options for the distance of a start from bounds.
PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")


class Ipopt(CasadiNlp):
    """Backend for Ipopt with MUMPS, the linear solver in CasADi's wheel."""

    name = "ipopt"
    plugin = "ipopt"
    limit_option = "max_wall_time"
    given = DERIVATIVES
    features = COMMON | {Feature.INTERRUPT, Feature.THREADS}
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(3000),
        "hessian": HESSIAN,
        "linear_solver": Option("mumps", "Name in Ipopt of an installed linear solver.", str),
        "mu_strategy": Option(
            "adaptive", "Update strategy of the barrier parameter.", str, ("monotone", "adaptive")
        ),
        "mu_init": Option(None, "Initial barrier parameter.", lower=0.0),
        "ordering": Option(
            None,
            "Ordering of MUMPS; minimum-degree is faster per iteration, and less reliable on degenerate "
            "programs. By default metis, and minimum-degree from a warm start.",
            str,
            tuple(_ORDERINGS),
        ),
    }
    summary = "Ipopt: interior point for large sparse programs, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of Ipopt."""
        given = request.options
        # Measured in Ipopt's scaling; tolerances of equations, such as 1e-8, must hold without it.
        constraint_tolerance = solver_tolerance(request, 1e-12, 1e-9, share=1e-2)
        options: dict[str, Any] = {
            "print_level": 5 if request.verbose else 0,
            "sb": "yes",
            "tol": solver_tolerance(request, 1e-12, 1e-8, share=1e-1),
            "constr_viol_tol": constraint_tolerance,
            "compl_inf_tol": 1e-8,
            "dual_inf_tol": 1e-5,
            "max_iter": given["max_iter"],
            "mu_strategy": given["mu_strategy"],
            "hessian_approximation": given["hessian"],
            "linear_solver": given["linear_solver"],
            # Bounds are not relaxed, so that a state does not exceed its bound.
            "bound_relax_factor": 0.0,
            "diverging_iterates_tol": DIVERGING,
        }
        if self._mumps(request) and not given.get(_CAREFUL):
            options["mumps_pivot_order"] = _ORDERINGS[_ordering(program, request)]
            options["mumps_permuting_scaling"] = _PERMUTING
        if request.warm_start is not None:
            options.update(
                mu_init=NEAR, bound_mult_init_method="mu-based", **dict.fromkeys(PUSHES, NEAR)
            )
        if given["mu_init"] is not None:
            options["mu_init"] = given["mu_init"]
        return {"ipopt": options}

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Solve the program, and if that fails once more with the default ordering of MUMPS.

        With linearly dependent rows, Ipopt diverged without the permutation. With minimum degree, it stopped far
        from the optimum, with multipliers so large that its relative test of optimality said little.
        """
        program = _slackened(program)
        ending = super().attempt(program, request, clock, start)
        has_failed = ending.ended in (Ended.FAILED, Ended.UNBOUNDED, Ended.INFEASIBLE)
        if _ordering(program, request) != "metis" and ending.duals is not None:
            scaled = np.abs(ending.duals) * program.row_scale / program.objective_scale
            has_diverged = bool(scaled.sum() > DIVERGED * scaled.size)
            has_failed |= ending.ended is Ended.PROVEN and has_diverged
        if not has_failed or not self._mumps(request) or limit_reached(request, clock) is not None:
            return ending
        careful = replace(request, options={**request.options, _CAREFUL: True})
        second = super().attempt(program, careful, clock, start)
        spent = sum(int(part.statistics.get("iterations", 0)) for part in (ending, second))
        return replace(second, statistics={"iterations": spent})

    @staticmethod
    def _mumps(request: Request) -> bool:
        return bool(request.options["linear_solver"] == "mumps")

    def load(self, request: Request) -> None:
        """Load the plugin, and set the threads of its linear algebra, by default one."""
        super().load(request)
        _use_threads(request.threads or 1)

    def first(self, scaled: Scaled, start: Vector) -> dict[str, Any]:
        """Return nothing, because Ipopt's own estimate of the multipliers fits its barrier better."""
        return {}

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return the ending of Ipopt. A rejected option means that a library is missing."""
        if status_of(stats) == "Invalid_Option":
            raise BackendBroken(
                "backend 'ipopt' rejects its options; is the selected linear solver installed?"
            )
        return ended_by_words(stats)


def _ordering(program: NonlinearProgram, request: Request) -> str:
    """Return the name of MUMPS's ordering, by default that for the start and the size of the program."""
    is_fast = request.warm_start is not None and program.size <= _FEW
    return str(request.options["ordering"] or ("minimum-degree" if is_fast else "metis"))


def _slackened(program: NonlinearProgram) -> NonlinearProgram:
    """Return `program`, with equations as narrow ranges if they outnumber the free columns.

    Ipopt rejects more equations than columns, and crashed on them; it accepts ranges.
    """
    free = int((program.column_lower < program.column_upper).sum())
    equal = program.row_lower == program.row_upper
    if free >= int(equal.sum()):
        return program
    width = np.where(equal, NARROW * program.row_scale, 0.0)
    return replace(
        program, row_lower=program.row_lower - width, row_upper=program.row_upper + width
    )


@cache
def _library() -> Any:
    """Return CasADi's OpenBLAS library; None if the wheel has none under its usual name."""
    import casadi

    for file in sorted(Path(casadi.__file__).parent.glob("libcasadi-tp-openblas.so*")):
        try:
            library = ctypes.CDLL(str(file))
            library.openblas_set_num_threads.argtypes = [ctypes.c_int]
        except (OSError, AttributeError) as error:
            log.debug("threads of %s cannot be set: %s", file.name, error)
            continue
        return library
    return None


def _use_threads(count: int) -> None:
    """Set the number of threads of CasADi's linear algebra in this process.

    For the small fronts of a transcribed problem, several threads took twice as long as one, because
    the threads of OpenBLAS wait actively for each other.
    """
    library = _library()
    if library is not None:
        library.openblas_set_num_threads(int(count))
