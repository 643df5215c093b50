"""Picture of an optimal control: states, controls and their bounds over time.

There is one panel per state, control and path constraint; the entries of a vector share a panel.
Dashed lines are limits, dots are nodes of the mesh and ticks its knots. Optional panels show the
costates and the deviation of the plan from its re-integrated motion.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import UnsupportedOption
from ..plots import kit
from ..verification import Check, Verification
from .definition import Definition, Guess, Quantity, Restriction, entry_names, entry_slices
from .plan import ControlPlan, PhasePlan, Piecewise
from .sampling import Course, courses

if TYPE_CHECKING:
    from .model import OptimalControlProblem

__all__ = ["animate_control", "curves_of", "draw", "guessed", "nodes_of", "sampled"]

#: Largest numbers of panels in one column and in two.
_ONE, _TWO = 3, 10
#: Smallest number of points of a curve per interval, and their approximate total.
_FEWEST, _POINTS = 12, 2400
#: Times and values, shapes (points,) and (points, size).
_Table = tuple[kit.Floats, kit.Floats]


@kit.documented
def draw(
    model: OptimalControlProblem,
    plan: ControlPlan | None = None,
    *,
    only: tuple[str, ...] | None = None,
    paths: bool = True,
    costates: bool = False,
    deviation: bool = False,
    mesh: bool = True,
    tolerance: float = kit.TOLERANCE,
    columns: int | None = None,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw states, controls, path constraints, outputs, costates and deviation of `plan` over time.

    Parameters
    ----------
    plan : ControlPlan, optional
        Plan of the problem, valid or not. The worst violation of a limit is ringed in red. None
        draws the guess, where the search starts.
    only : tuple of str, optional
        Names of the states, controls and path constraints to draw, in this order; all by default.
    paths : bool
        Whether to draw the path constraints and outputs.
    costates : bool
        Whether to draw the costates λ, which pseudospectral transcriptions give.
    deviation : bool
        Whether to draw the deviation of the plan from its re-integrated motion, relative to the size
        of each state.
    mesh : bool
        Whether to draw the nodes as dots and the knots as ticks. They are omitted if there are too
        many to distinguish.
    columns : int, optional
        Number of columns of panels; by default chosen from the number of panels.
    """
    definition = model.definition
    kit.check_flags(paths=paths, costates=costates, deviation=deviation, mesh=mesh)
    result = kit.verified_plan(model, plan, ControlPlan, tolerance)
    drawn = guessed(definition) if plan is None else plan
    phases = courses(definition, drawn)
    panels = list(_panels(phases, paths and plan is not None, tolerance))
    if only is not None:
        known = {panel.title: panel for panel in panels}
        panels = [known[name] for name in kit.check_words("only", only, tuple(known))]
    if plan is None and (costates or deviation):
        raise UnsupportedOption("costates and deviation need a plan, got None")
    if costates:
        panels += _costates(phases, definition.objective_unit)
    if deviation:
        panels.append(_deviation(model, drawn, phases, tolerance))
    if columns is None:
        columns = 1 if len(panels) <= _ONE else 2 if len(panels) <= _TWO else 3
    kit.check_whole("columns", columns, 1, 6)
    figure = kit.panel_sheet(
        panels, [kit.Span(part.name, part.start, part.end, part.states.knots) for part in drawn],
        title=kit.title_of(model, _parts(model, drawn, result), result, title), wrong=kit.is_wrong(result),
        columns=min(int(columns), len(panels)), mesh=mesh, guess=plan is None, size=size,
        label=kit.with_unit("time", definition.phases[0].time_unit),
    )  # fmt: skip
    places = list(zip(figure.axes, panels, strict=True))
    kit.pin_curves(result, lambda check: _curve_of(check, places, drawn))
    return figure


def _curve_of(
    check: Check, places: Sequence[tuple[Any, kit.Panel]], plan: ControlPlan
) -> tuple[Any, kit.Curve, float] | None:
    """Return axes, curve and time of a check; a check of the times is on the first curve."""
    text, _, name = check.where.partition(" of phase ")
    part = next((part for part in plan if name.startswith(repr(part.name))), plan.phases[0])
    entry, mark, _ = text.partition("t = ")
    time = kit.time_of(check) if mark else {"start": part.start, "end": part.end}.get(text)
    entry = entry.removesuffix("at ").strip()
    names = {entry or check.name, f"{check.name}[{entry.removeprefix('entry ')}]"}
    pairs = [(axes, curve) for axes, panel in places for curve in panel.curves]
    pairs = [pair for pair in pairs if not mark or pair[1].name in names]
    if time is None or not pairs:
        return None
    # A name has one curve per phase.
    axes, curve = min(pairs, key=lambda pair: abs(pair[1].times[0] - part.start))
    return axes, curve, time


