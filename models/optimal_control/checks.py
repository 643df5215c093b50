"""Verification of a plan for an optimal control problem from the declared functions alone.

It shares no code with the transcriptions. The motion is re-integrated with the plan's control, bounds
and path constraints are checked between the nodes, and integrals are computed by quadrature.
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


#: Smallest ratio of a bound to the size of its state or control at which the bound is the scale.
NEAR = 0.1
#: Scale of a fixed time relative to the times of its phase, which admits rounding only.
FIXED = 1e-5


class _Violation(NamedTuple):
    """Largest violation of one kind in one phase."""

    worst: float
    scale: float
    unit: str
    where: str
    equation: str = ""


class _Sides:
    """Finite bounds of some entries, one column per bound, each with its own scale.

    The scale is the bound, or the size of the entry if the bound is less than `near` times the size.
    """

    def __init__(self, lower: Floats, upper: Floats, scale: Floats, *, near: float = 1.0) -> None:
        below, above = np.isfinite(lower), np.isfinite(upper)
        entries = np.arange(lower.size)
        self.entry = np.concatenate([entries[below], entries[above]])
        self._bound = np.concatenate([lower[below], upper[above]])
        self._sign = np.repeat([-1.0, 1.0], [int(below.sum()), int(above.sum())])
        size_of_entry, size = scale[self.entry], np.abs(self._bound)
        self.scale: Floats = np.where(size >= near * size_of_entry, size, size_of_entry)

    def __call__(self, values: Floats) -> Floats:
        """Return the excess of `values` over each bound, relative to its scale; shape (…, sides)."""
        result: Floats = self._sign * (values[..., self.entry] - self._bound) / self.scale
        return result

    def violation(
        self, share: float, column: int, unit: str, where: str, equation: str
    ) -> _Violation:
        """Return a relative violation as an absolute one, in the unit of the entry."""
        scale = float(self.scale[column])
        return _Violation(share * scale if share > 0.0 else 0.0, scale, unit, where, equation)

    def worst(
        self, values: Floats, units: Sequence[str], places: Sequence[str], equation: str = ""
    ) -> list[_Violation]:
        """Return the worst violation of `values`, shape (entries,); an empty list without bounds."""
        if not self.entry.size:
            return []
        _, column, share = _largest(self(values)[None])
        entry = int(self.entry[column])
        return [self.violation(share, column, units[entry], places[entry], equation)]


def _largest(share: Floats) -> tuple[int, int, float]:
    """Return row, column and value of the largest entry; NaN is treated as the largest."""
    share = np.where(np.isnan(share), np.inf, share)
    row, column = (int(k) for k in np.unravel_index(int(share.argmax()), share.shape))
    return row, column, float(share[row, column])


def motion(problem: Any, plan: ControlPlan, phase: int | str = 0) -> Reintegration:
    """Return the motion of one phase of a plan, re-integrated with its control.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        Problem with the dynamics.
    plan : ControlPlan
        Plan with the control and the initial state.
    phase : int or str
        Index or name of the phase.

    Returns
    -------
    Reintegration
        The motion, and its deviation from the plan's states.

    Raises
    ------
    InvalidData
        The plan does not fit the problem, or the phase does not exist.
    """
    phases = courses(getattr(problem, "definition", problem), plan)
    names = [course.phase.name for course in phases]
    if isinstance(phase, str) and phase in names:
        return integrate_anew(phases[names.index(phase)])
    if isinstance(phase, int) and -len(phases) <= phase < len(phases):
        return integrate_anew(phases[phase])
    raise InvalidData(
        f"phase must be a number below {len(phases)} or one of "
        f"{', '.join(map(repr, names))}, got {show(phase)}",
        field="phase",
    )


def verify_control(definition: Definition, plan: ControlPlan, tolerance: float) -> Verification:
    """Return the objective and every constraint of a problem, evaluated on `plan`.

    Parameters
    ----------
    definition : Definition
        Definition of the problem.
    plan : ControlPlan
        States, controls, times and parameters.
    tolerance : float
        Largest accepted violation, relative to the size of the bounded value: the bound, the
        declared scale (capped at 1 for a state, control or parameter), or the range of the state.

    Returns
    -------
    Verification
        One check per kind of constraint.

    Raises
    ------
    InvalidData
        The phases, names or parameters of the plan differ from those of the problem, or a value is
        not finite.
    """
    check_tolerance(tolerance)
    phases = courses(definition, plan)
    with np.errstate(all="ignore"):
        motions = [integrate_anew(check) for check in phases]
        ends = endpoint(phases)
        objective, boundary = _at_ends(definition, ends, phases[0].parameters)
        sizes = sizes_at(definition, phases, ends, guessed=False)
        kinds: list[tuple[str, Iterable[_Violation]]] = [
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
        checks = [_check(name, list(violations), tolerance) for name, violations in kinds]
    return Verification(
        objective if np.isfinite(objective) else None, tuple(check for check in checks if check)
    )


def _check(name: str, items: list[_Violation], tolerance: float) -> Check | None:
    """Return the check of one kind over all phases; None without constraints of this kind."""
    if not items:
        return None
    checks = [
        Check.largest(
            name, item.worst, item.scale, item.unit, item.where, tolerance, equation=item.equation
        )
        for item in items
    ]
    return Check.worst_of(checks, checks[0])


def _labels(phases: tuple[Course, ...]) -> list[str]:
    """Return the suffix of a place that names each phase; empty for a single phase."""
    return [f" of phase {course.phase.name!r}" if len(phases) > 1 else "" for course in phases]


def _units(of: Phase | Definition, what: str) -> list[str]:
    return [part.unit for part in getattr(of, what) for _ in range(part.size)]


def _place(name: str, course: Course, time: float, label: str) -> str:
    """Return ``"x at t = 0.31 s of phase 'climb'"``, or the time alone for an empty name."""
    head = f"{name} at " if name else ""
    return f"{head}t = {time:.6g} {course.phase.time_unit}".rstrip() + label


# -- the motion --------------------------------------------------------------------------------------


def _motion(course: Course, reintegrated: Reintegration, label: str) -> _Violation:
    row, state, share = _largest(np.abs(reintegrated.deviation) / course.state_scale)
    place = _place(course.phase.state_names[state], course, reintegrated.times[row], label)
    if reintegrated.windows > 1:
        place += f", in {reintegrated.windows} windows"
    if reintegrated.failure:
        place += f": {reintegrated.failure}"
    scale = float(course.state_scale[state])
    unit = _units(course.phase, "states")[state]
    return _Violation(share * scale, scale, unit, place, course.phase.dynamics_equation)


def _continuity(course: Course, label: str) -> _Violation:
    grid = course.dense
    starts = np.flatnonzero(np.diff(grid.interval) > 0)
    unit = _units(course.phase, "states")
    if not starts.size:
        return _Violation(0.0, 1.0, unit[0], "")
    jumps = np.abs(grid.states[starts + 1] - grid.states[starts])
    row, state, share = _largest(jumps / course.state_scale)
    scale = float(course.state_scale[state])
    place = _place(course.phase.state_names[state], course, grid.times[starts[row]], label)
    return _Violation(share * scale, scale, unit[state], place)


def _invariants(
    phases: tuple[Course, ...], motions: list[Reintegration]
) -> Iterator[tuple[str, list[_Violation]]]:
    """Yield the drift of each invariant along the plan's states and along the re-integrated ones."""
    for course, label, reintegrated in zip(phases, _labels(phases), motions, strict=True):
        if not course.phase.invariants:
            continue
        tables = (course.dense_values, course.values(reintegrated.at, reintegrated.states))
        begin = tables[0]["invariant"][0]
        start = 0
        for invariant in course.phase.invariants:
            entries = slice(start, start + invariant.size)
            start += invariant.size
            scale = np.maximum(invariant.scale, np.abs(begin[entries]))
            items = []
            grids = (course.dense.times, ""), (reintegrated.times, " (integrated)")
            for table, (times, whose) in zip(tables, grids, strict=True):
                drift = np.abs(table["invariant"][:, entries] - begin[entries])
                row, entry, share = _largest(drift / scale)
                place = _place(_entry(invariant, entry), course, times[row], label) + whose
                size = float(scale[entry])
                items.append(
                    _Violation(share * size, size, invariant.unit, place, invariant.equation)
                )
            yield invariant.name, items


