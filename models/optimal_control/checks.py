"""The check of a plan for an optimal control problem, from the declared functions alone.

It shares nothing with the transcriptions: the motion is integrated anew with the plan's control,
bounds and path constraints are searched between the nodes, integrals are found by quadrature.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from ..verification import Check, Verification, check_tolerance
from .definition import Definition, Phase, Restriction
from .integration import Reintegration, integrate_anew
from .plan import ControlPlan
from .sampling import Course, Instants, courses, endpoint
from .sizes import along, sizes_at

__all__ = ["motion", "verify_control"]

Floats = NDArray[np.float64]


#: Share of the size of a state or control from which its bound is what violations are held against.
NEAR = 0.1
#: Scale of a fixed time, relative to the times of its phase: what their rounding leaves.
FIXED = 1e-5


class _Found(NamedTuple):
    """The worst of one kind in one phase."""

    worst: float
    scale: float
    unit: str
    where: str
    equation: str = ""


class _Sides:
    """The finite bounds of some entries: one column a side, measured in its own scale.

    That is the bound, or the size of what is bounded where the bound is less than `near` of it.
    """

    def __init__(self, lower: Floats, upper: Floats, scale: Floats, *, near: float = 1.0) -> None:
        below, above = np.isfinite(lower), np.isfinite(upper)
        entries = np.arange(lower.size)
        self.entry = np.concatenate([entries[below], entries[above]])
        self._bound = np.concatenate([lower[below], upper[above]])
        self._sign = np.repeat([-1.0, 1.0], [int(below.sum()), int(above.sum())])
        own, size = scale[self.entry], np.abs(self._bound)
        self.scale: Floats = np.where(size >= near * own, size, own)

    def __call__(self, values: Floats) -> Floats:
        """Return by how much `values` break each bound, relative to its scale; shape (…, sides)."""
        found: Floats = self._sign * (values[..., self.entry] - self._bound) / self.scale
        return found

    def found(self, share: float, column: int, unit: str, where: str, equation: str) -> _Found:
        """Return a violation in units of the entry."""
        scale = float(self.scale[column])
        return _Found(share * scale if share > 0.0 else 0.0, scale, unit, where, equation)

    def worst(
        self, values: Floats, units: Sequence[str], places: Sequence[str], equation: str = ""
    ) -> list[_Found]:
        """Return the worst of some values, (entries,), with their units and places; none unbounded."""
        if not self.entry.size:
            return []
        _, column, share = _largest(self(values)[None])
        entry = int(self.entry[column])
        return [self.found(share, column, units[entry], places[entry], equation)]


def _largest(share: Floats) -> tuple[int, int, float]:
    """Return row, column and value of the largest entry; what is no number is larger than all."""
    share = np.where(np.isnan(share), np.inf, share)
    row, column = (int(k) for k in np.unravel_index(int(share.argmax()), share.shape))
    return row, column, float(share[row, column])


def motion(problem: Any, plan: ControlPlan, phase: int | str = 0) -> Reintegration:
    """Return the motion of a plan integrated anew with its control, for one phase.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        The problem, whose dynamics are integrated.
    plan : ControlPlan
        The plan, whose control and first state are taken.
    phase : int or str
        Number or name of the phase.

    Raises
    ------
    InvalidData
        The plan does not fit the problem, or there is no such phase.
    """
    found = courses(getattr(problem, "definition", problem), plan)
    names = [one.phase.name for one in found]
    if isinstance(phase, str) and phase in names:
        return integrate_anew(found[names.index(phase)])
    if isinstance(phase, int) and -len(found) <= phase < len(found):
        return integrate_anew(found[phase])
    raise InvalidData(
        f"phase must be a number below {len(found)} or one of "
        f"{', '.join(map(repr, names))}, got {show(phase)}",
        field="phase",
    )


def verify_control(definition: Definition, plan: ControlPlan, tolerance: float) -> Verification:
    """Return the objective and every constraint of a problem, measured on `plan`.

    Parameters
    ----------
    definition : Definition
        What the problem consists of.
    plan : ControlPlan
        States, controls, times and parameters.
    tolerance : float
        Largest violation accepted, relative to the size of what is bounded: the bound, the declared
        scale (that of a state, control or parameter counts 1 at most), or the state's course.

    Raises
    ------
    InvalidData
        The plan's phases, names or parameters are not the problem's, or it is not finite.
    """
    check_tolerance(tolerance)
    phases = courses(definition, plan)
    with np.errstate(all="ignore"):
        motions = [integrate_anew(one) for one in phases]
        ends = endpoint(phases)
        objective, boundary = _at_ends(definition, ends, phases[0].parameters)
        sizes = sizes_at(definition, phases, ends, guessed=False)
        kinds: list[tuple[str, Iterable[_Found]]] = [
            ("motion", map(_motion, phases, motions, _labels(phases))),
            ("continuity of states", map(_continuity, phases, _labels(phases))),
            ("times", _times(phases)),
            ("initial values", _ends(phases, motions, 0)),
            ("final values", _ends(phases, motions, 1)),
            ("bounds of states", _bounds(phases, "states")),
            ("bounds of controls", _bounds(phases, "controls")),
            (
                "bounds of parameters",
                _Sides(
                    *definition.bounds("parameters"),
                    along(definition.parameters, phases[0].parameters[None]),
                ).worst(
                    phases[0].parameters,
                    _units(definition, "parameters"),
                    definition.parameter_names,
                ),
            ),
            *_paths(phases),
            *_boundaries(definition, boundary, sizes.boundaries),
            *_invariants(phases, motions),
            ("objective", _objective(definition, phases, motions, objective, sizes.objective)),
        ]
        checks = [_check(name, list(found), tolerance) for name, found in kinds]
    return Verification(
        objective if np.isfinite(objective) else None, tuple(one for one in checks if one)
    )


def _check(name: str, found: list[_Found], tolerance: float) -> Check | None:
    """Return the worst of one kind over the phases; none where nothing is asked."""
    if not found:
        return None
    found = [one if one.worst == one.worst else one._replace(worst=np.inf) for one in found]
    worst = max(found, key=lambda one: one.worst / one.scale)
    return Check.scaled(
        name, worst.equation, worst.worst, worst.unit, worst.where, tolerance, worst.scale
    )


def _labels(phases: tuple[Course, ...]) -> list[str]:
    """Return what names each phase behind a place; nothing where there is only one."""
    return [f" of phase {one.phase.name!r}" if len(phases) > 1 else "" for one in phases]


def _units(of: Phase | Definition, what: str) -> list[str]:
    return [one.unit for one in getattr(of, what) for _ in range(one.size)]


def _place(name: str, course: Course, time: float, label: str) -> str:
    """Return ``"x at t = 0.31 s of phase 'climb'"``; without a name, the time alone."""
    head = f"{name} at " if name else ""
    return f"{head}t = {time:.6g} {course.phase.time_unit}".rstrip() + label


# -- the motion --------------------------------------------------------------------------------------


def _motion(course: Course, found: Reintegration, label: str) -> _Found:
    row, state, share = _largest(np.abs(found.deviation) / course.state_scale)
    place = _place(course.phase.state_names[state], course, found.times[row], label)
    if found.windows > 1:
        place += f", in {found.windows} windows"
    if found.failure:
        place += f": {found.failure}"
    scale = float(course.state_scale[state])
    unit = _units(course.phase, "states")[state]
    return _Found(share * scale, scale, unit, place, course.phase.dynamics_equation)


def _continuity(course: Course, label: str) -> _Found:
    grid = course.dense
    new = np.flatnonzero(np.diff(grid.interval) > 0)
    unit = _units(course.phase, "states")
    if not new.size:
        return _Found(0.0, 1.0, unit[0], "")
    jumps = np.abs(grid.states[new + 1] - grid.states[new])
    row, state, share = _largest(jumps / course.state_scale)
    scale = float(course.state_scale[state])
    place = _place(course.phase.state_names[state], course, grid.times[new[row]], label)
    return _Found(share * scale, scale, unit[state], place)


def _invariants(
    phases: tuple[Course, ...], motions: list[Reintegration]
) -> Iterator[tuple[str, list[_Found]]]:
    """Yield how far each invariant strays, along the plan's states and the integrated ones."""
    for course, label, moved in zip(phases, _labels(phases), motions, strict=True):
        if not course.phase.invariants:
            continue
        tables = (course.dense_values, course.values(moved.at, moved.states))
        begin = tables[0]["invariant"][0]
        at = 0
        for one in course.phase.invariants:
            entries = slice(at, at + one.size)
            at += one.size
            scale = np.maximum(one.scale, np.abs(begin[entries]))
            found = []
            grids = (course.dense.times, ""), (moved.times, " (integrated)")
            for table, (times, whose) in zip(tables, grids, strict=True):
                strays = np.abs(table["invariant"][:, entries] - begin[entries])
                row, entry, share = _largest(strays / scale)
                place = _place(_entry(one, entry), course, times[row], label) + whose
                size = float(scale[entry])
                found.append(_Found(share * size, size, one.unit, place, one.equation))
            yield one.name, found


