"""The picture of an optimal control: states, controls and what bounds them, over time.

One panel a state, a control and a path constraint; a vector has one panel for all its entries. Dashed
lines are limits, dots the nodes of the mesh, ticks its knots. On demand the costates, and how far
the plan lies from the motion that its control makes when it is integrated anew.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from ..minimum_snap.plot.data import pretty_unit
from ..plots.curves import Curve, Limit, Panel, Span, nodes_of, sampled
from ..plots.options import check_flags, check_size, check_tolerance
from ..plots.panels import figure_of, not_valid
from ..plots.style import number
from ..verification import TOLERANCE
from .definition import Definition, Guess, Phase, Quantity, Restriction, entry_names
from .plan import ControlPlan, PhasePlan, Piecewise
from .sampling import Course, courses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .model import OptimalControlProblem

__all__ = ["draw", "guessed"]

Floats = NDArray[np.float64]

#: Panels up to which one and two columns are enough.
_ONE, _TWO = 3, 10


def draw(
    model: OptimalControlProblem,
    plan: ControlPlan | None = None,
    *,
    only: tuple[str, ...] | None = None,
    paths: bool = True,
    costates: bool = False,
    deviation: bool = False,
    mesh: bool = True,
    tolerance: float = TOLERANCE,
    columns: int | None = None,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw states, controls and path constraints of `plan` over time.

    Parameters
    ----------
    model : OptimalControlProblem
        The problem.
    plan : ControlPlan, optional
        A plan of it, valid or not; where it breaks a limit, the worst place is ringed in red. None
        draws the guess that the search starts from.
    only : tuple of str, optional
        Names of the states, controls and path constraints to draw, in this order; all by default.
    paths : bool
        Whether to draw the path constraints.
    costates : bool
        Whether to draw the costates λ, which pseudospectral transcriptions give.
    deviation : bool
        Whether to draw how far the plan is from its motion integrated anew, relative to the size of
        each state.
    mesh : bool
        Whether to draw the nodes as dots and the knots as ticks; where there are too many of them to
        be told apart, they are left out.
    tolerance : float
        Largest violation accepted, relative, for what the title says and what is ringed: that of
        the solution.
    columns : int, optional
        Columns of panels, by default as many as the number of panels needs.
    title : str, optional
        Instead of the name, the objective, the end and the parameters.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        The panels, column by column: states, controls, path constraints, costates, deviation.

    Raises
    ------
    InvalidData
        The plan is none of the problem, it has no costates to draw, or an option has a value that is
        not allowed.
    """
    definition = model.definition
    check_flags(paths=paths, costates=costates, deviation=deviation, mesh=mesh)
    check_tolerance(tolerance)
    check_size(size, (1.0, 1.0))
    unplanned = plan is None
    drawn = guessed(definition) if plan is None else plan
    found = courses(definition, drawn)
    panels = list(_panels(found, paths and not unplanned, tolerance))
    panels = _chosen(panels, only)
    if unplanned and (costates or deviation):
        raise InvalidData("costates and deviation are of a plan, and there is none", field="plan")
    if costates:
        panels += list(_costates(found))
    if deviation:
        panels.append(_deviation(model, drawn, tolerance))
    verification = None if unplanned else model.verify(drawn, tolerance=tolerance)
    text = title
    if text is None:
        objective = None if verification is None else verification.objective
        text = _title(model, drawn, objective, unplanned) + not_valid(verification)
    spans = [Span(part.name, part.start, part.end, np.asarray(part.states.knots)) for part in drawn]
    return figure_of(
        panels, spans, columns=_columns(columns, len(panels)), title=text,
        wrong=verification is not None and not verification.ok,
        time_unit=pretty_unit(definition.phases[0].time_unit), size=size, dotted=mesh,
        guess=unplanned,
    )  # fmt: skip


# -- options -------------------------------------------------------------------------------------


def _columns(columns: Any, panels: int) -> int:
    if columns is None:
        return 1 if panels <= _ONE else 2 if panels <= _TWO else 3
    if isinstance(columns, bool) or not isinstance(columns, int) or not 1 <= columns <= 6:
        raise InvalidData(
            f"columns must be a whole number from 1 to 6, got {show(columns)}", field="columns"
        )
    return min(columns, panels)


def _chosen(panels: list[Panel], names: Any) -> list[Panel]:
    if names is None:
        return panels
    known = {panel.title: panel for panel in panels}
    listed: list[Any] = list(names) if isinstance(names, tuple | list) else []
    if not listed or not all(isinstance(name, str) and name in known for name in listed):
        raise InvalidData(
            f"only must hold some of {', '.join(map(repr, known))}, got {show(names)}", field="only"
        )
    return [known[name] for name in listed]


# -- what is drawn -------------------------------------------------------------------------------


def guessed(definition: Definition) -> ControlPlan:
    """Return the guess that the search starts from as a plan."""
    phases = []
    for phase in definition.phases:
        guess: Guess = phase.guess
        knots = guess.start + guess.fractions * (guess.end - guess.start)
        nodes = (np.array([-1.0, 1.0]),) * (knots.size - 1)
        parts = [
            Piecewise(knots, nodes, tuple(np.stack(pair) for pair in itertools.pairwise(t)))
            for t in (guess.states, guess.controls)
        ]
        phases.append(
            PhasePlan(phase.name, parts[0], parts[1], phase.state_names, phase.control_names)
        )
    return ControlPlan(
        tuple(phases), {one.name: one.initial_lower for one in definition.parameters}
    )


