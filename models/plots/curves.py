"""What pictures of controls are made of: curves, limits, panels and phases, and how plans become them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..optimal_control.plan import PhasePlan, Piecewise

__all__ = ["Curve", "Limit", "Panel", "Span", "nodes_of", "sampled"]

Floats = NDArray[np.float64]

#: Points of a curve an interval at the least, and in all about.
_FEWEST, _POINTS = 12, 2400


class Curve(NamedTuple):
    """One function of time.

    Parameters
    ----------
    name : str
        What it is called in the legend.
    colour : int
        Which of the colours it has.
    times, values : ndarray, shape (points,)
        The curve.
    node_times, nodes : ndarray, shape (nodes,)
        Dots on it: the nodes of the mesh.
    """

    name: str
    colour: int
    times: Floats
    values: Floats
    node_times: Floats = np.empty(0)
    nodes: Floats = np.empty(0)


class Limit(NamedTuple):
    """A bound that curves have for some time.

    Parameters
    ----------
    start, end : float
        When it holds.
    lower, upper : float
        The bound; infinite where there is none.
    colours : tuple of int
        The curves that it bounds; empty for all of the panel.
    tolerance : float
        By how much it may be exceeded before the worst place is ringed.
    kind : str
        ``"limit"``, beyond which is shaded; ``"reserve"``, of the actuator where a plan holds some in
        reserve; ``"paper"``, what the paper's controller kept to.
    """

    start: float
    end: float
    lower: float
    upper: float
    colours: tuple[int, ...] = ()
    tolerance: float = np.inf
    kind: str = "limit"


@dataclass(frozen=True, eq=False)
class Panel:
    """What one panel shows.

    Parameters
    ----------
    title, unit : str
        Label of the axis.
    curves : sequence of Curve
        What is drawn.
    limits : sequence of Limit
        What bounds it.
    log : bool
        Whether the values are drawn by their logarithm.
    whole : bool
        Whether every limit is in sight, however far away.
    shades : sequence of (float, float)
        Stretches of time that are marked, such as those in which an actuator is saturated.
    """

    title: str
    unit: str
    curves: Sequence[Curve]
    limits: Sequence[Limit] = ()
    log: bool = False
    whole: bool = False
    shades: Sequence[tuple[float, float]] = ()


class Span(NamedTuple):
    """A phase: its name, when it begins and ends, and the knots of its mesh."""

    name: str
    start: float
    end: float
    knots: Floats


def sampled(part: PhasePlan) -> tuple[Floats, Floats, Floats]:
    """Return times, states and controls of a phase for its curves; a knot comes twice."""
    count = part.states.intervals
    even = np.linspace(-1.0, 1.0, max(_FEWEST, _POINTS // count))
    times, states, controls = [], [], []
    for k in range(count):
        nodes = [part.states.nodes[k], part.controls.nodes[k]]
        places = np.unique(np.concatenate([even, *nodes]))
        begin, end = part.states.knots[k], part.states.knots[k + 1]
        times.append(begin + 0.5 * (places + 1.0) * (end - begin))
        states.append(part.states.on(k, places))
        controls.append(part.controls.on(k, places))
    return np.concatenate(times), np.concatenate(states), np.concatenate(controls)


def nodes_of(part: Piecewise) -> tuple[Floats, Floats]:
    """Return times and values of the nodes of a plan's functions, (nodes,) and (nodes, size)."""
    times = [
        part.knots[k] + 0.5 * (at + 1.0) * (part.knots[k + 1] - part.knots[k])
        for k, at in enumerate(part.nodes)
    ]
    values = [part.on(k, at) for k, at in enumerate(part.nodes)]
    return np.concatenate(times), np.concatenate(values)