# -- at every instant --------------------------------------------------------------------------------


def _entry(restriction: Restriction, entry: int) -> str:
    return f"entry {entry}" if restriction.size > 1 else ""


def _bounds(phases: tuple[Course, ...], what: str) -> Iterator[_Violation]:
    """Yield the largest violation of the bounds of states or controls, also between the nodes."""
    for course, label in zip(phases, _labels(phases), strict=True):
        sides = _Sides(*course.phase.bounds(what), getattr(course.sizes, what), near=NEAR)
        if not sides.entry.size:
            continue
        worst = course.largest(
            lambda instants, sides=sides: sides(getattr(instants, what)),  # type: ignore[misc]
            sides(getattr(course.dense, what)),
        )
        entry = int(sides.entry[worst.entry])
        names = course.phase.state_names if what == "states" else course.phase.control_names
        place = _place(names[entry], course, worst.time, label)
        yield sides.violation(
            worst.value, worst.entry, _units(course.phase, what)[entry], place, ""
        )


def _paths(phases: tuple[Course, ...]) -> Iterator[tuple[str, list[_Violation]]]:
    """Yield the largest violation of each path constraint, also between the nodes."""
    for course, label in zip(phases, _labels(phases), strict=True):
        begin = 0
        for restriction in course.phase.paths:
            entries = slice(begin, begin + restriction.size)
            sides = _Sides(restriction.lower, restriction.upper, course.sizes.paths[entries])
            begin += restriction.size
            if not sides.entry.size:
                continue
            worst = course.largest(
                _on_path(course, sides, entries), sides(course.dense_values["path"][:, entries])
            )
            place = _place(
                _entry(restriction, int(sides.entry[worst.entry])), course, worst.time, label
            )
            yield (
                restriction.name,
                [
                    sides.violation(
                        worst.value, worst.entry, restriction.unit, place, restriction.equation
                    )
                ],
            )