# -- at every instant --------------------------------------------------------------------------------


def _entry(one: Restriction, entry: int) -> str:
    return f"entry {entry}" if one.size > 1 else ""


def _bounds(phases: tuple[Course, ...], what: str) -> Iterator[_Found]:
    """Yield the worst against the bounds of states or controls, between the nodes as well."""
    for course, label in zip(phases, _labels(phases), strict=True):
        sides = _Sides(*course.phase.bounds(what), getattr(course.sizes, what), near=NEAR)
        if not sides.entry.size:
            continue
        worst = course.largest(
            lambda at, sides=sides: sides(getattr(at, what)),  # type: ignore[misc]
            sides(getattr(course.dense, what)),
        )
        entry = int(sides.entry[worst.entry])
        names = course.phase.state_names if what == "states" else course.phase.control_names
        place = _place(names[entry], course, worst.time, label)
        yield sides.found(worst.value, worst.entry, _units(course.phase, what)[entry], place, "")


def _paths(phases: tuple[Course, ...]) -> Iterator[tuple[str, list[_Found]]]:
    """Yield the worst of each path constraint, between the nodes as well."""
    for course, label in zip(phases, _labels(phases), strict=True):
        begin = 0
        for one in course.phase.paths:
            entries = slice(begin, begin + one.size)
            sides = _Sides(one.lower, one.upper, course.sizes.paths[entries])
            begin += one.size
            if not sides.entry.size:
                continue
            worst = course.largest(
                _on_path(course, sides, entries), sides(course.dense_values["path"][:, entries])
            )
            place = _place(_entry(one, int(sides.entry[worst.entry])), course, worst.time, label)
            yield one.name, [sides.found(worst.value, worst.entry, one.unit, place, one.equation)]


