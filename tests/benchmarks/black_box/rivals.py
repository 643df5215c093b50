"""Searches of other libraries, each with its defaults, behind one signature for the comparison of searches.

Every search minimises a counted function over [-5, 5]^d. It ends by its own limit of evaluations, or by the
exception that the counted function raises.
"""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Bounds of every variable.
LOW, HIGH = -5.0, 5.0


class Spent(Exception):
    """The evaluations are used up."""


class Counted:
    """Function that counts its evaluations, keeps the best value and raises beyond the budget."""

    def __init__(self, call: Callable[[Floats], float], budget: int) -> None:
        self.call, self.left, self.best = call, budget, float("inf")

    def __call__(self, x: Any) -> float:
        """Return the value at a point, which is moved into the bounds."""
        if self.left <= 0:
            raise Spent
        self.left -= 1
        value = float(self.call(np.clip(np.asarray(x, np.float64), LOW, HIGH)))
        self.best = min(self.best, value)
        return value


Search = Callable[[Counted, int, int, int], None]


def cma_restarts(function: Counted, d: int, budget: int, seed: int) -> None:
    """BIPOP-CMA-ES of ``cma``: ``fmin2`` from the centre with a standard deviation of 2."""
    import cma

    options = {"bounds": [LOW, HIGH], "verbose": -9, "verb_log": 0, "seed": seed + 1}
    while True:
        cma.fmin2(function, np.zeros(d), 2.0, options, restarts=9, bipop=True)


def cma_surrogate(function: Counted, d: int, budget: int, seed: int) -> None:
    """lq-CMA-ES of ``cma``: ``fmin_lq_surr`` from the centre, then from random points."""
    import cma

    generator = np.random.default_rng(seed)
    options = {"bounds": [LOW, HIGH], "verbose": -9, "verb_log": 0, "seed": seed + 1}
    start = np.zeros(d)
    while True:
        cma.fmin_lq_surr(function, start, 2.0, options)
        start = generator.uniform(-4, 4, d)


def nevergrad(function: Counted, d: int, budget: int, seed: int) -> None:
    """NGOpt of nevergrad, which chooses a search by dimension and budget."""
    import nevergrad as ng

    variables = ng.p.Array(shape=(d,), lower=LOW, upper=HIGH)
    variables.random_state.seed(seed)
    ng.optimizers.NGOpt(variables, budget=budget).minimize(function)


def _optuna(sampler: Any, function: Counted, d: int, budget: int) -> None:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)

    def objective(trial: Any) -> float:
        return function([trial.suggest_float(f"x{k}", LOW, HIGH) for k in range(d)])

    optuna.create_study(sampler=sampler).optimize(objective, n_trials=budget)


def optuna_tpe(function: Counted, d: int, budget: int, seed: int) -> None:
    """Tree-structured Parzen estimator of Optuna, its default."""
    import optuna

    _optuna(optuna.samplers.TPESampler(seed=seed), function, d, budget)


def optuna_cma(function: Counted, d: int, budget: int, seed: int) -> None:
    """CMA-ES of Optuna (package ``cmaes``)."""
    import optuna

    _optuna(optuna.samplers.CmaEsSampler(seed=seed), function, d, budget)


def _pymoo(algorithm: Any, function: Counted, d: int, budget: int, seed: int) -> None:
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize

    class Problem(ElementwiseProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=d, n_obj=1, xl=np.full(d, LOW), xu=np.full(d, HIGH))

        def _evaluate(self, x: Floats, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
            out["F"] = function(x)

    minimize(Problem(), algorithm, ("n_eval", budget), seed=seed)


def pymoo_de(function: Counted, d: int, budget: int, seed: int) -> None:
    """Differential evolution of pymoo."""
    from pymoo.algorithms.soo.nonconvex.de import DE

    _pymoo(DE(), function, d, budget, seed)


def pymoo_pso(function: Counted, d: int, budget: int, seed: int) -> None:
    """Particle swarm of pymoo."""
    from pymoo.algorithms.soo.nonconvex.pso import PSO

    _pymoo(PSO(), function, d, budget, seed)


def _bounds(d: int) -> list[tuple[float, float]]:
    return [(LOW, HIGH)] * d


def scipy_annealing(function: Counted, d: int, budget: int, seed: int) -> None:
    """Dual annealing of SciPy."""
    from scipy.optimize import dual_annealing

    dual_annealing(function, _bounds(d), maxiter=10**9, maxfun=10**9, rng=seed)


def scipy_de(function: Counted, d: int, budget: int, seed: int) -> None:
    """Differential evolution of SciPy."""
    from scipy.optimize import differential_evolution

    differential_evolution(function, _bounds(d), maxiter=10**9, rng=seed)


def scipy_direct(function: Counted, d: int, budget: int, seed: int) -> None:
    """DIRECT of SciPy."""
    from scipy.optimize import direct

    direct(function, _bounds(d), maxfun=budget, maxiter=10**6, vol_tol=0.0, len_tol=0.0)


def scipy_shgo(function: Counted, d: int, budget: int, seed: int) -> None:
    """SHGO of SciPy."""
    from scipy.optimize import shgo

    shgo(function, _bounds(d), n=max(budget // 10, 2), iters=10**6, sampling_method="sobol")


def _local(method: str, **options: Any) -> Search:
    """Return a local search of SciPy from the centre, then from random points."""

    def search(function: Counted, d: int, budget: int, seed: int) -> None:
        from scipy.optimize import minimize

        generator = np.random.default_rng(seed)
        start = np.zeros(d)
        while True:
            minimize(function, start, method=method, bounds=_bounds(d), options=options)
            start = generator.uniform(LOW, HIGH, d)

    return search


#: Searches of other libraries by name.
RIVALS: dict[str, Search] = {
    "cma BIPOP": cma_restarts,
    "cma lq-surrogate": cma_surrogate,
    "nevergrad NGOpt": nevergrad,
    "Optuna TPE": optuna_tpe,
    "Optuna CMA-ES": optuna_cma,
    "pymoo DE": pymoo_de,
    "pymoo PSO": pymoo_pso,
    "SciPy dual annealing": scipy_annealing,
    "SciPy DE": scipy_de,
    "SciPy DIRECT": scipy_direct,
    "SciPy SHGO": scipy_shgo,
    "SciPy COBYQA": _local("COBYQA", maxfev=10**9, maxiter=10**9),
    "SciPy L-BFGS-B": _local("L-BFGS-B", maxfun=10**9, maxiter=10**9),
    "SciPy Powell": _local("Powell"),
    "SciPy Nelder-Mead": _local("Nelder-Mead", maxfev=10**9, maxiter=10**9, adaptive=True),
}


def run(search: Search, function: Counted, d: int, budget: int, seed: int) -> None:
    """Run a search to its end without its output and its warnings."""
    with (
        Path(os.devnull).open("w", encoding="utf-8") as nothing,
        contextlib.redirect_stdout(nothing),
        contextlib.redirect_stderr(nothing) if not sys.flags.verbose else contextlib.nullcontext(),
        warnings.catch_warnings(),
        np.errstate(all="ignore"),
    ):
        warnings.simplefilter("ignore")
        np.random.seed(seed)  # noqa: NPY002 - some libraries draw from the global generator
        try:
            search(function, d, budget, seed)
        except Exception:
            if function.left > 0:  # some libraries wrap `Spent`
                raise
