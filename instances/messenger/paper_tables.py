"""Our values of the paper's result tables.

The number of runs per cell is that of :class:`~crosstrack.instances.paper.Trials` for up to 10
vehicles, half of it for 20 and two fifths for more, because these runs take seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.model import MessengerTour
from ..paper import Trials
from .listing import paper_instance

__all__ = ["figure_5", "figure_7", "table_3", "table_4", "table_5", "table_6"]

Floats = NDArray[np.float64]

#: Backends by the paper's names.
BACKENDS = {
    "MA": "memetic",
    "MA-T": "memetic-untransformed",
    "MAR": "memetic-relaxed",
    "VNS": "variable-neighbourhood",
    "HE-B": "greedy-boundary",
    "HE-C": "greedy-centre",
    "DS": "direct-sampling",
}
#: Time limit of the recommended search, in s: minimum, and per vehicle.
LEAST, EACH = 1.0, 0.05


def _runs(model: MessengerTour, trials: Trials) -> int:
    """Return the number of runs per cell."""
    share = 1.0 if model.size <= 10 else 0.5 if model.size <= 20 else 0.4
    return max(1, round(share * trials.runs))


def _lengths(model: MessengerTour, name: str, trials: Trials, **options: Any) -> Floats:
    """Return the lengths (m) of independent runs of an algorithm; inf for a run without a plan."""
    options["runs"] = _runs(model, trials)
    (answer,) = trials.run(model, BACKENDS[name], runs=1, options=options)
    return np.array(list(map(float, str(answer.statistics["lengths"]).split())))


def _length(model: MessengerTour, name: str, trials: Trials) -> float | str:
    """Return the length (m) of a deterministic algorithm."""
    (answer,) = trials.run(model, BACKENDS[name], runs=1)
    return answer.message if answer.primal_bound is None else answer.primal_bound


def _moments(name: str, lengths: Floats) -> dict[str, Any]:
    """Return mean and standard deviation (m) of the runs that have a plan."""
    values = lengths[np.isfinite(lengths)]
    if not values.size:
        return {name: "no plan", f"{name} std": "no plan"}
    return {
        name: float(values.mean()),
        f"{name} std": float(values.std(ddof=min(1, values.size - 1))),
    }


def _p_value(first: Floats, second: Floats) -> float:
    """Return the two-sided p of the Wilcoxon rank-sum test."""
    from scipy.stats import mannwhitneyu

    return float(mannwhitneyu(first, second, alternative="two-sided").pvalue)


def _sign(first: Floats, second: Floats) -> int:
    """Return 1 (-1) if `first` is significantly below (above) `second` at 0.05, 0 otherwise."""
    if _p_value(first, second) >= 0.05:
        return 0
    return 1 if np.median(first) < np.median(second) else -1


def _row(model: MessengerTour, greedy: tuple[str, ...], trials: Trials) -> dict[str, Any]:
    """Return the cells common to Tables III to V."""
    runs = {name: _lengths(model, name, trials) for name in ("MA", "MAR", "VNS")}
    cells: dict[str, Any] = {}
    for name, lengths in runs.items():
        cells |= _moments(name, lengths)
    cells |= {name: _length(model, name, trials) for name in greedy}
    signs = [_sign(runs["MA"], runs[name]) for name in ("MAR", "VNS")]
    (best,) = trials.run(model, "tour-search", runs=1, time_limit=max(LEAST, EACH * model.size))
    return {
        **cells,
        "h": f"({signs[0]},{signs[1]})",
        "tour-search": best.primal_bound,
        "proven bound": best.dual_bound,
        "runs": len(runs["MA"]),
        "MA without a plan": int(np.isinf(runs["MA"]).sum()),
    }


def table_3(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one row of Table III."""
    model = paper_instance(*row)
    return {"κ_P": model.sparsity, **_row(model, ("DS", "HE-B", "HE-C"), trials)}


def table_4(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one row of Table IV."""
    model = paper_instance(*row)
    cells = _row(model, ("HE-B", "HE-C"), trials)
    better = min(cells["HE-B"], cells["HE-C"])
    gap = 100.0 * (1.0 - cells["MA"] / better) if isinstance(cells["MA"], float) else "no plan"
    return {"κ_P": model.sparsity, **cells, "gap (%)": gap}


def table_5(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one row of Table V."""
    name, turning, near = row
    model = paper_instance(name)
    model = replace(
        model, turning_radius=float(turning), radius=np.full(model.size, float(near)),
        name=f"{name}, {turning}, {near}",
    )  # fmt: skip
    return _row(model, ("HE-C", "HE-B"), trials)


def table_6(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one row of Table VI."""
    model = paper_instance(*row)
    runs = {name: _lengths(model, name, trials) for name in ("MA", "MA-T")}
    cells: dict[str, Any] = {
        "p": _p_value(runs["MA"], runs["MA-T"]), "runs": len(runs["MA"])
    }  # fmt: skip
    for name, lengths in runs.items():
        values = lengths[np.isfinite(lengths)]
        cells |= _moments(name, lengths)
        cells |= {f"{name} min": values.min(), f"{name} max": values.max()} if values.size else {}
    return cells


def figure_5(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the seconds of one run of each algorithm of Figure 5."""
    model = paper_instance(f"B-{row[0]}-01")
    return {
        name: trials.run(model, BACKENDS[name], runs=1)[0].seconds["solve"]
        for name in ("HE-C", "HE-B", "MAR", "MA", "VNS")
    }


def figure_7(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the lengths after 20 generations with one period of local searches."""
    model = paper_instance(row[0])
    base, result = (_lengths(model, "MA", trials, period=every) for every in (2, int(row[1])))
    return {**_moments("MA", result), "p to T_lp = 2": _p_value(base, result), "runs": len(result)}