def _on_path(course: Course, sides: _Sides, entries: slice) -> Callable[[Instants], Floats]:
    return lambda at: sides(course.values(at)["path"][:, entries])


# -- at the ends -------------------------------------------------------------------------------------


def _times(phases: tuple[Course, ...]) -> Iterator[_Found]:
    for course, label in zip(phases, _labels(phases), strict=True):
        phase, plan = course.phase, course.plan
        sides = _Sides(
            np.array([phase.start_lower, phase.end_lower]),
            np.array([phase.start_upper, phase.end_upper]),
            np.full(2, plan.duration),
        )
        # A fixed time is no unknown: the plan has it but for rounding, however long the phase is.
        fixed = [phase.start_lower == phase.start_upper, phase.end_lower == phase.end_upper]
        sides.scale[np.array(fixed)[sides.entry]] = FIXED * max(
            plan.duration, abs(plan.start), abs(plan.end)
        )
        places = f"start{label}", f"end{label}"
        yield from sides.worst(np.array([plan.start, plan.end]), [phase.time_unit] * 2, places)


def _ends(phases: tuple[Course, ...], motions: list[Reintegration], end: int) -> Iterator[_Found]:
    """Yield the worst of the states at one end, which are measured in the size of the motion."""
    for course, label, moved in zip(phases, _labels(phases), motions, strict=True):
        word = ("initial", "final")[end]
        sides = _Sides(*course.phase.bounds("states", word), course.state_scale)
        values = [(course.dense.states[-end], "")]
        if end and moved.windows == 1:
            values.append((moved.states[-1], " (integrated)"))
        time = (course.plan.start, course.plan.end)[end]
        places = [_place(name, course, time, label) for name in course.phase.state_names]
        for state, whose in values:
            own = [place + whose for place in places]
            yield from sides.worst(state, _units(course.phase, "states"), own)


def _at_ends(definition: Definition, ends: Floats, parameters: Floats) -> tuple[float, Floats]:
    """Return the objective and the boundary constraints."""
    objective, boundary = definition.endpoint(ends, parameters)
    return float(objective), boundary.full().ravel()


def _boundaries(
    definition: Definition, values: Floats, scale: Floats
) -> Iterator[tuple[str, list[_Found]]]:
    begin = 0
    for one in definition.boundaries:
        sides = _Sides(one.lower, one.upper, scale[begin : begin + one.size])
        own, places = values[begin : begin + one.size], [_entry(one, k) for k in range(one.size)]
        begin += one.size
        yield one.name, sides.worst(own, [one.unit] * one.size, places, one.equation)


def _objective(
    definition: Definition,
    phases: tuple[Course, ...],
    motions: list[Reintegration],
    objective: float,
    scale: float,
) -> Iterator[_Found]:
    """Yield how far the objective lies from that of the motion integrated anew, from end to end."""
    if any(one.windows > 1 for one in motions):
        return
    ends = endpoint(phases, [(one.states[-1], one.integrals) for one in motions])
    again, _ = _at_ends(definition, ends, phases[0].parameters)
    unit = definition.objective_unit
    where = f"the integrated motion, where it is {again:.10g}"
    yield _Found(abs(again - objective), scale, unit, where)
