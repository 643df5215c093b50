"""SciPy's searches: ``differential-evolution``, ``dual-annealing``, ``cobyqa``, ``direct``, ``shgo``.

Each search works in the unit cube, and all evaluations count, including those of local searches. The
two randomised searches continue until the evaluations are used: differential evolution restarts after
convergence, and dual annealing reheats. The two deterministic searches end where SciPy ends them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedOption
from ..contract.backend import Feature, Option
from .native import BlackBoxBackend, Objective, latin_hypercube
from .quiet import quiet

__all__ = ["Cobyqa", "DifferentialEvolution", "Direct", "DualAnnealing", "Shgo"]

Floats = NDArray[np.float64]

#: Finite substitute for "no value", because SciPy mishandles infinity; its square is finite.
_WALL = 1e150
#: Number of iterations that exceeds any budget.
_ENDLESS = 10**10
#: Largest number of entries of a population.
_POPULATION = 10**7
#: Largest number of points whose constraints are kept.
_KEPT = 100
#: Memory limit of DIRECT's rectangles in bytes.
_MEMORY = 2**29


def _one(
    objective: Objective, known: dict[bytes, float] | None = None
) -> Callable[[Floats], float]:
    """Return the objective at one point, with finite values.

    The start, and points with a known value, are not evaluated at their first request.
    """
    known = {} if known is None else known
    if objective.start is not None and objective.x is not None and objective.problem.columns == 1:
        known[objective.start.tobytes()] = objective.best

    def value(x: Floats) -> float:
        if known and x.tobytes() in known:
            return known.pop(x.tobytes())
        return min(max(float(objective(np.asarray(x)[None])[0]), -_WALL), _WALL)

    return value


def _cube(objective: Objective) -> list[tuple[float, float]]:
    return [(0.0, 1.0)] * objective.dimension


class _SciPy(BlackBoxBackend):
    """Base of SciPy's searches."""

    requires = ("scipy",)

    def prepare(self) -> None:
        """Import SciPy, which may take a second, outside of the time limit."""
        import scipy.optimize  # noqa: F401


class DifferentialEvolution(_SciPy):
    """Storn and Price's differential evolution, with one request per generation.

    R. Storn and K. Price, "Differential evolution: a simple and efficient heuristic for global
    optimization over continuous spaces", Journal of Global Optimization 11 (1997).
    """

    name = "differential-evolution"
    summary = "differential evolution of SciPy, started again when it has converged"
    options: ClassVar[Mapping[str, Option]] = {
        "population": Option(
            15,
            "Points per variable; in all at most a twentieth of the evaluations, rounded up to a multiple of "
            "the workers.",
            int,
            lower=1,
            upper=1000,
        ),
        "tolerance": Option(
            0.01,
            "Standard deviation of the population's values, relative to their mean, at which it has "
            "converged.",
            lower=0.0,
        ),
        "polish": Option(True, "Whether a converged best point is improved by L-BFGS-B.", bool),
        "immediate": Option(
            False,
            "Whether a better trial replaces its target at once: no worker waits for a generation, no polish.",
            bool,
        ),
    }

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Evolve one population after another until the run ends."""
        from scipy.optimize import differential_evolution

        d = objective.dimension
        limit = min(objective.granted // 20, _POPULATION // d)
        count = objective.filled(max(min(objective.options["population"] * d, limit), 5))
        if objective.options["immediate"]:
            while True:
                self._evolve(objective, latin_hypercube(objective.generator, count, d))

        # Values of infeasible points have no useful gradient, so the population itself gives the digits.
        polish = objective.options["polish"] and objective.problem.columns == 1
        finest = math.inf if objective.problem.columns == 1 else 1e-6

        def values(x: Floats) -> Floats:
            return np.clip(objective(x.T), -_WALL, _WALL)

        with quiet():
            while True:
                try:
                    differential_evolution(
                        values,
                        _cube(objective),
                        init=latin_hypercube(objective.generator, count, d),
                        x0=objective.start,
                        maxiter=_ENDLESS,
                        tol=min(objective.options["tolerance"], finest),
                        polish=polish,
                        rng=objective.generator,
                        updating="deferred",
                        vectorized=True,
                    )
                except RuntimeError as error:
                    # SciPy handles any ValueError as its own; errors of the function are re-raised.
                    if isinstance(error.__cause__, InvalidData):
                        raise error.__cause__ from None
                    raise
                objective.start = None

    def _evolve(self, objective: Objective, population: Floats) -> None:
        """Evolve one population by steps of one trial, with SciPy's default rules, until it has converged."""
        generator, (count, d) = objective.generator, population.shape
        if objective.start is not None:
            population[0], objective.start = objective.start, None
        values = np.clip(objective(population), -_WALL, _WALL)
        tolerance = objective.options["tolerance"]
        pending: deque[tuple[int, Floats]] = deque()
        target, evolves = 0, True
        while evolves or pending:
            while evolves and len(pending) < 2 * objective.parallel:
                first, other = generator.choice(count, 2, replace=False)
                mutant = population[values.argmin()] + generator.uniform(0.5, 1.0) * (
                    population[first] - population[other]
                )
                mutant = np.where((mutant < 0) | (mutant > 1), generator.random(d), mutant)
                share = generator.random((d,))
                share[generator.integers(d)] = 0.0
                trial = np.where(share < 0.7, mutant, population[target])[None]
                objective.begin(trial)
                pending.append((target, trial))
                target = (target + 1) % count
            k, trial = pending.popleft()
            value = min(float(objective(trial)[0]), _WALL)
            if value <= values[k]:
                population[k], values[k] = trial[0], value
                evolves = bool(values.std() > tolerance * abs(values.mean()))


