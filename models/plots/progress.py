"""Convergence of runs: objective over time, and the gap to the best proven bound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ...errors import InvalidData
from ..verification import stated
from . import kit

__all__ = ["draw_progress"]

#: Smallest time that is drawn, in seconds, because the axis is logarithmic.
_LEAST = 1e-4


@kit.documented
def draw_progress(
    solutions: Any, *, bound: float | None = None, unit: str = "m", title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:  # fmt: skip
    """Draw the objective of each run over logarithmic time, and its gap to the best proven bound in per cent.

    The solutions must belong to one model, and at least one of them must have a plan.

    Parameters
    ----------
    solutions : Solution or sequence of Solution
        Runs on one model. The incumbents of a run are drawn as steps that end with its answer. A
        run without a plan contributes its bound only.
    bound : float, optional
        Proven lower bound in addition to those of the solutions; the largest one is used. As in the
        solutions, it is a bound on the minimised objective. The picture shows the author's numbers.
    unit : str
        Unit of the objective.
    title : str, optional
        Title; by default the name of the instance.
    """
    allowed = bound is None or (kit.is_number(bound) and np.isfinite(bound))
    kit.check_option("bound", bound, bool(allowed), "be a finite number")
    runs = list(solutions) if isinstance(solutions, Iterable) else [solutions]
    if len({run.digest for run in runs}) > 1:
        raise InvalidData("solutions must be of one model", field="solutions")
    curves = _curves(runs)
    if not curves:
        raise InvalidData("solutions must hold one with a plan", field="solutions")
    last = max(float(curve.times[-1]) for curve in curves)
    first = min(0.1 * last, *(float(curve.times[0]) for curve in curves))
    proven = [run.dual_bound for run in runs if run.dual_bound is not None]
    proven += [] if bound is None else [float(bound)]
    ends = np.array([first, last])
    best = max(proven, default=None)
    sign = stated(1.0, any(getattr(run, "maximise", False) for run in runs))
    limits = []
    if best is not None:
        lower, upper = (best, np.inf) if sign > 0 else (-np.inf, -best)
        limits = [kit.Limit(ends, lower, upper, label="proven bound", shaded=False)]
    drawn = [curve._replace(values=sign * curve.values) for curve in curves]
    panels = [kit.Panel("objective", unit, drawn, limits)]
    if best is not None:
        panels.append(kit.Panel("gap to the bound", "%", [_gap(curve, best) for curve in curves]))
    name = next((run.instance for run in runs if run.instance), "")
    figure = kit.panel_sheet(
        panels, [kit.Span("", first, last)], columns=1, wrong=False, label="time (s)",
        title=name if title is None else title, size=size,
    )  # fmt: skip
    for axes in figure.axes:
        axes.set_xscale("log")
        kit.log_ticks(axes.xaxis, first, last)
        axes.set_xlim(first / 1.1, last * 1.1)
    return figure


def _curves(runs: Sequence[Any]) -> list[kit.Curve]:
    """Return the steps of every run with an answer, up to the end of the run."""
    curves = []
    for number, run in enumerate(runs):
        if run.primal_bound is None:
            continue
        end = max(_LEAST, run.seconds.get("solve", run.seconds.get("total", 0.0)))
        steps = [(max(_LEAST, step.seconds), step.objective) for step in run.incumbents]
        end = max([end, *(seconds for seconds, _ in steps)])
        # The reported incumbents may differ in their last digits from the verified objective.
        steps = [*sorted(steps), (end, run.primal_bound)]
        times, values = np.array(steps, float).T
        values = np.minimum.accumulate(values)
        # A value holds until the next step.
        times, values = np.repeat(times, 2)[1:], np.repeat(values, 2)[:-1]
        label = run.backend if [item.backend for item in runs].count(run.backend) == 1 else ""
        curves.append(kit.Curve(label or f"{run.backend} {number + 1}", number, times, values))
    return curves


def _gap(curve: kit.Curve, bound: float) -> kit.Curve:
    above = np.maximum(curve.values - bound, 0.0)
    scale = np.maximum(np.maximum(np.abs(curve.values), abs(bound)), 1e-10)
    return curve._replace(values=100.0 * above / scale)
