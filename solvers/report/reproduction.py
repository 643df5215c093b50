"""A paper's tables beside ours: the runs that stand for its columns, and what they gave."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import UnknownName
from ...models.model import Model
from ..crosscheck import Comparison, compare
from ..solution import Solution
from ..verdict import Outcome, Verdict, exact_names, judge
from .tables import number, seconds_text, table

__all__ = ["Reproduction", "reproduce", "reproduction_parts"]


@dataclass(frozen=True)
class _Column:
    """One run, and the key of the paper's seconds that stand beside it (empty: none)."""

    backend: str
    published: str = ""
    warm: bool = False


@dataclass(frozen=True)
class _Layout:
    """One table of a paper: what it is called, the runs beside its columns, and how precise they are."""

    title: str
    columns: tuple[_Column, ...]
    tolerance: float | None = None


_LAYOUTS: Mapping[str, Mapping[int, _Layout]] = {
    "error-correction": {
        2: _Layout(
            "Table 2: the paper's program by a MIP solver (paper: Gurobi 8.0) against two-stage",
            (
                _Column("label-setting"),
                _Column("two-stage", "two-stage"),
                _Column("highs:arc-flow"),
                _Column("highs:paper", "gurobi", warm=True),
            ),
        ),
        3: _Layout(
            "Table 3: the paper's exact algorithms",
            (
                _Column("label-setting"),
                _Column("two-stage", "two-stage"),
                _Column("pulse", "pulse"),
                _Column("dynamic-programming", "dynamic-programming"),
                _Column("highs:arc-flow", warm=True),
            ),
        ),
    },
    "minimum-snap": {
        1: _Layout(
            "The paper's equations (5-13, 23-25) as printed, and the same problem in other bases",
            (
                _Column("banded"),
                _Column("clarabel:legendre"),
                _Column("clarabel:monomial"),
                _Column("clarabel:hermite"),
                _Column("clarabel:paper"),
            ),
        ),
        2: _Layout(
            "The minimum-snap spline, whose jerk is continuous too, by backends of every kind",
            (
                _Column("banded"),
                _Column("interior-point"),
                _Column("piqp:legendre"),
                _Column("clarabel:legendre"),
                _Column("osqp:legendre"),
            ),
        ),
    },
    "satellite-slew": {
        1: _Layout(
            "The rapid slew: the paper's method and its kin, and the field's steering laws",
            (
                _Column("ipopt:paper", "paper"),
                _Column("ipopt:gauss"),
                _Column("ipopt:radau"),
                _Column("ipopt:hermite-simpson"),
                _Column("slew-pseudo-inverse"),
                _Column("slew-generalised"),
            ),
            tolerance=1e-4,
        ),
    },
}

_NOTES: Mapping[str, str] = {
    "error-correction": (
        "The paper does not publish its coordinates: our points have its sizes and thresholds and "
        "come from a seed, so lengths differ. A run marked * started from the best plan of the "
        "runs before it. Seconds are the algorithms' own: the paper's on its machine, ours on this one."
    ),
    "minimum-snap": (
        "The paper prints equations and a picture, but neither waypoints nor values: the instances "
        "are ours, and nothing stands beside its figures. What is reproduced is how its program "
        "behaves. Where an answer is rejected, its powers of absolute time have lost the digits "
        "that the conditions at the waypoints need."
    ),
    "satellite-slew": (
        "The paper prints a final time of 7.836 s at a tolerance of 1e-3, after 4.1 minutes, but "
        "neither the momentum of a wheel nor the weight of the gimbal rates: both are ours. Each "
        "cell gives ours J and the seconds of the search, to a tolerance of 1e-4. One interval, as "
        "the paper has it, is rejected where no degree resolves the corners that limits leave in the "
        "controls: the plan meets its limits at the nodes, and not between them."
    ),
}


@dataclass(frozen=True)
class Row:
    """One instance of a table: the paper's figures and our answers."""

    table: int
    published: Mapping[str, Any]
    verdict: Verdict


