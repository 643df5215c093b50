"""Our values compared with the figures of the paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import AttractorEstimate
from ..catalogue import load
from ..paper import Run, Trials
from .hunting import Hunt, simulate_hunt
from .listing import HUNT_EXPONENTS
from .systems import SYSTEMS, System, generate

__all__ = ["figures", "slopes", "systems"]

#: Samples of the paper's record, and its embedding.
SAMPLES, DELAY, DIMENSION = 1000, 8, 10
#: Mean orbital periods, s, known from the equations or from the power spectrum.
PERIODS = {"lorenz": 0.75, "rossler": 5.86, "mackey-glass": 50.0, "ar2": 25.1}
_PAPERS: Mapping[str, Any] = {"delay": DELAY, "dimension": DIMENSION}


class _Figure(NamedTuple):
    """Backends of a printed figure, its value in an estimate, and the true value."""

    backend: str
    options: Mapping[str, Any]
    read: Callable[[AttractorEstimate], float | None]
    other: str
    truth: float | None = None


def _dimension(plan: AttractorEstimate) -> float | None:
    return None if plan.correlation is None else plan.correlation.value


_TRUE = HUNT_EXPONENTS["hunt"]
_LINE = {"delay": DELAY, "fit": "line"}
_FIGURES = {
    "delay, samples": _Figure("improved-c-c", {}, lambda plan: plan.delay, "mutual-information"),
    "embedding dimension": _Figure("improved-c-c", {}, lambda plan: plan.dimension, "cao"),
    "largest exponent": _Figure(
        "small-data-sets", _PAPERS, lambda plan: plan.largest_exponent, "rosenstein", _TRUE
    ),
    "correlation dimension": _Figure("g-p", _LINE, _dimension, "correlation-dimension"),
    "forecast period, s": _Figure(
        "small-data-sets", _PAPERS, lambda plan: plan.horizon, "rosenstein", 1.0 / _TRUE
    ),
    "smallest number of variables": _Figure(
        "g-p", _LINE, lambda plan: plan.variables and plan.variables[0], "correlation-dimension"
    ),
    "largest number of variables": _Figure(
        "g-p", _LINE, lambda plan: plan.variables and plan.variables[1], "correlation-dimension"
    ),
}


def figures(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the median and the deviation of a figure over hunts from different seeds."""
    figure = _FIGURES[row[0]]
    ours, others = [], []
    for seed in range(trials.seed, trials.seed + trials.runs):
        model = simulate_hunt(Hunt(seed=seed), SAMPLES, name=f"hunt, seed {seed}")
        (answer,) = trials.run(model, figure.backend, runs=1, options=figure.options)
        ours.append(figure.read(answer.plan))
        (answer,) = trials.run(model, figure.other, runs=1)
        others.append(figure.read(answer.plan))
    known = [value for value in ours if value is not None]
    other = [value for value in others if value is not None]
    result = f"{np.median(other):.3g}" if other else "no value"
    return {
        "value": float(np.median(known)) if known else "no scaling region",
        "deviation": float(np.std(known, ddof=1)) if len(known) > 1 else None,
        "backend": figure.backend,
        "recommended backend": f"{figure.other}: {result} ({len(other)} of {trials.runs})",
        "true value": figure.truth,
        "runs": trials.runs,
    }


def slopes(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the slope of ln C over ln r for the dimensions 2 … 10."""
    name, _, fit = row[0].partition(", ")
    options = {"delay": DELAY, "fit": fit or "two-points"}
    known = None
    if name == "hunt":
        model = simulate_hunt(Hunt(), SAMPLES, name="hunt, 1000 samples")
    else:
        period, options["delay"] = {"lorenz": (0.05, 3), "henon": (None, 1)}.get(name, (None, 8))
        model = generate(name, SAMPLES, period=period, name=f"{name}, 1000 samples")
        known = SYSTEMS[System(name)].dimension
    (answer,) = trials.run(model, "g-p", runs=1, options=options)
    result = {f"m = {m}": answer.statistics.get(f"slope, dimension {m}") for m in range(2, 11)}
    shown = {name: "none" if value is None else value for name, value in result.items()}
    return {**shown, "largest": _dimension(answer.plan) or "none", "true dimension": known}


def systems(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return exponent, dimension and window of a series of the catalogue by several backends."""
    name = row[0]
    model, known = load(f"attractor/{name}"), SYSTEMS[System(name)]
    assert isinstance(model, AttractorAnalysis)

    def run(backend: str) -> Run:
        return trials.run(model, backend, runs=1)[0]

    period = PERIODS.get(name)
    return {
        "samples": len(model.series),
        "exponent, known": known.exponent,
        **{backend: run(backend).plan.largest_exponent or "none" for backend in ("small-data-sets", "rosenstein", "kantz")},
        "dimension, known": known.dimension,
        **{backend: _dimension(run(backend).plan) or "none" for backend in ("g-p", "correlation-dimension")},
        "period, samples": period and period / known.period,
        **{f"window, {backend}": run(backend).statistics["window"] for backend in ("c-c", "improved-c-c")},
        "source": known.source,
    }  # fmt: skip
