"""Starts for a search: a guess with random waves, motions with random controls, and other meshes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..definition import Definition, Phase
from ..plan import ControlPlan, PhasePlan, Piecewise
from .mesh import DEGREE, LINEAR, UNIFORM, Mesh, even
from .refinement import Rules

__all__ = ["coarse_mesh", "draw_flight", "draw_start", "other_meshes"]

Floats = NDArray[np.float64]

#: Intervals and degree of the mesh on which many starts are compared.
COARSE = 8, 3
#: Amplitude of the waves, relative to a quantity's range.
STRAY = 0.4
#: Number of waves of a random start.
WAVES = 4
#: Range of the random factor of a free duration, as a power of e: of starts with waves, and of motions.
STRETCH, FLIGHT_STRETCH = (-0.5, 0.5), (-1.5, 1.0)
#: Steps of a motion, number of its pieces with constant controls, and largest state in units of its size.
STEPS, PIECES, BEYOND = 24, 4, 1e3


def coarse_mesh(rules: Rules) -> Mesh:
    """Return the mesh on which many starts are compared, for a scheme with these rules."""
    intervals, degree = COARSE
    if not rules.split:
        return even(1, intervals * degree)
    fixed = rules.fixed_degree
    return even(intervals, degree) if fixed is None else even(intervals * degree, fixed)


def other_meshes(scheme: Any, formulation: Any) -> Iterator[tuple[str, Any]]:
    """Yield labels and formulations of `scheme` on uniform meshes, that with linear controls three times.

    It is solved from the guess, and if no plan verifies once more from the best plan: at once or at the end.
    """
    model, same = formulation.model, {"dependent": formulation.dependent}
    first, name = formulation._start, scheme.name
    linear = scheme(model, *LINEAR, **same)
    meshes = tuple(Mesh(m.fractions, m.degrees, m.degrees > 0, True) for m in linear.meshes)
    label = f"{name} {LINEAR[0]}x{LINEAR[1]}, linear controls"
    restricted = label, linear._with(_meshes=meshes, _start=first)
    for place, (intervals, seed) in enumerate(UNIFORM):
        other = scheme(model, intervals, DEGREE, **same)._with(_start=first)
        label = f"{name} {intervals}x{DEGREE}"
        yield (f"{label}, seed {seed}", other.started(seed)) if seed else (label, other)
        yield from () if place else (restricted, restricted)
    yield restricted


def draw_start(definition: Definition, guess: ControlPlan, seed: int) -> ControlPlan:
    """Return `guess` with smooth random waves; the values of states at both ends are kept.

    Waves of a control do not have to vanish at its ends. Free end times are scaled at random.
    """
    draw = np.random.default_rng(seed)
    phases = []
    for phase, part in zip(definition.phases, guess.phases, strict=True):
        start, end = _times(phase, part, draw, STRETCH)
        knots = start + (part.states.knots - part.start) * (end - start) / part.duration
        knots[-1] = end
        parts = []
        for what, source in (("states", part.states), ("controls", part.controls)):
            low, high = phase.bounds(what)
            scale = phase.stacked(what, "scale")
            both = np.isfinite(low) & np.isfinite(high)
            with np.errstate(invalid="ignore"):
                reach = STRAY * np.where(both, high - low, 2.0 * scale)
            sines = draw.normal(size=(WAVES, source.size)) / np.arange(1, WAVES + 1)[:, None]
            cosines = draw.normal(size=(WAVES + 1, source.size))
            values = []
            for k, (positions, table) in enumerate(zip(source.nodes, source.values, strict=True)):
                begin, length = source.knots[k], source.knots[k + 1] - source.knots[k]
                f = (begin + 0.5 * (positions + 1.0) * length - part.start) / part.duration
                wave = np.sin(np.pi * np.outer(f, np.arange(1, WAVES + 1))) @ sines
                if what == "controls":
                    wave = np.cos(np.pi * np.outer(f, np.arange(WAVES + 1))) @ cosines
                values.append(np.clip(table + reach * wave, low, high))
            parts.append(Piecewise(knots, source.nodes, tuple(values), source.lower, source.upper))
        phases.append(
            PhasePlan(part.name, parts[0], parts[1], part.state_names, part.control_names)
        )
    return ControlPlan(tuple(phases), guess.parameters)


def draw_flight(definition: Definition, guess: ControlPlan, seed: int) -> ControlPlan:
    """Return the motions from the guessed initial states with random, piecewise constant controls.

    Controls are drawn between their bounds. The method of Runge and Kutta with few steps suffices for a
    start. States are clipped to their bounds, and keep their values when a step diverges.
    """
    draw = np.random.default_rng(seed)
    p = np.concatenate([*guess.parameters.values(), np.empty(0)])
    phases = []
    for phase, part in zip(definition.phases, guess.phases, strict=True):
        start, end = _times(phase, part, draw, FLIGHT_STRETCH)
        times, step = np.linspace(start, end, STEPS + 1), (end - start) / STEPS
        low, high = phase.bounds("controls")
        reach = 2.0 * phase.stacked("controls", "scale")
        middle = part.controls(np.array([part.start]))[0]
        least = np.where(np.isfinite(low), low, middle - reach)
        most = np.where(np.isfinite(high), high, middle + reach)
        pieces = draw.uniform(least, np.maximum(least, most), size=(PIECES, low.size))
        controls = np.repeat(pieces, STEPS // PIECES, axis=0)
        bounds = phase.bounds("states")
        largest = BEYOND * np.maximum(
            phase.stacked("states", "scale"), np.abs(part.states(part.states.knots)).max(axis=0)
        )

        def rate(t: float, x: Floats, u: Floats, function: Any = phase.function) -> Floats:
            return np.array(function(t, x, u, p)[0], float).reshape(-1)

        rows = [np.clip(part.states(np.array([part.start]))[0], *bounds)]
        for t, u in zip(times[:-1].tolist(), controls, strict=True):
            x, half = rows[-1], 0.5 * step
            k1 = rate(t, x, u)
            k2 = rate(t + half, x + half * k1, u)
            k3 = rate(t + half, x + half * k2, u)
            k4 = rate(t + step, x + step * k3, u)
            following = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            follows = np.isfinite(following).all() and (np.abs(following) <= largest).all()
            rows.append(np.clip(following, *bounds) if follows else x)
        ends = (np.array([-1.0, 1.0]),) * STEPS
        states = Piecewise(times, ends, tuple(np.stack(pair) for pair in pairwise(rows)))
        held = tuple(np.stack([u, u]) for u in controls)
        names = part.state_names, part.control_names
        phases.append(PhasePlan(part.name, states, Piecewise(times, ends, held, low, high), *names))
    return ControlPlan(tuple(phases), guess.parameters)


def _times(
    phase: Phase, part: PhasePlan, draw: np.random.Generator, powers: tuple[float, float]
) -> tuple[float, float]:
    """Return the times of a phase with a random end, drawn between these powers of e of its duration."""
    start, stretch = part.start, float(np.exp(draw.uniform(*powers)))
    end = float(np.clip(start + stretch * part.duration, phase.end_lower, phase.end_upper))
    return (start, end) if end > start else (part.start, part.end)