def _panels(found: Sequence[Course], paths: bool, tolerance: float) -> Iterator[Panel]:
    """Yield the panels of states, controls and path constraints; phases share those of a name."""
    samples = [sampled(course.plan) for course in found]
    for what in ("states", "controls"):
        dots = [nodes_of(getattr(course.plan, what)) for course in found]
        tables = [(t, x if what == "states" else u) for t, x, u in samples]
        yield from _of_kind(found, what, tables, dots, tolerance)
    if paths:
        tables = [(course.dense.times, course.dense_values["path"]) for course in found]
        yield from _of_kind(found, "paths", tables, None, tolerance)


def _of_kind(
    found: Sequence[Course], what: str, tables: Sequence[tuple[Floats, Floats]],
    dots: Sequence[tuple[Floats, Floats]] | None, tolerance: float,
) -> Iterator[Panel]:  # fmt: skip
    gathered: dict[str, tuple[str, list[Curve], list[Limit]]] = {}
    for k, course in enumerate(found):
        at = 0
        for one in getattr(course.phase, what):
            entries = range(at, at + one.size)
            at += one.size
            unit, curves, limits = gathered.setdefault(one.name, (pretty_unit(one.unit), [], []))
            for own, entry in enumerate(entries):
                name = one.name if one.size == 1 else f"{one.name}[{own}]"
                marks = () if dots is None else (dots[k][0], dots[k][1][:, entry])
                curves.append(Curve(name, own, tables[k][0], tables[k][1][:, entry], *marks))
            limits += _limits(one, course, tolerance)
            gathered[one.name] = (unit or pretty_unit(one.unit), curves, limits)
    for name, (unit, curves, limits) in gathered.items():
        yield Panel(name, unit, curves, limits)


def _limits(one: Quantity | Restriction, course: Course, tolerance: float) -> Iterator[Limit]:
    """Yield the bounds over a phase; entries that have the same ones share them."""
    groups: dict[tuple[float, float], list[int]] = {}
    for entry, pair in enumerate(zip(one.lower.tolist(), one.upper.tolist(), strict=True)):
        groups.setdefault(pair, []).append(entry)
    for (lower, upper), members in groups.items():
        edges = [abs(edge) for edge in (lower, upper) if np.isfinite(edge)]
        if not edges:
            continue
        # As the checks have it: path constraints are measured in their own scale, too.
        typical = float(one.scale[members].max()) if isinstance(one, Restriction) else 1.0
        size = max(1.0, typical, *edges)
        whole = len(members) == one.size
        yield Limit(
            course.plan.start, course.plan.end, lower, upper,
            () if whole else tuple(members), tolerance * size,
        )  # fmt: skip


def _costates(found: Sequence[Course]) -> Iterator[Panel]:
    missing = [course.plan.name for course in found if course.plan.costates is None]
    if missing:
        raise InvalidData(
            f"the plan has no costates in phase {missing[0]!r}: they come with the formulations "
            "that give them, such as 'gauss' and 'radau'",
            field="costates",
        )
    gathered: dict[str, list[Curve]] = {}
    for course in found:
        part = course.plan.costates
        assert part is not None
        times, values = nodes_of(part)
        curve = PhasePlan(
            course.plan.name, part, part, course.plan.state_names, course.plan.state_names
        )
        t, x, _ = sampled(curve)
        at = 0
        for one in course.phase.states:
            for own, name in enumerate(entry_names([one])):
                gathered.setdefault(one.name, []).append(
                    Curve(name, own, t, x[:, at], times, values[:, at])
                )
                at += 1
    for name, curves in gathered.items():
        yield Panel(f"costate λ of {name}", "", curves)


def _deviation(model: OptimalControlProblem, plan: ControlPlan, tolerance: float) -> Panel:
    """Return the panel of how far the plan is from its motion integrated anew."""
    from .checks import motion

    curves: list[Curve] = []
    order = list(
        dict.fromkeys(one.name for phase in model.definition.phases for one in phase.states)
    )
    for k, course in enumerate(courses(model.definition, plan)):
        again = motion(model, plan, k)
        share = np.abs(again.deviation) / course.state_scale
        at = 0
        for one in course.phase.states:
            largest = share[:, at : at + one.size].max(axis=1)
            at += one.size
            # Zeros have no logarithm: the start is one.
            largest = np.where(largest > 0.0, largest, np.nan)
            curves.append(Curve(one.name, order.index(one.name), again.times, largest))
    limit = Limit(plan.start, plan.end, -np.inf, tolerance, (), np.inf)
    return Panel("deviation", "relative", curves, [limit], log=True)


def _title(
    model: OptimalControlProblem, plan: ControlPlan, objective: float | None, unplanned: bool
) -> str:
    definition = model.definition
    parts = ["guess"] if unplanned else []
    if objective is not None:
        parts.append(
            f"objective = {number(objective)} {pretty_unit(definition.objective_unit)}".rstrip()
        )
    end: Phase = definition.phases[-1]
    unit = pretty_unit(end.time_unit)
    parts.append(f"{number(plan.phases[-1].end, 5)} {unit}".rstrip())
    for name, value in list(plan.parameters.items())[:3]:
        if value.size == 1:
            parts.append(f"{name} = {number(float(value[0]), 5)}")
    text = ", ".join(parts)
    return f"{model.name}  ·  {text}" if model.name else text
