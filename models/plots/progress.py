"""How runs came to their answers: objective over time, and the gap to what is proven."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidData
from .curves import Curve, Limit, Panel, Span
from .options import check_option, is_number
from .panels import panel_sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_progress"]

#: Seconds that are drawn at the least: time has a logarithmic scale.
_LEAST = 1e-4


def draw_progress(
    solutions: Any, *, bound: float | None = None, unit: str = "m", title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:  # fmt: skip
    """Draw the objective of each run over the logarithm of time, and how far it is from the best proven bound.

    Parameters
    ----------
    solutions : Solution or sequence of Solution
        Runs on one model, which is to be minimised. What a run reported on its way is drawn as steps
        that end with its answer; a run without a plan gives its bound alone.
    bound : float, optional
        A proven lower bound, beside those that the solutions have; the greatest counts.
    unit : str
        Of the objective.
    title : str, optional
        Instead of the instance's name.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        One panel, or a second one of the gap in per cent where there is a bound.

    Raises
    ------
    InvalidData
        No solution has a plan, or they are of different models.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    allowed = bound is None or (is_number(bound) and np.isfinite(bound))
    check_option("bound", bound, bool(allowed), "be a finite number")
    runs = list(solutions) if isinstance(solutions, Iterable) else [solutions]
    if len({one.digest for one in runs}) > 1:
        raise InvalidData("solutions must be of one model", field="solutions")
    curves = _curves(runs)
    if not curves:
        raise InvalidData("solutions must hold one with a plan", field="solutions")
    last = max(float(curve.times[-1]) for curve in curves)
    first = min(0.1 * last, *(float(curve.times[0]) for curve in curves))
    proven = [one.dual_bound for one in runs if one.dual_bound is not None]
    proven += [] if bound is None else [float(bound)]
    ends = np.array([first, last])
    best = max(proven, default=None)
    limits = [] if best is None else [Limit(ends, best, np.inf, label="proven bound", shaded=False)]
    panels = [Panel("objective", unit, curves, limits)]
    if best is not None:
        panels.append(Panel("gap to the bound", "%", [_gap(curve, best) for curve in curves]))
    name = next((one.instance for one in runs if one.instance), "")
    figure = panel_sheet(
        panels, [Span("", first, last, np.empty(0))], columns=1, wrong=False, label="time (s)",
        title=name if title is None else title, size=size,
    )  # fmt: skip
    for axes in figure.axes:
        axes.set_xscale("log")
        axes.set_xlim(first / 1.1, last * 1.1)
    return figure


def _curves(runs: Sequence[Any]) -> list[Curve]:
    """Return the steps of every run that has an answer, each to the end of its run."""
    curves = []
    for number, one in enumerate(runs):
        if one.primal_bound is None:
            continue
        end = max(_LEAST, one.seconds.get("solve", one.seconds.get("total", 0.0)))
        steps = [(max(_LEAST, step.seconds), step.objective) for step in one.incumbents]
        end = max([end, *(when for when, _ in steps)])
        # What a backend claims on its way may differ from what verifies in its last digits.
        steps = [*sorted(steps), (end, one.primal_bound)]
        times, values = np.array(steps, float).T
        values = np.minimum.accumulate(values)
        # A value holds until the next one comes.
        times, values = np.repeat(times, 2)[1:], np.repeat(values, 2)[:-1]
        label = one.backend if [other.backend for other in runs].count(one.backend) == 1 else ""
        curves.append(Curve(label or f"{one.backend} {number + 1}", number, times, values))
    return curves


def _gap(curve: Curve, bound: float) -> Curve:
    above = np.maximum(curve.values - bound, 0.0)
    scale = np.maximum(np.maximum(np.abs(curve.values), abs(bound)), 1e-10)
    return curve._replace(values=100.0 * above / scale)