class DualAnnealing(_SciPy):
    """Generalised simulated annealing with local searches.

    Y. Xiang and others, "Generalized simulated annealing algorithm and its application to the Thomson
    model", Physics Letters A 233 (1997).
    """

    name = "dual-annealing"
    uses_size = True
    summary = "dual annealing of SciPy, heated up again and again"
    options: ClassVar[Mapping[str, Option]] = {
        "local": Option(True, "Whether L-BFGS-B improves what the annealing finds.", bool),
        "temperature": Option(5230.0, "Temperature at the start.", lower=0.011, upper=5e4),
    }

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Anneal until the run ends."""
        from scipy.optimize import dual_annealing

        value = _one(objective)
        with quiet():
            while True:
                dual_annealing(
                    value,
                    _cube(objective),
                    maxiter=_ENDLESS,
                    initial_temp=objective.options["temperature"],
                    maxfun=_ENDLESS,
                    rng=objective.generator,
                    no_local_search=not objective.options["local"],
                    x0=objective.start,
                )
                objective.start = None


class Cobyqa(_SciPy):
    """Local quadratic models in a trust region, from the best point and then from random points.

    T. M. Ragonneau, "Model-based derivative-free optimization methods and software", PhD thesis, Hong Kong
    Polytechnic University, 2022.
    """

    name = "cobyqa"
    summary = "COBYQA of SciPy: local quadratic models, started again when it has converged"
    options: ClassVar[Mapping[str, Option]] = {
        "radius": Option(0.1, "First radius, as a share of the ranges.", lower=1e-6, upper=0.5),
        "restarts": Option(True, "Whether it starts again from random points.", bool),
    }
    most = 200
    grows = "its models have the square of them"

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Search locally until the run ends, or until the first search has converged."""
        from scipy.optimize import minimize

        radius = objective.options["radius"]
        limits = {"maxfev": _ENDLESS, "maxiter": _ENDLESS, "final_tr_radius": 1e-9}
        known: dict[bytes, float] = {}
        value, start = _one(objective, known), objective.start
        rows = _Rows(objective) if objective.problem.columns > 1 else None
        objective.start = None
        if start is None:
            start = np.full(objective.dimension, 0.5)
        while True:
            # COBYQA does not leave a region without values.
            if rows is not None and not math.isfinite(rows.row(start)[0]):
                start = objective.generator.random(objective.dimension)
                continue
            if rows is None and objective.x is None:
                known[start.tobytes()] = float(objective(start[None])[0])
                if not math.isfinite(known[start.tobytes()]):
                    start = objective.generator.random(objective.dimension)
                    continue
            with quiet():
                result = minimize(
                    value if rows is None else rows.value,
                    start,
                    method="COBYQA",
                    bounds=_cube(objective),
                    constraints=() if rows is None else rows.constraint(start, radius),
                    options={**limits, "initial_tr_radius": radius},
                )
            if not objective.options["restarts"]:
                return {"ended": result.message}
            start = objective.generator.random(objective.dimension)