def _parts(
    model: OptimalControlProblem, plan: ControlPlan, result: Verification | None
) -> list[str]:
    """Return the parts of the title."""
    definition = model.definition
    parts = ["guess"] if result is None else []
    if result is not None and result.objective is not None:
        unit = kit.pretty_unit(definition.objective_unit)
        parts.append(f"objective = {kit.number(result.objective)} {unit}".rstrip())
    unit = kit.pretty_unit(definition.phases[-1].time_unit)
    parts.append(f"{kit.number(plan.phases[-1].end, 5)} {unit}".rstrip())
    for name, value in list(plan.parameters.items())[:3]:
        if value.size == 1:
            parts.append(f"{name} = {kit.number(float(value[0]), 5)}")
    return parts


def guessed(definition: Definition) -> ControlPlan:
    """Return the guess, where the search starts, as a plan."""
    phases = []
    for phase in definition.phases:
        guess: Guess = phase.guess
        knots = guess.start + guess.fractions * (guess.end - guess.start)
        nodes = (np.array([-1.0, 1.0]),) * (knots.size - 1)
        states, controls = (
            Piecewise(knots, nodes, tuple(np.stack(pair) for pair in itertools.pairwise(t)))
            for t in (guess.states, guess.controls)
        )
        names = phase.state_names, phase.control_names
        phases.append(PhasePlan(phase.name, states, controls, *names))
    parameters = {parameter.name: parameter.initial_lower for parameter in definition.parameters}
    return ControlPlan(tuple(phases), parameters)


