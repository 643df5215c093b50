"""Base of the solvers of CasADi's ``nlpsol``: translation, monitoring and results of a plugin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import BackendBroken
from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import Clock, Ended, Ending, limit_reached
from ..programs.casadi_plugins import ended_by_words, last_line, load_plugin, status_of, vector
from .base import COMMON, NonlinearBackend
from .quality import estimated_duals
from .scaled import Scaled

__all__ = ["DERIVATIVES", "CasadiNlp"]

Vector = NDArray[np.float64]

#: Derivatives that Ipopt and related solvers accept.
DERIVATIVES: Mapping[str, str] = {"grad_f": "gradient", "jac_g": "jacobian", "hess_lag": "hessian"}


class CasadiNlp(NonlinearBackend):
    """Base of the backends for plugins of ``casadi.nlpsol``.

    A plugin that does not load raises :class:`BackendBroken` with CasADi's message. A plugin that
    calls back in each iteration and can stop there has the feature ``INTERRUPT``. `plugin` is its name in
    CasADi, and `limit_option` its option for the time limit. `given` maps CasADi's options to the derivatives
    in :class:`~.scaled.Scaled` that the plugin accepts; CasADi differentiates the others automatically.
    `brings_highs` marks a plugin that loads CasADi's own HiGHS library.
    """

    requires = ("casadi",)
    features = COMMON | {Feature.INTERRUPT}
    plugin: ClassVar[str]
    limit_option: ClassVar[str] = ""
    given: ClassVar[Mapping[str, str]] = {}
    brings_highs: ClassVar[bool] = False

    def settings(self, program: NonlinearProgram, request: Request) -> dict[str, Any]:
        """Return the options of the plugin: no output, sufficient precision."""
        return {}

    def ended(self, stats: Mapping[str, Any]) -> tuple[Ended, Limit | None]:
        """Return the ending and limit from the plugin's statistics."""
        return ended_by_words(stats)

    def load(self, request: Request) -> None:
        """Load the plugin and the libraries it needs."""
        load_plugin(self.name, "nlpsol", self.plugin, brings_highs=self.brings_highs)

    def create(self, name: str, problem: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
        """Return CasADi's solver of `problem` with the options of the plugin."""
        import casadi

        call: Any = casadi
        quiet = dict.fromkeys(("error_on_fail", "print_time", "show_eval_warnings"), False)
        try:
            return call.nlpsol(name, self.plugin, problem, {**quiet, **options})
        except RuntimeError as error:
            raise BackendBroken(
                f"backend {self.name!r}: plugin {self.plugin!r} does not start: {last_line(error)}"
            ) from error

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Pass the program to the plugin, with a callback if it supports one."""
        self.load(request)
        scaled = Scaled(program)
        options = {name: getattr(scaled, self.given[name]) for name in self.given}
        watcher = None
        if Feature.INTERRUPT in self.features:
            # CasADi keeps no reference to the callback, so it must outlive the call.
            watcher = _watcher(program, lambda: limit_reached(request, clock))
            options["iteration_callback"] = watcher
        options.update(self.settings(program, request))
        left = clock.left()
        if left is not None and self.limit_option:
            options.get(self.plugin, options)[self.limit_option] = max(left, 1e-3)
        solver = self.create("solver", scaled.problem(), options)
        clock.lap("build")
        first = {} if request.warm_start is None else self.first(scaled, start)
        try:
            result = solver(x0=scaled.start(start), **scaled.bounds, **first)
        except RuntimeError as error:
            clock.lap("solve")
            return self.ending_of_error(error, scaled, request, clock, watcher)
        clock.lap("solve")
        try:
            stats = solver.stats()
        except RuntimeError:
            stats = {}  # missing after an early failure
        return self.ending(stats, result, scaled, request, clock)

    def first(self, scaled: Scaled, start: Vector) -> dict[str, Any]:
        """Return the multipliers of a warm start, by CasADi's names; empty if they cannot be estimated."""
        duals = estimated_duals(scaled.program, start)
        if duals is None:
            return {}
        return scaled.multipliers(start, duals)

    def ending(
        self,
        stats: Mapping[str, Any],
        solution: Any,
        scaled: Scaled,
        request: Request,
        clock: Clock,
    ) -> Ending:
        """Return the ending of the plugin in the units of the program."""
        point, duals = scaled.point(vector(solution["x"])), scaled.duals(vector(solution["lam_g"]))
        ended, limit = self.ended(stats)
        late = limit_reached(request, clock)
        if ended is not Ended.PROVEN and late is not None:
            ended, limit = Ended.STOPPED, late
        message = "" if ended is Ended.PROVEN else f"{self.name}: {status_of(stats)}"
        count = stats.get("iter_count")
        return Ending(
            ended,
            point if np.isfinite(point).all() else None,
            duals=duals if np.isfinite(duals).all() else None,
            limit=limit,
            statistics={} if count is None or int(count) < 0 else {"iterations": int(count)},
            message=message,
        )

    def ending_of_error(
        self, error: RuntimeError, scaled: Scaled, request: Request, clock: Clock, watcher: Any
    ) -> Ending:
        """Return the ending of a run that raised an exception, as some plugins do when stopped."""
        late = limit_reached(request, clock)
        point = duals = None
        if watcher is not None and watcher.last is not None:
            point, duals = scaled.point(watcher.last[0]), scaled.duals(watcher.last[1])
        return Ending(
            Ended.FAILED if late is None else Ended.STOPPED,
            point,
            duals=duals,
            limit=late,
            message=f"{self.name}: {last_line(error)}",
        )


def _watcher(program: NonlinearProgram, limit_reached: Callable[[], Limit | None]) -> Any:
    """Return a CasADi callback that stops the plugin once `limit_reached` returns a limit."""
    import casadi

    sizes = {"f": 1, "x": program.size, "lam_x": program.size}
    sizes.update(g=program.row_count, lam_g=program.row_count)
    places = {casadi.nlpsol_out(index): index for index in range(casadi.nlpsol_n_out())}

    class Watcher(casadi.Callback):
        """Callback that checks the clock and stop requests in every iteration."""

        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.last: tuple[Vector, Vector] | None = None
            self.construct("watcher", {})

        def get_n_in(self) -> int:
            return int(casadi.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, index: int) -> Any:
            return casadi.Sparsity.dense(sizes.get(casadi.nlpsol_out(index), 0), 1)

        def eval(self, arg: Any) -> list[int]:
            if limit_reached() is None:
                return [0]
            self.last = vector(arg[places["x"]]), vector(arg[places["lam_g"]])
            return [1]

    return Watcher()
