"""Verification of a plan for an optimal control problem from the declared functions alone.

It shares no code with the transcriptions. The motion is re-integrated with the plan's control, bounds
and path constraints are checked between the nodes, and integrals are computed by quadrature.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from ..verification import Check, Verification, check_tolerance
from .algebraic import algebraic_entries, solved_controls
from .definition import Definition, Restriction, entry_slices, entry_units
from .integration import Reintegration, integrate_anew
from .plan import ControlPlan
from .sampling import Course, Extreme, courses, endpoint
from .sizes import along, sizes_at

__all__ = ["motion", "verify_control"]

Floats = NDArray[np.float64]


#: Smallest ratio of a bound to the size of its state or control at which the bound is the scale.
NEAR = 0.1
#: Scale of a fixed time relative to the times of its phase, which admits rounding only.
FIXED = 1e-5


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

    def checks(
        self, name: str, values: Floats, units: Sequence[str], places: Sequence[str],
        tolerance: float, equation: str = "",
    ) -> list[Check]:  # fmt: skip
        """Return the check of `values`, shape (entries,); an empty list without bounds."""
        if not self.entry.size:
            return []
        check = Check.largest(
            name, self(values) * self.scale, self.scale, lambda side: units[int(self.entry[side])],
            lambda side: places[int(self.entry[side])], tolerance, equation=equation,
        )  # fmt: skip
        return [check]

    def check(
        self, name: str, worst: Extreme, unit: str, where: str, tolerance: float, equation: str = ""
    ) -> Check:
        """Return the check of the largest relative excess over time."""
        scale = self.scale[worst.entry]
        return Check.largest(
            name, worst.value * scale, scale, unit, where, tolerance, equation=equation
        )


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

    A tolerance is relative to the size of the bounded value: the bound, the declared scale (capped at 1
    for a state, control or parameter), or the range of the state. Plans whose phases, names or
    parameters differ from those of the problem raise ``InvalidData``.
    """
    check_tolerance(tolerance)
    phases = courses(definition, plan)
    with np.errstate(all="ignore"):
        motions = [integrate_anew(check) for check in phases]
        ends = endpoint(phases)
        objective, boundary = _at_ends(definition, ends, phases[0].parameters)
        again = None
        if all(item.windows == 1 for item in motions):
            moved = endpoint(phases, [(item.states, item.integrals) for item in motions])
            again = _at_ends(definition, moved, phases[0].parameters)
        sizes = sizes_at(definition, phases, ends, guessed=False)
        parameters = phases[0].parameters
        sides = _Sides(
            *definition.bounds("parameters"), along(definition.parameters, parameters[None])
        )
        named = list(zip(phases, _labels(phases), strict=True))
        groups: list[list[Check]] = [
            [_motion(*pair, entry, tolerance) for pair, entry in zip(named, motions, strict=True)],
            [_continuity(*pair, tolerance) for pair in named],
            [check for pair in named for check in _times(*pair, tolerance)],
            *(
                [
                    check
                    for pair, entry in zip(named, motions, strict=True)
                    for check in _ends(*pair, entry, end, tolerance)
                ]
                for end in (0, 1)
            ),
            *([*_bounds(named, what, tolerance)] for what in ("states", "controls")),
            sides.checks(
                "bounds of parameters", parameters, entry_units(definition.parameters),
                definition.parameter_names, tolerance,
            ),
            *([check] for pair in named for check in _paths(*pair, tolerance)),
            [check for pair in named for check in _algebraic(*pair, tolerance)],
            *_boundaries(definition, boundary, again, sizes.boundaries, tolerance),
            *(
                checks
                for pair, entry in zip(named, motions, strict=True)
                for checks in _invariants(*pair, entry, tolerance)
            ),
            _objective(definition, objective, again, sizes.objective, tolerance),
        ]  # fmt: skip
    return Verification(
        objective if np.isfinite(objective) else None,
        tuple(Check.worst_of(checks, checks[0]) for checks in groups if checks),
    )


def _labels(phases: tuple[Course, ...]) -> list[str]:
    """Return the suffix of a place that names each phase; empty for a single phase."""
    return [f" of phase {course.phase.name!r}" if len(phases) > 1 else "" for course in phases]