def sampled(part: PhasePlan) -> tuple[kit.Floats, kit.Floats, kit.Floats]:
    """Return times, states and controls of a phase for its curves; knots appear twice."""
    even = np.linspace(-1.0, 1.0, max(_FEWEST, _POINTS // part.states.intervals))
    at = [
        np.unique(np.concatenate([even, *nodes]))
        for nodes in zip(part.states.nodes, part.controls.nodes, strict=True)
    ]
    return *nodes_of(part.states, at), nodes_of(part.controls, at)[1]


def nodes_of(part: Piecewise, positions: Sequence[kit.Floats] | None = None) -> _Table:
    """Return times (points,) and values (points, size) at the nodes, or at `positions` from -1 to 1.

    The positions are those in each interval.
    """
    positions = part.nodes if positions is None else positions
    ends = itertools.pairwise(part.knots)
    times = [a + 0.5 * (at + 1.0) * (b - a) for (a, b), at in zip(ends, positions, strict=True)]
    values = [part.on(k, at) for k, at in enumerate(positions)]
    return np.concatenate(times), np.concatenate(values)


def curves_of(
    names: Sequence[str], times: kit.Floats, values: kit.Floats, nodes: _Table | None = None
) -> tuple[list[kit.Curve], list[kit.Mark]]:
    """Return the curves of a table, one per column, and the marks of their nodes (times and table)."""
    curves = [kit.Curve(name, k, times, values[:, k]) for k, name in enumerate(names)]
    dots = [] if nodes is None else list(nodes[1].T)
    return curves, [kit.Mark("node", nodes[0], dot, k) for k, dot in enumerate(dots) if nodes]


def _panels(phases: Sequence[Course], paths: bool, tolerance: float) -> Iterator[kit.Panel]:
    """Yield the panels of states, controls and path constraints; equal names of phases share a panel."""
    samples = [sampled(course.plan) for course in phases]
    for k, what in enumerate(("states", "controls"), 1):
        dots = [nodes_of(getattr(course.plan, what)) for course in phases]
        yield from _of_kind(phases, what, [(item[0], item[k]) for item in samples], dots, tolerance)
    if paths:
        tables = [(course.dense.times, course.dense_values["path"]) for course in phases]
        yield from _of_kind(phases, "paths", tables, None, tolerance)
        shown = [c.phase.observe(*c.dense[2:], c.parameters)[2] for c in phases]
        tables = [(c.dense.times, table) for c, table in zip(phases, shown, strict=True)]
        yield from _of_kind(phases, "outputs", tables, None, tolerance)


def _of_kind(
    phases: Sequence[Course], what: str, tables: Sequence[_Table],
    dots: Sequence[_Table] | None, tolerance: float | None, title: str = "{}", per: str | None = None,
) -> Iterator[kit.Panel]:  # fmt: skip
    """Yield one panel per name. A tolerance adds the limits; `per` is the unit that is divided by that of the item."""
    units: dict[str, str] = {}
    gathered: dict[str, tuple[list[kit.Curve], list[kit.Mark], list[kit.Limit]]] = {}
    for k, course in enumerate(phases):
        for item, columns in entry_slices(getattr(course.phase, what)):
            at_nodes = None if dots is None else (dots[k][0], dots[k][1][:, columns])
            curves, marks, bounds = gathered.setdefault(item.name, ([], [], []))
            times, values = tables[k]
            lines, nodes = curves_of(entry_names([item]), times, values[:, columns], at_nodes)
            curves += lines
            marks += nodes
            bounds += [] if tolerance is None else _limits(item, course, tolerance)
            unit = f"({item.unit})" if set("/ ") & set(item.unit) else item.unit
            unit = item.unit if per is None else f"{per or 1}/{unit}" if unit else per
            units[item.name] = units.get(item.name) or unit
    for name, (curves, marks, bounds) in gathered.items():
        yield kit.Panel(title.format(name), units[name], curves, bounds, marks)


def _limits(item: Quantity | Restriction, course: Course, tolerance: float) -> Iterator[kit.Limit]:
    """Yield the bounds over a phase; entries with equal bounds share them."""
    groups: dict[tuple[float, float], list[int]] = {}
    for entry, pair in enumerate(zip(item.lower.tolist(), item.upper.tolist(), strict=True)):
        groups.setdefault(pair, []).append(entry)
    times = np.array([course.plan.start, course.plan.end])
    for (lower, upper), members in groups.items():
        edges = [abs(edge) for edge in (lower, upper) if np.isfinite(edge)]
        # As in the verification: the tolerance of a path constraint also scales with its size.
        typical = float(item.scale[members].max())
        typical = typical if isinstance(item, Restriction) else min(typical, 1.0)
        colours = () if len(members) == item.size else tuple(members)
        if edges:
            yield kit.Limit(times, lower, upper, colours, tolerance * max(typical, *edges))


def _costates(phases: Sequence[Course], unit: str) -> Iterator[kit.Panel]:
    tables, dots = [], []
    for course in phases:
        name, part = course.plan.name, course.plan.costates
        if part is None:
            raise UnsupportedOption(
                f"the plan has no costates in phase {name!r}: they come with the formulations that "
                "give them, such as 'gauss' and 'radau'"
            )
        names = course.plan.state_names
        tables.append(sampled(PhasePlan(name, part, part, names, names))[:2])
        dots.append(nodes_of(part))
    yield from _of_kind(phases, "states", tables, dots, None, "costate λ of {}", unit)


def _deviation(
    model: OptimalControlProblem, plan: ControlPlan, phases: Sequence[Course], tolerance: float
) -> kit.Panel:
    """Return the panel of the deviation of the plan from its re-integrated motion."""
    from .checks import motion

    curves: list[kit.Curve] = []
    order = list(dict.fromkeys(item.name for course in phases for item in course.phase.states))
    for k, course in enumerate(phases):
        reintegrated = motion(model, plan, k)
        share = np.abs(reintegrated.deviation) / course.sizes.states
        for item, columns in entry_slices(course.phase.states):
            largest = share[:, columns].max(axis=1)
            # Zeros, such as the deviation at the start, have no logarithm.
            largest = np.where(largest > 0.0, largest, np.nan)
            curves.append(kit.Curve(item.name, order.index(item.name), reintegrated.times, largest))
    limit = kit.Limit(np.array([plan.start, plan.end]), -np.inf, tolerance)
    return kit.Panel("deviation", "relative", curves, [limit], log=True)


@kit.animated(draw, ControlPlan)
def animate_control(model: OptimalControlProblem, plan: ControlPlan | Any, figure: Any) -> Any:
    """Animate the picture of a plan: a marker on every curve, over time."""
    return kit.curve_movers(figure), "t =", model.definition.phases[0].time_unit
