"""One instance of a report: answers, verdict, bounds over time, repeated runs and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

from ...models.verification import stated
from ..contract.repeats import Spread
from ..contract.solution import Solution
from ..contract.verdict import Outcome, Verdict
from ..report.tables import number, seconds_text
from .chart import Series, draw_steps
from .draws import compare_on_instance
from .markup import cell, figure, numeric, table, tested, untested
from .standing import measured_seconds, who
from .statistics import RankTest

__all__ = ["OUTCOMES", "Case", "describe_instance"]

#: Word, CSS class and sign of each outcome on the page.
OUTCOMES = {
    Outcome.AGREED: ("agree", "good", "✓"),
    Outcome.CONTRADICTION: ("contradict", "bad", "✗"),
    Outcome.INCONCLUSIVE: ("open", "open", "○"),
}


class Case(NamedTuple):
    """One instance with its answers and the verdict on them.

    Parameters
    ----------
    kind, name : str
        Kind of the model, and name of the instance on the page.
    solutions : sequence of Solution
        The answers.
    verdict : Verdict
        The verdict.
    """

    kind: str
    name: str
    solutions: Sequence[Solution[Any]]
    verdict: Verdict


def describe_instance(case: Case, image: str, caption: str) -> str:
    """Return the HTML details of an instance: evidence, notes, bounds over time and picture.

    Parameters
    ----------
    case : Case
        The instance.
    image, caption : str
        Data URI of the picture of the best plan, and its caption or the reason for a missing picture.
    """
    notes = "".join(f"<li>{escape(note)}</li>" for note in case.verdict.notes)
    shown = (
        f'<figure><img src="{image}" alt="{escape(caption)}" loading="lazy"><figcaption>{escape(caption)}.'
        "</figcaption></figure>"
        if image
        else f"<p class='soft'>{escape(caption)}</p>"
    )
    return (
        f"<p>{escape(case.verdict.evidence)}</p>"
        + (f"<ul>{notes}</ul>" if notes else "")
        + _repeats(case)
        + _progress(case)
        + shown
    )


def _repeats(case: Case) -> str:
    """Return a table of repeated runs with their quartiles, empty without any."""
    quartiles = ("first quartile", "median", "third quartile")
    heads = ["Backend", "With a plan"]
    heads += [f"{what}, {word}" for what in ("Objective", "Time") for word in quartiles]
    best, tests = compare_on_instance(case.verdict)
    if tests:
        heads += [f"Worse than {best}", "p", "Effect"]
    rows = [
        [
            cell(spread.label),
            cell(f"{spread.successes:,} of {spread.runs:,} runs"),
            *(numeric(value, number(value)) for value in spread.objective or (None,) * 3),
            *(numeric(value, seconds_text(value)) for value in spread.seconds),
            *(_tested(spread, best, tests) if tests else ()),
        ]
        for spread in case.verdict.spreads
    ]
    return table(heads, rows, "plain", f"Repeated runs on {case.name}") if rows else ""


def _tested(spread: Spread, best: str, tests: dict[str, RankTest]) -> list[str]:
    """Return the cells of the test of a backend's seeds against those of the best backend."""
    label = spread.label
    if label in tests:
        return tested(tests[label])
    return untested("the best" if label == best else "too few seeds to tell")


def _progress(case: Case) -> str:
    """Return a chart of the objective over time of every backend's median run, and the best bound."""
    runs: dict[str, list[Solution[Any]]] = {}
    for s in case.solutions:
        if s.stored_plan is not None and s.primal_bound is not None:
            runs.setdefault(who(s), []).append(s)
    series = []
    for label, runs_of_label in runs.items():
        run = sorted(runs_of_label, key=lambda s: s.primal_bound)[(len(runs_of_label) - 1) // 2]  # type: ignore[arg-type, return-value]
        series.append(Series(label, _steps(run)))
    if not series:
        return ""
    maximise = case.solutions[0].maximise
    bounds = [s.dual_bound for s in case.solutions if s.dual_bound is not None]
    note = (
        "The objective of the best plan so far, over the seconds since the start; "
        f"{'higher' if maximise else 'lower'} is better. "
    )
    if len(case.solutions) > len({who(s) for s in case.solutions}):
        note += "If a backend has several runs, the one with the median result is drawn. "
    if bounds:
        first = min(x for entry in series for x, _ in entry.points)
        series.insert(0, Series("best bound", [(first, max(bounds))], lone=True))
        side = "above" if maximise else "below"
        note += f"The thick line is the best proven bound: no plan is {side} it."
    series = [
        entry._replace(points=[(x, stated(y, maximise)) for x, y in entry.points])
        for entry in series
    ]
    drawn = draw_steps(
        series, title=f"Objective over time on {case.name}", across="seconds", up="objective",
        seconds=True,
    )  # fmt: skip
    return figure(drawn, note)


def _steps(run: Solution[Any]) -> list[tuple[float, float]]:
    """Return (seconds, objective) of the improvements of a run, ending with the verified objective."""
    shortest = 1e-6
    points: list[tuple[float, float]] = []
    for incumbent in sorted(run.incumbents, key=lambda item: item.seconds):
        if not points or incumbent.objective < points[-1][1]:
            points.append((max(incumbent.seconds, shortest), incumbent.objective))
    assert run.primal_bound is not None
    end = max(measured_seconds(run) or 0.0, points[-1][0] if points else shortest)
    return [*points, (end, run.primal_bound)]