def _place(name: str, course: Course, time: float, label: str) -> str:
    """Return ``"x at t = 0.31 s of phase 'climb'"``, or the time alone for an empty name."""
    head = f"{name} at " if name else ""
    return f"{head}t = {time:.6g} {course.phase.time_unit}".rstrip() + label


# -- the motion --------------------------------------------------------------------------------------


def _motion(course: Course, label: str, reintegrated: Reintegration, tolerance: float) -> Check:
    units = entry_units(course.phase.states)

    def place(row: int, state: int) -> str:
        text = _place(course.phase.state_names[state], course, reintegrated.times[row], label)
        if reintegrated.windows > 1:
            text += f", in {reintegrated.windows} windows"
        return text + (f": {reintegrated.failure}" if reintegrated.failure else "")

    return Check.largest(
        "motion", np.abs(reintegrated.deviation), course.sizes.states,
        lambda row, state: units[state], place, tolerance, equation=course.phase.dynamics_equation,
    )  # fmt: skip


def _continuity(course: Course, label: str, tolerance: float) -> Check:
    grid, units, name = course.dense, entry_units(course.phase.states), "continuity of states"
    starts = np.flatnonzero(np.diff(grid.interval) > 0)
    if not starts.size:
        return Check.largest(name, [], 1.0, units[0], "", tolerance)

    def place(row: int, state: int) -> str:
        return _place(course.phase.state_names[state], course, grid.times[starts[row]], label)

    jumps = np.abs(grid.states[starts + 1] - grid.states[starts])
    return Check.largest(
        name, jumps, course.sizes.states, lambda row, state: units[state], place, tolerance
    )


def _invariants(
    course: Course, label: str, reintegrated: Reintegration, tolerance: float
) -> Iterator[list[Check]]:
    """Yield the drift of each invariant along the plan's states and along the re-integrated ones."""
    if not course.phase.invariants:
        return
    tables = (course.dense_values, course.values(reintegrated.at, reintegrated.states))
    grids = (course.dense.times, ""), (reintegrated.times, " (integrated)")
    begin = tables[0]["invariant"][0]
    for invariant, entries in entry_slices(course.phase.invariants):
        scale = np.maximum(invariant.scale, np.abs(begin[entries]))
        checks = []
        for table, (times, whose) in zip(tables, grids, strict=True):

            def place(
                row: int, entry: int, times: Floats = times, whose: str = whose,
                invariant: Restriction = invariant,
            ) -> str:  # fmt: skip
                return _place(_entry(invariant, entry), course, times[row], label) + whose

            drift = np.abs(table["invariant"][:, entries] - begin[entries])
            checks.append(
                Check.largest(
                    invariant.name, drift, scale, invariant.unit, place, tolerance,
                    equation=invariant.equation,
                )
            )  # fmt: skip
        yield checks


# -- at every instant --------------------------------------------------------------------------------


def _entry(restriction: Restriction, entry: int) -> str:
    return f"entry {entry}" if restriction.size > 1 else ""


def _bounds(named: list[tuple[Course, str]], what: str, tolerance: float) -> Iterator[Check]:
    """Yield the check of the bounds of states or controls per phase, also between the nodes."""
    for course, label in named:
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
        unit = entry_units(getattr(course.phase, what))[entry]
        yield sides.check(f"bounds of {what}", worst, unit, place, tolerance)


def _paths(course: Course, label: str, tolerance: float) -> Iterator[Check]:
    """Yield the check of each path constraint, also between the nodes."""
    for restriction, entries in entry_slices(course.phase.paths):
        sides = _Sides(restriction.lower, restriction.upper, course.sizes.paths[entries])
        if not sides.entry.size:
            continue
        worst = course.largest(
            lambda at, sides=sides, part=entries: sides(course.values(at)["path"][:, part]),  # type: ignore[misc]
            sides(course.dense_values["path"][:, entries]),
        )
        name = _entry(restriction, int(sides.entry[worst.entry]))
        place = _place(name, course, worst.time, label)
        yield sides.check(
            restriction.name, worst, restriction.unit, place, tolerance, restriction.equation
        )