@dataclass(frozen=True)
class Reproduction:
    """A paper's tables with our answers.

    Parameters
    ----------
    problem : str
        The problem.
    rows : tuple of Row
        In the paper's order.
    interrupted : bool
        Whether Ctrl-C ended it.
    """

    problem: str
    rows: tuple[Row, ...]
    interrupted: bool = False

    @property
    def comparison(self) -> Comparison:
        """All rows as one comparison."""
        return Comparison(tuple(row.verdict for row in self.rows), self.interrupted)

    @property
    def outcome(self) -> Outcome:
        """The worst of the verdicts."""
        return self.comparison.outcome

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON data."""
        return {
            "problem": self.problem,
            "verdict": str(self.outcome),
            "interrupted": self.interrupted,
            "note": _NOTES[self.problem],
            "rows": [
                {"table": row.table, "published": dict(row.published), **row.verdict.to_dict()}
                for row in self.rows
            ],
        }


def reproduce(
    problem: str,
    instances: Sequence[tuple[Model[Any], Mapping[str, Any]]],
    *,
    time_limit: float | None = 60.0,
    on_solution: Callable[[Solution[Any]], None] | None = None,
) -> Reproduction:
    """Run what stands beside each published figure.

    Parameters
    ----------
    problem : str
        A problem whose tables are known, such as ``"error-correction"``.
    instances : sequence of (Model, mapping)
        Models with their published figures, which name their ``"table"``.
    time_limit : float, optional
        Seconds for each run.
    on_solution : callable, optional
        Called with every answer.
    """
    if problem not in _LAYOUTS:
        raise UnknownName("problem to reproduce", problem, _LAYOUTS)
    rows: list[Row] = []
    interrupted = False
    for model, published in instances:
        if interrupted:
            break
        layout = _LAYOUTS[problem][published["table"]]
        answers: list[Solution[Any]] = []
        exact = exact_names([column.backend.partition(":")[0] for column in layout.columns])
        for warm in (False, True):
            names = [column.backend for column in layout.columns if column.warm is warm]
            if names and not interrupted:
                start = judge(model.name, answers, exact).best if warm else None
                part = compare(
                    model,
                    names,
                    time_limit=time_limit,
                    tolerance=layout.tolerance,
                    warm_start=start,
                    on_solution=on_solution,
                )
                interrupted = part.interrupted
                answers.extend(part.solutions)
        rows.append(Row(published["table"], published, judge(model.name, answers, exact)))
    return Reproduction(problem, tuple(rows), interrupted)


def reproduction_parts(result: Reproduction) -> list[Any]:
    """Return what to print: the paper's figures and ours, side by side."""
    parts: list[Any] = []
    for key, layout in _LAYOUTS[result.problem].items():
        rows = [row for row in result.rows if row.table == key]
        if not rows:
            continue
        lengths = any("optimum" in row.published for row in rows)
        head = ["row", *(["optimum\npaper"] if lengths else []), "optimum\nours"]
        for column in layout.columns:
            label = column.backend.replace(":", "\n")
            head += [f"{label}\npaper"] if column.published else []
            head.append(f"{label}{'*' if column.warm else ''}\nours")
        lines = []
        for row in rows:
            best = row.verdict.best
            line = [row.verdict.instance.rpartition("/")[2]]
            line += [number(row.published.get("optimum"), 0)] if lengths else []
            line.append(number(None if best is None else best.primal_bound))
            for column in layout.columns:
                if column.published:
                    line.append(seconds_text(row.published["seconds"].get(column.published)))
                line.append(_ours(column, row.verdict))
            lines.append([*line, str(row.verdict.outcome)])
        parts.append(table(layout.title, [*head, "verdict"], lines, right=head[1:]))
    parts.append(_NOTES[result.problem])
    return parts


def _ours(column: _Column, verdict: Verdict) -> str:
    """Return the seconds of our run, or how it ended without a proof."""
    name, _, formulation = column.backend.partition(":")
    for solution in verdict.solutions:
        if solution.backend == name and formulation in ("", solution.formulation):
            if solution.termination in ("optimal", "infeasible"):
                return seconds_text(solution.seconds.get("solve"))
            if solution.termination in ("locally_optimal", "feasible") and solution.gap is None:
                # Nothing is proven, so what was found stands beside how long it took.
                found = number(solution.primal_bound)
                return f"{found} in {seconds_text(solution.seconds.get('solve'))}"
            gap = "" if solution.gap is None else f", gap {solution.gap:.1%}"
            return f"{solution.limit or solution.termination}{gap}"
    return ""
