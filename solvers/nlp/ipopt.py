"""Ipopt: an interior-point method for large sparse programs, through CasADi."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import BackendBroken
from ...models.programs.nonlinear import NonlinearProgram
from ..attempts import Clock, Ended, Ending, limit_reached, solver_tolerance
from ..backend import Feature, Limit, Option, Request
from ..casadi_plugins import ended_by_words, status_of
from .base import COMMON, HESSIAN, most_iterations
from .blas import use_threads
from .casadi_nlp import DERIVATIVES, CasadiNlp
from .scaled import Scaled

__all__ = ["Ipopt"]

Vector = NDArray[np.float64]


class Ipopt(CasadiNlp):
    """Ipopt with the linear solver that CasADi's wheel brings, MUMPS."""

    name = "ipopt"
    plugin = "ipopt"
    limit_option = "max_wall_time"
    given = DERIVATIVES
    features = COMMON | {Feature.INTERRUPT, Feature.THREADS}
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "max_iter": most_iterations(3000),
        "hessian": HESSIAN,
        "linear_solver": Option("mumps", "Ipopt's name of a linear solver it can load.", str),
        "mu_strategy": Option(
            "adaptive", "How the barrier parameter falls.", str, ("monotone", "adaptive")
        ),
        "mu_init": Option(None, "Barrier parameter to start with.", lower=0.0),
    }
    summary = "Ipopt: interior point for large sparse programs, by CasADi"

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return Ipopt's options."""
        own = request.options
        # In Ipopt's own scaling; what is asked of equations (1e-8, say) must hold after it.
        tight = solver_tolerance(request.tolerance * 1e-2, 1e-12, 1e-9)
        options: dict[str, Any] = {
            "print_level": 5 if request.verbose else 0,
            "sb": "yes",
            "tol": solver_tolerance(request.tolerance * 1e-1, 1e-12, 1e-8),
            "constr_viol_tol": tight,
            "compl_inf_tol": 1e-8,
            "dual_inf_tol": 1e-5,
            "max_iter": own["max_iter"],
            "mu_strategy": own["mu_strategy"],
            "hessian_approximation": own["hessian"],
            "linear_solver": own["linear_solver"],
            # Bounds are not widened: a state at its bound is not beyond it.
            "bound_relax_factor": 0.0,
        }
        if self._mumps(request) and not own.get(_CAREFUL):
            options.update(_MUMPS)
        if request.warm_start is not None:
            options.update(
                mu_init=NEAR, bound_mult_init_method="mu-based", **dict.fromkeys(_PUSHES, NEAR)
            )
        if own["mu_init"] is not None:
            options["mu_init"] = own["mu_init"]
        return {"ipopt": options}

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Solve the program; once more with MUMPS as it is by default where that fails.

        Rows that depend on one another were seen to make it diverge with the faster ordering.
        """
        program = _slackened(program)
        found = super().attempt(program, request, clock, start)
        lost = found.ended in (Ended.FAILED, Ended.UNBOUNDED, Ended.INFEASIBLE)
        if not lost or not self._mumps(request) or limit_reached(request, clock) is not None:
            return found
        careful = replace(request, options={**request.options, _CAREFUL: True})
        again = super().attempt(program, careful, clock, start)
        spent = sum(int(one.statistics.get("iterations", 0)) for one in (found, again))
        return replace(again, statistics={"iterations": spent})

    @staticmethod
    def _mumps(request: Request) -> bool:
        return bool(request.options["linear_solver"] == "mumps")

    def load(self, request: Request) -> None:
        """Load the plugin, and let its linear algebra have the threads asked for, else one."""
        super().load(request)
        use_threads(request.threads or 1)

    def first(self, scaled: Scaled, start: Vector) -> dict[str, Any]:
        """Return nothing: Ipopt's own estimate of the multipliers fits its barrier better."""
        return {}

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return how Ipopt ended; an option that it refuses is a library that is not there."""
        if status_of(stats) == "Invalid_Option":
            raise BackendBroken(
                "backend 'ipopt' refuses its options; is the linear solver asked for installed?"
            )
        return ended_by_words(stats)


def _slackened(program: NonlinearProgram) -> NonlinearProgram:
    """Return `program`; with equations as narrow ranges where there are more than free columns.

    Ipopt takes no more equations than columns, and was seen to crash on them; ranges it takes.
    """
    free = int((program.column_lower < program.column_upper).sum())
    equal = program.row_lower == program.row_upper
    if free >= int(equal.sum()):
        return program
    width = np.where(equal, NARROW * program.row_scale, 0.0)
    return replace(
        program, row_lower=program.row_lower - width, row_upper=program.row_upper + width
    )


#: Half the width of an equation that is written as a range, in terms of the row's size.
NARROW = 1e-9
#: MUMPS orders by METIS and leaves the rows where they are: its default, a maximum transversal, was
#: measured to make the factors of a transcribed optimal control problem ten times as slow.
_MUMPS = {"mumps_pivot_order": 5, "mumps_permuting_scaling": 0}
#: Marks a second attempt in the options.
_CAREFUL = "careful"
#: Barrier parameter at a warm start, and how far it is moved off its bounds: an optimum on a coarser
#: mesh was measured to take a third of the iterations that it takes from the default, 0.1.
NEAR = 1e-5
_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
