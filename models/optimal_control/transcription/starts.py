"""Random starts for a search: a guess with random waves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..definition import Definition, Phase
from ..plan import ControlPlan, PhasePlan, Piecewise

__all__ = ["draw_start"]

Floats = NDArray[np.float64]

#: Amplitude of the waves, relative to a quantity's range.
STRAY = 0.4
#: Number of waves of a random start.
WAVES = 4


def draw_start(definition: Definition, guess: ControlPlan, seed: int) -> ControlPlan:
    """Return `guess` with smooth random waves; the values of states at both ends are kept.

    Waves of a control do not have to vanish at its ends. Free end times are scaled at random.
    """
    draw = np.random.default_rng(seed)
    phases = []
    for phase, part in zip(definition.phases, guess.phases, strict=True):
        start, end = _times(phase, part, draw)
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


def _times(phase: Phase, part: PhasePlan, draw: np.random.Generator) -> tuple[float, float]:
    stretch = float(np.exp(draw.uniform(-0.5, 0.5)))
    start = part.start
    end = float(np.clip(start + stretch * part.duration, phase.end_lower, phase.end_upper))
    return (start, end) if end > start else (part.start, part.end)
