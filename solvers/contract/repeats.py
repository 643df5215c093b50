"""Statistics of repeated runs of one backend: quartiles over seeds, and success rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..report.fitting import FittedTable
from ..report.tables import number, seconds_text, table
from .job import UNPOLISHED
from .solution import Solution

__all__ = ["Spread", "name_backend", "own_options", "spreads", "spreads_table"]

Quartiles = tuple[float, float, float]


@dataclass(frozen=True)
class Spread:
    """Statistics of several runs of one backend on one model with different seeds.

    Parameters
    ----------
    backend : str
        Name of the backend.
    formulation : str, optional
        Name of the formulation.
    runs : int
        Number of runs.
    successes : int
        Number of runs with a verified plan.
    objective : tuple of float, optional
        First quartile, median and third quartile of the verified objectives, as the author of the model
        states them; None without any.
    seconds : tuple of float
        The same quartiles of the seconds of all runs, with or without a plan.
    options : mapping
        Options of the backend. Runs with other options belong to another spread.
    """

    backend: str
    formulation: str | None
    runs: int
    successes: int
    objective: Quartiles | None
    seconds: Quartiles
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name of the backend with its formulation and options."""
        return name_backend(self.backend, self.formulation, self.options)

    @property
    def success_rate(self) -> float:
        """Share of the runs with a verified plan, between 0 and 1."""
        return self.successes / self.runs

    def to_dict(self) -> dict[str, Any]:
        """Return the spread as JSON data."""
        return {**asdict(self), "success_rate": self.success_rate}


def name_backend(
    backend: str, formulation: str | None, options: Mapping[str, Any] | None = None
) -> str:
    """Return the name of a backend with its formulation and options, for tables.

    Parameters
    ----------
    backend : str
        Name of the backend.
    formulation : str, optional
        Name of the formulation.
    options : mapping, optional
        Options of the backend.
    """
    name = backend + (f":{formulation}" if formulation else "")
    return " ".join([name, *(f"{key}={value}" for key, value in (options or {}).items())])


def own_options(solution: Solution[Any]) -> dict[str, Any]:
    """Return the backend options of a run, without the defaults of comparisons.

    Parameters
    ----------
    solution : Solution
        Result of the run.
    """
    options = solution.options.get("backend_options")
    items = options.items() if isinstance(options, Mapping) else ()
    return {name: value for name, value in items if UNPOLISHED.get(name, ...) is not value}


def _quartiles(values: Sequence[float]) -> Quartiles:
    """Return quartiles by linear interpolation, NumPy's default (Hyndman and Fan 1996, type 7)."""
    low, middle, high = np.quantile(np.asarray(values, float), (0.25, 0.5, 0.75)).tolist()
    return low, middle, high


def spreads(solutions: Sequence[Solution[Any]]) -> tuple[Spread, ...]:
    """Return the spread of every backend that ran more than once, in order of appearance.

    Parameters
    ----------
    solutions : sequence of Solution
        Results on one model.
    """
    groups: dict[tuple[str, str | None, str], list[Solution[Any]]] = {}
    for solution in solutions:
        options = repr(own_options(solution))
        groups.setdefault((solution.backend, solution.formulation, options), []).append(solution)
    result = []
    for (backend, formulation, _), runs in groups.items():
        if len(runs) > 1:
            values = [run.value for run in runs if run.value is not None]
            seconds = [run.seconds.get("solve", run.seconds.get("total", 0.0)) for run in runs]
            objective = _quartiles(values) if values else None
            backend_options = own_options(runs[0])
            result.append(
                Spread(
                    backend, formulation, len(runs), len(values), objective, _quartiles(seconds), backend_options
                )
            )  # fmt: skip
    return tuple(result)


def spreads_table(spreads: Sequence[Spread]) -> FittedTable:
    """Return a table of repeated runs: successes, and quartiles of objective and seconds.

    Parameters
    ----------
    spreads : sequence of Spread
        One per row.
    """
    rows = [
        (
            spread.label,
            f"{spread.successes} of {spread.runs}",
            *(number(value) for value in spread.objective or (None,) * 3),
            *(seconds_text(value) for value in spread.seconds),
        )
        for spread in spreads
    ]
    quartiles = ("quarter", "median", "three quarters")
    columns = (
        "repeated",
        "verified",
        *(f"objective\n{word}" for word in quartiles),
        *(f"seconds\n{word}" for word in quartiles),
    )
    return table("", columns, rows, right=columns[1:])