def _on_path(course: Course, sides: _Sides, entries: slice) -> Callable[[Instants], Floats]:
    return lambda at: sides(course.values(at)["path"][:, entries])


# -- at the ends -------------------------------------------------------------------------------------


def _times(phases: tuple[Course, ...]) -> Iterator[_Violation]:
    for course, label in zip(phases, _labels(phases), strict=True):
        phase, plan = course.phase, course.plan
        sides = _Sides(
            np.array([phase.start_lower, phase.end_lower]),
            np.array([phase.start_upper, phase.end_upper]),
            np.full(2, plan.duration),
        )
        # The plan reproduces a fixed time up to rounding, however long the phase is.
        fixed = [phase.start_lower == phase.start_upper, phase.end_lower == phase.end_upper]
        sides.scale[np.array(fixed)[sides.entry]] = FIXED * max(
            plan.duration, abs(plan.start), abs(plan.end)
        )
        places = f"start{label}", f"end{label}"
        yield from sides.worst(np.array([plan.start, plan.end]), [phase.time_unit] * 2, places)


def _ends(
    phases: tuple[Course, ...], motions: list[Reintegration], end: int
) -> Iterator[_Violation]:
    """Yield the largest violation of the states at one end, relative to the size of the motion."""
    for course, label, reintegrated in zip(phases, _labels(phases), motions, strict=True):
        word = ("initial", "final")[end]
        sides = _Sides(*course.phase.bounds("states", word), course.state_scale)
        values = [(course.dense.states[-end], "")]
        if end and reintegrated.windows == 1:
            values.append((reintegrated.states[-1], " (integrated)"))
        time = (course.plan.start, course.plan.end)[end]
        places = [_place(name, course, time, label) for name in course.phase.state_names]
        for state, whose in values:
            labelled = [place + whose for place in places]
            yield from sides.worst(state, _units(course.phase, "states"), labelled)


def _at_ends(definition: Definition, ends: Floats, parameters: Floats) -> tuple[float, Floats]:
    """Return the objective and the boundary constraints."""
    objective, boundary = definition.endpoint(ends, parameters)
    return float(objective), boundary.full().ravel()


def _boundaries(
    definition: Definition, values: Floats, scale: Floats
) -> Iterator[tuple[str, list[_Violation]]]:
    begin = 0
    for boundary in definition.boundaries:
        sides = _Sides(boundary.lower, boundary.upper, scale[begin : begin + boundary.size])
        part, places = (
            values[begin : begin + boundary.size],
            [_entry(boundary, k) for k in range(boundary.size)],
        )
        begin += boundary.size
        yield (
            boundary.name,
            sides.worst(part, [boundary.unit] * boundary.size, places, boundary.equation),
        )


def _objective(
    definition: Definition,
    phases: tuple[Course, ...],
    motions: list[Reintegration],
    objective: float,
    scale: float,
) -> Iterator[_Violation]:
    """Yield the difference between the objective and that of the re-integrated motion, if integrated in one window."""
    if any(item.windows > 1 for item in motions):
        return
    ends = endpoint(phases, [(item.states[-1], item.integrals) for item in motions])
    recomputed, _ = _at_ends(definition, ends, phases[0].parameters)
    unit = definition.objective_unit
    where = f"the integrated motion, where it is {recomputed:.10g}"
    yield _Violation(abs(recomputed - objective), scale, unit, where)
