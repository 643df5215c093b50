"""Where the search for an optimal control starts: samples, functions or another answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import show
from ..definition import Guess, Quantity
from ..plan import EDGE, ControlPlan, PhasePlan
from .terms import middle, numbers

__all__ = ["draw_lines", "read_guess"]

Floats = NDArray[np.float64]

#: Samples that are taken of a function or of another answer.
SAMPLES = 201


class Guessed(Protocol):
    """What a guess must know of a phase: its quantities, and the bounds of its two times."""

    name: str
    bounds: tuple[float, float, float, float]
    states: dict[str, Quantity]
    controls: dict[str, Quantity]


def read_guess(
    phase: Guessed,
    plan: Any,
    time: Any,
    values: Mapping[str, Any],
    before: Mapping[str, Any],
) -> dict[str, Any]:
    """Return ``{"time": (start, end), name: (fractions, table)}`` from what a user guesses.

    Functions of time stay functions under their name until the phase's times are known.
    """
    found = dict(before)
    if plan is not None:
        found.update(_take_over(phase, plan))
    begin = found.get("time")
    fractions: Floats | None = None
    if time is not None:
        grid = _read_times(phase, time)
        begin = (float(grid[0]), float(grid[-1]))
        fractions = (grid - grid[0]) / (grid[-1] - grid[0])
    if begin is not None:
        found["time"] = begin
    for name, value in values.items():
        quantity = phase.states.get(name) or phase.controls.get(name)
        if quantity is None:
            known = ", ".join(map(repr, [*phase.states, *phase.controls]))
            raise InvalidData(
                f"guess of {name!r}: phase {phase.name!r} has the states and controls {known}",
                field=name,
            )
        if callable(value):
            found[name] = value
            continue
        found[name] = _table(name, value, quantity.size, fractions)
    return found


def _read_times(phase: Guessed, time: Any) -> Floats:
    """Return the times of samples, which begin and end when the phase may."""
    wanted = "finite, increasing times"
    grid = numbers("time of a guess", time, wanted)
    increasing = grid.ndim == 1 and grid.size >= 2 and np.isfinite(grid).all()
    if not increasing or not (np.diff(grid) > 0).all():
        raise InvalidData(f"time of a guess must be {wanted}, got {show(time)}", field="time")
    for what, t, (low, high) in (
        ("begin", grid[0], phase.bounds[:2]),
        ("end", grid[-1], phase.bounds[2:]),
    ):
        slack = EDGE * max(1.0, abs(low), abs(high))
        if not low - slack <= t <= high + slack:
            raise InvalidData(
                f"time of a guess must {what} in [{low:g}, {high:g}], as phase {phase.name!r} does, "
                f"got {t:g}",
                field="time",
            )
    return grid


def _table(name: str, value: Any, size: int, fractions: Floats | None) -> tuple[Floats, Floats]:
    table = numbers(f"guess of {name!r}", value, "numbers or a function of time")
    if not np.isfinite(table).all():
        raise InvalidData(f"guess of {name!r} must be finite, got {show(value)}", field=name)
    if table.ndim == 0 or (table.ndim == 1 and size > 1 and table.size == size):
        return np.array([0.0, 1.0]), np.broadcast_to(table, (2, size)).copy()
    if table.ndim == 1 and size == 1:
        table = table[:, None]
    if table.ndim != 2 or table.shape[1] != size or table.shape[0] < 2:
        raise InvalidData(
            f"guess of {name!r} must be one value, or samples of shape (samples, {size}), got shape "
            f"{np.shape(value)}",
            field=name,
        )
    places = np.linspace(0.0, 1.0, len(table)) if fractions is None else fractions
    if len(places) != len(table):
        raise InvalidData(
            f"guess of {name!r} has {len(table)} samples for {len(places)} times", field=name
        )
    return places, table


def _take_over(phase: Guessed, value: Any) -> dict[str, Any]:
    plan = getattr(value, "plan", value)
    if isinstance(plan, ControlPlan):
        names = [one.name for one in plan.phases]
        if phase.name not in names and len(names) > 1:
            raise InvalidData(
                f"guess of phase {phase.name!r}: the plan has the phases "
                f"{', '.join(map(repr, names))}; give one of them",
                field="guess",
            )
        plan = plan.phase(phase.name) if phase.name in names else plan.phases[0]
    if not isinstance(plan, PhasePlan):
        raise InvalidData(
            f"a guess must be a plan or a solution that has one, got {show(value)}", field="guess"
        )
    places = np.linspace(0.0, 1.0, SAMPLES)
    grid = plan.start + places * plan.duration
    found: dict[str, Any] = {"time": (plan.start, plan.end)}
    for part, names_of in ((plan.states, plan.state_names), (plan.controls, plan.control_names)):
        table = part(np.clip(grid, plan.start, plan.end))
        for name, quantity in {**phase.states, **phase.controls}.items():
            entries = [
                k for k, one in enumerate(names_of) if one == name or one.startswith(f"{name}[")
            ]
            if len(entries) == quantity.size:
                found[name] = (places, table[:, entries])
    if len(found) == 1:
        known = ", ".join(map(repr, [*plan.state_names, *plan.control_names]))
        raise InvalidData(
            f"guess of phase {phase.name!r}: the plan has {known}, none of which the phase knows in "
            "that size",
            field="guess",
        )
    return found


def draw_lines(phase: Guessed, given: Mapping[str, Any]) -> Guess:
    """Return the guess of a phase: what was given, and straight lines for the rest.

    A state goes from its initial to its final value where they are fixed; a value that is free is
    the other end's, or the middle of its bounds, or 0 moved into them.
    """
    start_lower, start_upper, end_lower, end_upper = phase.bounds
    start, end = 0.0, 0.5 * (end_lower + end_upper)
    if "time" in given:
        start, end = given["time"]
    start = float(np.clip(start, start_lower, start_upper))
    end = float(np.clip(end, end_lower, end_upper))
    if not end > start:
        end = start + 0.5 * (end_upper - start)
    places = {0.0, 1.0}
    for name, value in given.items():
        if name != "time":
            many = np.linspace(0.0, 1.0, SAMPLES) if callable(value) else value[0]
            places.update(many.tolist())
    fractions = np.array(sorted(places))
    tables: dict[str, list[Floats]] = {"states": [], "controls": []}
    for what in ("states", "controls"):
        for quantity in getattr(phase, what).values():
            value = given.get(quantity.name)
            if value is None:
                ends = _ends(quantity)
                table = ends[0] + fractions[:, None] * (ends[1] - ends[0])
            elif callable(value):
                table = _sample(
                    quantity.name, value, start + fractions * (end - start), quantity.size
                )
            else:
                own, samples = value
                table = np.stack(
                    [np.interp(fractions, own, samples[:, k]) for k in range(quantity.size)], axis=1
                )
            tables[what].append(table)
    empty = np.empty((fractions.size, 0))
    return Guess(
        start,
        end,
        fractions,
        np.concatenate([*tables["states"], empty], axis=1),
        np.concatenate([*tables["controls"], empty], axis=1),
    )


def _sample(name: str, function: Any, times: Floats, size: int) -> Floats:
    rows = []
    for t in times.tolist():
        try:
            value = function(t)
        except Exception as error:
            raise InvalidData(
                f"guess of {name!r} fails at t = {t:g}: {type(error).__name__}: {error}", field=name
            ) from error
        wanted = f"return {size} finite number{'s' * (size > 1)} at every time"
        row = numbers(f"guess of {name!r}", value, wanted, "must").reshape(-1)
        if row.size != size or not np.isfinite(row).all():
            raise InvalidData(
                f"guess of {name!r} must {wanted}, got {show(value)} at t = {t:g}", field=name
            )
        rows.append(row)
    return np.array(rows)


def _ends(one: Quantity) -> tuple[Floats, Floats]:
    """Return the values at both ends: a fixed one, else the other end's, else the middle of bounds."""
    inside = middle(one.lower, one.upper)
    first, last = one.initial_lower == one.initial_upper, one.final_lower == one.final_upper
    begin = np.where(first, one.initial_lower, np.where(last, one.final_lower, inside))
    end = np.where(last, one.final_lower, np.where(first, one.initial_lower, inside))
    return (
        np.clip(begin, one.initial_lower, one.initial_upper),
        np.clip(end, one.final_lower, one.final_upper),
    )
