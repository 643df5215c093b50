"""One instance of a report: its answers, its verdict, bounds over time, repeats and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

from ..repeats import Spread
from ..report.tables import number, seconds_text
from ..solution import Solution
from ..verdict import Outcome, Verdict
from .chart import Series, draw_steps
from .draws import compare_on_instance
from .markup import cell, figure, numeric, table, tested
from .pictures import Load, draw_plan
from .standing import measured_seconds, who
from .statistics import RankTest

__all__ = ["OUTCOMES", "Case", "describe_instance"]

#: How outcomes are called on the page, with the class of their colour and a sign beside it.
OUTCOMES = {
    Outcome.AGREED: ("agree", "good", "✓"),
    Outcome.CONTRADICTION: ("contradict", "bad", "✗"),
    Outcome.INCONCLUSIVE: ("open", "open", "○"),
}


class Case(NamedTuple):
    """One instance with its answers and the verdict on them."""

    kind: str
    name: str
    solutions: Sequence[Solution[Any]]
    verdict: Verdict


def describe_instance(case: Case, load: Load | None, instances: int) -> str:
    """Return what unfolds for an instance: verdict, notes, bounds over time, picture."""
    word, look, sign = OUTCOMES[case.verdict.outcome]
    notes = "".join(f"<li>{escape(note)}</li>" for note in case.verdict.notes)
    image, what = draw_plan(case.verdict.best, load, instances)
    shown = (
        f'<figure><img src="{image}" alt="{escape(what)}" loading="lazy"><figcaption>{escape(what)}.'
        "</figcaption></figure>"
        if image
        else f"<p class='soft'>{escape(what)}</p>"
    )
    return (
        f'<details data-instance="{escape(case.name)}">'
        f"<summary>{escape(case.name)} <span class='{look}'>{sign} {word}</span></summary>"
        f"<p>{escape(case.verdict.evidence)}</p>"
        + (f"<ul>{notes}</ul>" if notes else "")
        + _repeats(case)
        + _progress(case)
        + shown
        + "</details>"
    )


def _repeats(case: Case) -> str:
    """Return a table of what ran more than once: quartiles over its runs."""
    quartiles = ("first quartile", "median", "third quartile")
    heads = [("Backend", False), ("With a plan", False)]
    heads += [(f"Objective, {word}", True) for word in quartiles]
    heads += [(f"Time, {word}", True) for word in quartiles]
    best, tests = compare_on_instance(case.verdict)
    if tests:
        heads += [(f"Worse than {best}", False), ("p", True), ("Effect", True)]
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
    """Return the cells of the test of a backend's seeds against those of the best one."""
    label = spread.label
    if label in tests:
        return tested(tests[label])
    words = "the best" if label == best else "too few seeds to tell"
    return [cell(words), numeric(None, ""), numeric(None, "")]


def _progress(case: Case) -> str:
    """Return the objective over time of every backend's median run, and the best bound."""
    runs: dict[str, list[Solution[Any]]] = {}
    for s in case.solutions:
        if s.stored_plan is not None and s.primal_bound is not None:
            runs.setdefault(who(s), []).append(s)
    series = []
    for label, own in runs.items():
        run = sorted(own, key=lambda s: s.primal_bound)[(len(own) - 1) // 2]  # type: ignore[arg-type, return-value]
        series.append(Series(label, _steps(run)))
    if not series:
        return ""
    bounds = [s.dual_bound for s in case.solutions if s.dual_bound is not None]
    note = (
        "The objective of the best plan so far, over the seconds since the start; less is better. "
    )
    if len(case.solutions) > len({who(s) for s in case.solutions}):
        note += "Of several runs of a backend the one with the median result is drawn. "
    if bounds:
        first = min(x for one in series for x, _ in one.points)
        series.insert(0, Series("best bound", [(first, max(bounds))], lone=True))
        note += "The thick line is the best proven bound: no plan lies below it."
    drawn = draw_steps(
        series, title=f"Objective over time on {case.name}", across="seconds", up="objective",
        seconds=True,
    )  # fmt: skip
    return figure(drawn, note)


def _steps(run: Solution[Any]) -> list[tuple[float, float]]:
    """Return the points of a run: improvements by time, and the verified objective at the end."""
    least = 1e-6
    found: list[tuple[float, float]] = []
    for one in sorted(run.incumbents, key=lambda one: one.seconds):
        if not found or one.objective < found[-1][1]:
            found.append((max(one.seconds, least), one.objective))
    assert run.primal_bound is not None
    end = max(measured_seconds(run) or 0.0, found[-1][0] if found else least)
    return [*found, (end, run.primal_bound)]
