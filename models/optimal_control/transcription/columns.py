"""Columns of a program from guesses and plans, and plans from columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ..definition import entry_slices
from ..plan import ControlPlan, PhasePlan, Piecewise
from ..sampling import courses
from .assembly import functions_of
from .layout import Layout

__all__ = ["guessed_columns", "interpolate", "sample"]

Floats = NDArray[np.float64]

#: Distance before a knot, relative to the phase, at which a control is evaluated from the left.
LEFT = 1e-13


def guessed_columns(layout: Layout) -> Floats:
    """Return the columns of the declared guess."""
    columns = np.zeros(layout.size)
    for part in layout.phases:
        guess = part.phase.guess
        for table, places, fractions in (
            (guess.states, part.state_columns, part.point_fractions),
            (guess.controls, part.control_columns, part.visit_places[0][part.owners]),
        ):
            for k in range(table.shape[1]):
                columns[places[k]] = np.interp(fractions, guess.fractions, table[:, k])
        columns[part.time_columns] = guess.start, guess.end
    columns[layout.parameter_columns] = layout.definition.stacked("parameters", "initial_lower")
    return _with_integrals(layout, columns)


def sample(layout: Layout, plan: ControlPlan) -> Floats:
    """Return the columns that sample `plan`, which satisfies the rows up to the mesh's resolution."""
    columns = np.zeros(layout.size)
    for part, course in zip(layout.phases, courses(layout.definition, plan), strict=True):
        own = course.plan
        times = own.start + part.point_fractions * own.duration
        columns[part.state_columns] = own.states(np.minimum(times, own.end)).T
        times = own.start + part.visit_places[0][part.owners] * own.duration
        # At a collocated end, take the control of this interval, not that of the next.
        ends = part.visit_ends[part.owners]
        times = np.clip(times - np.where(ends, LEFT * own.duration, 0.0), own.start, own.end)
        columns[part.control_columns] = own.controls(times).T
        if part.mesh.linear:
            part.fit_lines(columns, own)
        columns[part.time_columns] = own.start, own.end
    for item, places in entry_slices(layout.definition.parameters):
        columns[layout.parameter_columns[places]] = plan.parameters[item.name]
    return _with_integrals(layout, columns)


def interpolate(layout: Layout, point: Floats) -> ControlPlan:
    """Return the plan with the polynomials that the columns represent."""
    columns = np.asarray(point, float)
    phases = []
    for number, part in enumerate(layout.phases):
        t0, tf = columns[part.time_columns]
        if not tf > t0:
            raise InvalidData(
                f"phase {part.phase.name!r}: its end {tf:g} is not after its start {t0:g}",
                field="time",
            )
        knots = t0 + part.mesh.fractions * (tf - t0)
        knots[-1] = tf
        phase, schemes = part.phase, part.schemes
        nodes = tuple(scheme.plan_points for scheme in schemes)
        x, rates = columns[part.state_columns].T, None
        if any(scheme.from_rates.any() for scheme in schemes):
            rates = _visited(layout, columns, number)[: part.nx].T
        states = Piecewise(knots, nodes, tuple(part.state_tables(x, rates)))
        values = columns[part.control_columns][:, part.visit_control].T
        controls = Piecewise(
            knots,
            tuple(scheme.control_points for scheme in schemes),
            tuple(np.split(values, part.visit_starts[1:-1])),
            *phase.bounds("controls"),
        )
        names = phase.state_names, phase.control_names
        phases.append(PhasePlan(phase.name, states, controls, *names))
    parameters = {
        item.name: columns[layout.parameter_columns[places]]
        for item, places in entry_slices(layout.definition.parameters)
    }
    return ControlPlan(tuple(phases), parameters).attached(layout.definition)


def _with_integrals(layout: Layout, columns: Floats) -> Floats:
    """Return `columns` with the integrals and interior states that its states and controls define."""
    for number, part in enumerate(layout.phases):
        rates = any(of_rates.any() for *_, of_rates in part.instants)
        if part.phase.integrals or rates:
            values = _visited(layout, columns, number)
        for at, instant in zip(part.instant_columns, part.instants, strict=True):
            points, visits, of_states, of_rates = instant
            columns[at] = columns[part.state_columns[:, points]] @ of_states
            if of_rates.any():
                columns[at] += values[: part.nx, visits] @ of_rates
        if part.phase.integrals:
            weights = np.concatenate([scheme.weights for scheme in part.schemes])
            integrals = values[part.nx : part.nx + part.phase.integrals] @ weights
            columns[part.integral_columns] = np.where(np.isfinite(integrals), integrals, 0.0)
    return columns


def _visited(layout: Layout, columns: Floats, number: int) -> Floats:
    """Return the values of a phase's node functions at every visit, shape (entries, visits)."""
    part, arguments = layout.phases[number], columns[layout.visit_columns(number)]
    function = functions_of(layout.definition).nodes[number].value.map(part.visits)
    return np.array(function(arguments, part.visit_places), float)
