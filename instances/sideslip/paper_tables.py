"""Reproduction of the paper's tables."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..paper import Trials
from .drivers import ROWS, uniform_design
from .generator import generate
from .paper import TABLE_2

__all__ = ["table_1", "table_2", "table_3"]

_ROADS = {"double lane": "lane-change", "serpentine line": "serpentine"}
#: Window of the paper: five lags before the angle, without speed and steering angle.
_PAPER: Mapping[str, Any] = {"ahead": 1, "inputs": False}
#: Runs of Table 3: column, backend and options.
_RUNS: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("error mean", "grnn", _PAPER),
    ("mean, features scaled", "grnn", {**_PAPER, "scaling": True}),
    ("mean, linear-regression", "linear-regression", _PAPER),
    ("mean, kalman-filter", "kalman-filter", {}),
    ("mean, rts-smoother", "rts-smoother", {}),
)


def table_1(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return a row of the design table."""
    entries = uniform_design()[int(row[0]) - 1]
    return {str(k): int(entry) for k, entry in enumerate(entries, 1)}


def _discrepancy(columns: tuple[int, ...]) -> float:
    """Return the centred discrepancy of some columns, rounded so that equal ones compare equal."""
    from scipy.stats import qmc

    points = (uniform_design()[:, [k - 1 for k in columns]] - 0.5) / ROWS
    return round(float(qmc.discrepancy(points, method="CD")), 9)


def table_2(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the columns with the smallest centred discrepancy for a number of factors."""
    best = min(
        combinations(range(1, 9), int(row[0])), key=lambda columns: (_discrepancy(columns), columns)
    )
    paper = tuple(int(cell) for cell in TABLE_2.rows[row] if cell is not None)
    return {
        **dict(zip(TABLE_2.columns, best, strict=False)),
        "discrepancy, printed columns": _discrepancy(paper),
        "discrepancy, our columns": _discrepancy(best),
    }


def table_3(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return medians of the errors over drives from different seeds, in degrees."""
    from scipy.stats import wilcoxon

    errors: dict[str, list[NDArray[np.float64]]] = {name: [] for name, _, _ in _RUNS}
    peaks = []
    for seed in range(trials.seed, trials.seed + trials.runs):
        model = generate(_ROADS[row[0]], seed=seed, name=f"{row[0]}, seed {seed}")
        truth = model.truth
        assert truth is not None
        peaks.append(np.degrees(np.abs(truth).max()))
        for name, backend, options in _RUNS:
            (answer,) = trials.run(model, backend, runs=1, options=options)
            errors[name].append(np.degrees(answer.plan.sideslip - truth)[model.recording.moving])
    means = {name: [float(np.abs(off).mean()) for off in some] for name, some in errors.items()}
    apart = np.subtract(means["error mean"], means["mean, linear-regression"])
    return {
        **{name: float(np.median(some)) for name, some in means.items()},
        "error standard deviation": float(np.median([off.std() for off in errors["error mean"]])),
        "peak angle": float(np.median(peaks)),
        "p, grnn and linear-regression": float(wilcoxon(apart).pvalue) if len(apart) > 5 else None,
        "runs": trials.runs,
    }