class _Rows:
    """Objective and constraints at single points, evaluated once for both."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self._known: dict[bytes, Floats] = {}
        if objective.start is not None:
            points, table = objective.earlier()
            same = np.flatnonzero(np.abs(points - objective.start).max(axis=1) < 1e-12)
            if same.size:
                self._known[objective.start.tobytes()] = np.clip(table[same[0]], -_WALL, _WALL)

    def row(self, x: Floats) -> Floats:
        """Return objective, inequalities and equalities at a point of the unit cube, infinite for no value."""
        key = x.tobytes()
        if key not in self._known:
            if len(self._known) > _KEPT:
                self._known.clear()
            self._known[key] = self.objective.table(self.objective.point(x[None]), x[None])[0]
        return self._known[key]

    def value(self, x: Floats) -> float:
        """Return the objective, finite."""
        return min(max(float(self.row(x)[0]), -_WALL), _WALL)

    def constraint(self, start: Floats, radius: float) -> Any:
        """Return the constraints for SciPy, each relative to its size at `start` and at a point next to it."""
        from scipy.optimize import NonlinearConstraint

        aside = start + np.where(start < 0.5, radius, -radius)
        size = np.maximum(np.abs(self.row(start)), np.abs(self.row(aside)))[1:]
        size = np.where((size > 0) & np.isfinite(size), size, 1.0)
        low, high = self.objective.constraints.limits()
        return NonlinearConstraint(
            lambda x: np.clip(self.row(x)[1:] / size, -_WALL, _WALL), low, high
        )


class _Deterministic(_SciPy):
    """Base of deterministic searches, whose first point is the warm start."""

    features = BlackBoxBackend.features - {Feature.SEED}
    deterministic = True
    uses_size = True


class Direct(_Deterministic):
    """Division of the cube into rectangles, repeatedly of the most promising ones.

    D. R. Jones, C. D. Perttunen and B. E. Stuckman, "Lipschitzian optimization without the Lipschitz
    constant", Journal of Optimization Theory and Applications 79 (1993); the locally biased form is J. M.
    Gablonsky and C. T. Kelley's, Journal of Global Optimization 21 (2001).
    """

    name = "direct"
    summary = "DIRECT of SciPy: dividing rectangles, without drawing anything"
    options: ClassVar[Mapping[str, Option]] = {
        "biased": Option(True, "Whether it keeps to good places, rather than to large ones.", bool),
        "epsilon": Option(
            1e-4,
            "Least improvement, relative to the best value, that is worth dividing.",
            lower=0.0,
        ),
    }
    #: Largest number of variables; the first step divides each of them.
    most = 1000
    grows = "its rectangles would not fit into memory"

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Divide until the run ends, or memory or the depth of rectangles is exhausted."""
        from scipy.optimize import direct

        d = objective.dimension
        # DIRECT allocates all its rectangles at once, half as many again as requested.
        limit = max(min(objective.left, int(_MEMORY / (1.5 * (12 * d + 40)))), 2 * d + 1)
        with quiet():
            result = direct(
                _one(objective),
                _cube(objective),
                eps=objective.options["epsilon"],
                maxfun=limit + 1,  # so that the objective's own count ends the run
                maxiter=limit + 1,
                locally_biased=objective.options["biased"],
                vol_tol=0.0,
                len_tol=0.0,
            )
        return {"ended": result.message}


class Shgo(_Deterministic):
    """Simplicial homology global optimisation: local searches from the minima of a triangulation.

    S. C. Endres, C. Sandrock and W. W. Focke, "A simplicial homology algorithm for Lipschitz
    optimisation", Journal of Global Optimization 72 (2018).
    """

    name = "shgo"
    summary = "SHGO of SciPy: local searches from the minima of a triangulation, without drawing"
    options: ClassVar[Mapping[str, Option]] = {
        "sampling": Option(
            "simplicial",
            "Where points are added: at the cube's simplices, or by a sequence and its Delaunay "
            "triangulation (at most 5 variables).",
            str,
            ("simplicial", "sobol", "halton"),
        ),
        "points": Option(
            None, "Points added between two rounds of local searches.", int, lower=2, upper=10**6
        ),
    }
    #: Largest number of variables; the corners of the cube have 3^d connections in total.
    most = 10
    grows = "its triangulation of the cube would not end"

    def prepare(self) -> None:
        """Import the modules that SciPy imports when it begins, outside of the time limit."""
        super().prepare()
        import scipy.stats  # noqa: F401

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Refine the triangulation and search locally until the run ends."""
        from scipy.optimize import shgo

        d, sampling = objective.dimension, objective.options["sampling"]
        if sampling != "simplicial" and d > 5:
            raise UnsupportedOption(
                f"backend 'shgo': sampling={sampling!r} takes at most 5 variables that are free, got {d}"
            )
        # SciPy's default is every corner and the centre. Each round examines all points again, and
        # local searches start only after a round.
        default = max(2**d + 1, objective.granted // 50)
        points = objective.options["points"] or max(min(default, objective.granted // 4), 2)
        with quiet():
            result = shgo(
                _one(objective),
                _cube(objective),
                n=points,
                iters=_ENDLESS,
                sampling_method=sampling,
            )
        return {"ended": result.message}