def _algebraic(course: Course, label: str, tolerance: float) -> Iterator[Check]:
    """Yield the check of algebraic variables against the solution of their equations.

    The first instant of the grid is the start, at which initial values must be consistent.
    """
    entries, solved = algebraic_entries(course.phase.controls), solved_controls(course.phase)
    if solved is None:
        return
    grid, units = course.dense, entry_units(course.phase.controls)

    def place(row: int, k: int) -> str:
        return _place(course.phase.control_names[entries[k]], course, grid.times[row], label)

    solution = solved(grid.times[None, :], grid.states.T, grid.controls.T, course.parameters)
    off = (solution.full().T - grid.controls)[:, entries]
    yield Check.largest(
        "algebraic variables", np.abs(off), course.sizes.controls[entries],
        lambda row, k: units[entries[k]], place, tolerance,
    )  # fmt: skip


# -- at the ends -------------------------------------------------------------------------------------


def _times(course: Course, label: str, tolerance: float) -> list[Check]:
    phase, plan = course.phase, course.plan
    sides = _Sides(
        np.array([phase.start_lower, phase.end_lower]),
        np.array([phase.start_upper, phase.end_upper]),
        np.full(2, plan.duration),
    )
    # The plan reproduces a fixed time up to rounding, however long the phase is.
    fixed = [phase.start_lower == phase.start_upper, phase.end_lower == phase.end_upper]
    size = max(plan.duration, abs(plan.start), abs(plan.end))
    sides.scale[np.array(fixed)[sides.entry]] = FIXED * size
    places = f"start{label}", f"end{label}"
    times = np.array([plan.start, plan.end])
    return sides.checks("times", times, [phase.time_unit] * 2, places, tolerance)


def _ends(
    course: Course, label: str, reintegrated: Reintegration, end: int, tolerance: float
) -> Iterator[Check]:
    """Yield the checks of the states at one end, relative to the size of the motion."""
    word = ("initial", "final")[end]
    sides = _Sides(*course.phase.bounds("states", word), course.sizes.states)
    values = [(course.dense.states[-end], "")]
    if end and reintegrated.windows == 1:
        values.append((reintegrated.states[-1], " (integrated)"))
    time = (course.plan.start, course.plan.end)[end]
    units = entry_units(course.phase.states)
    for state, whose in values:
        places = [_place(name, course, time, label) + whose for name in course.phase.state_names]
        yield from sides.checks(f"{word} values", state, units, places, tolerance)


def _at_ends(definition: Definition, ends: Floats, parameters: Floats) -> tuple[float, Floats]:
    """Return the objective and the boundary constraints."""
    objective, boundary = definition.endpoint(ends, parameters)
    return float(objective), boundary.full().ravel()


def _boundaries(
    definition: Definition, values: Floats, again: tuple[float, Floats] | None, scale: Floats,
    tolerance: float,
) -> Iterator[list[Check]]:  # fmt: skip
    """Yield the checks of each boundary constraint.

    Constraints at interior instants are also checked with the values `again` of the integrated motion.
    """
    rows, columns = map(np.array, definition.endpoint.jac_sparsity(1, 0).get_triplet())
    inner = set(rows[definition.interior[columns.astype(int)]].tolist())
    for boundary, part in entry_slices(definition.boundaries):
        sides = _Sides(boundary.lower, boundary.upper, scale[part])
        places = [_entry(boundary, k) for k in range(boundary.size)]
        units = [boundary.unit] * boundary.size
        found = [(values, "")]
        if again is not None and inner & set(range(part.start, part.stop)):
            found.append((again[1], "(integrated)"))
        checks = []
        for table, whose in found:
            named = [f"{place} {whose}".strip() for place in places]
            checks += sides.checks(
                boundary.name, table[part], units, named, tolerance, boundary.equation
            )
        yield checks


def _objective(
    definition: Definition, objective: float, again: tuple[float, Floats] | None, scale: float,
    tolerance: float,
) -> list[Check]:  # fmt: skip
    """Return the check of the objective against that of the motion, if integrated in one window."""
    if again is None:
        return []
    recomputed, _ = again
    where = f"the integrated motion, where it is {recomputed:.10g}"
    off, unit = abs(recomputed - objective), definition.objective_unit
    return [Check.largest("objective", off, scale, unit, where, tolerance)]
