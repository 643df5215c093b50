"""Plans in closed form for several test modules."""

import itertools

import casadi
import numpy as np

from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.plan import Piecewise


def lobatto(count):
    """Return nodes that include both ends."""
    return -np.cos(np.linspace(0.0, np.pi, count)) if count > 1 else np.zeros(1)


def piecewise(knots, function, count, size, **limits):
    """Return functions sampled by interval; `function` may depend on the interval's midpoint."""
    nodes, values = lobatto(count), []
    for low, high in itertools.pairwise(knots):
        t = low + 0.5 * (nodes + 1.0) * (high - low)
        table = np.empty((count, size))
        for k, row in enumerate(function(t, 0.5 * (low + high))):
            table[:, k] = row
        values.append(table)
    return Piecewise(np.asarray(knots, float), (nodes,) * len(values), tuple(values), **limits)


def phase_plan(knots, states, controls=(), costates=None, *, nodes=4, name="phase 1", **limits):
    """Return a phase from functions of time, ``{name: f(t)}``; f(t, middle) if it jumps at knots."""

    def sampled(parts, **cut):
        def course(t, middle):
            return [f(t, middle) if f.__code__.co_argcount == 2 else f(t) for f in parts]

        return piecewise(knots, course, nodes, len(parts), **cut)

    return PhasePlan(
        name,
        sampled(list(states.values())),
        sampled(list(dict(controls).values()), **limits),
        tuple(states),
        tuple(dict(controls)),
        None if costates is None else sampled(list(costates.values())),
    )


def check(found, name):
    (one,) = [c for c in found.checks if c.name == name]
    return one


REST = {"x": lambda t: 3 * t**2 - 2 * t**3, "v": lambda t: 6 * t - 6 * t**2}


EFFORT = {"u": lambda t: 6 - 12 * t}


def rest_problem(upper=6.0, highest=None, end=(1, 1)):
    ocp = OptimalControlProblem("rest to rest")
    phase = ocp.phase(time=(0, tuple(end)), equation="2")
    x = phase.state("x", initial=0, final=1, unit="m", upper=highest)
    v = phase.state("v", initial=0, final=0, unit="m/s")
    u = phase.control("u", lower=-upper, upper=upper, unit="m/s²")
    phase.dynamics({x: v, v: u})
    phase.path(x + v, upper=2.1, name="both", equation="7", unit="m")
    ocp.minimise(phase.integral(u**2 / 2), unit="J")
    return ocp


def rest_plan(knots=(0.0, 0.3, 1.0), states=(), controls=(), **more):
    return ControlPlan((phase_plan(knots, REST | dict(states), EFFORT | dict(controls), **more),))


def swing(drift=0.0):
    return phase_plan(
        np.linspace(0, 6, 13),
        {"x": lambda t: (1 + drift * t) * np.sin(t), "v": lambda t: (1 + drift * t) * np.cos(t)},
        nodes=10,
    )


def parametric():
    ocp = OptimalControlProblem("parameters")
    rate = ocp.parameter("rate", 2, lower=[0, -1], upper=[2, 1])
    phase = ocp.phase(time=(0, (0.5, 3)))
    x, y = phase.state("x", initial=0), phase.state("y", initial=0)
    phase.dynamics({x: rate[0], y: rate[1] * phase.time})
    root = phase.integral(casadi.fabs(phase.time - 0.7))
    ocp.subject_to(root, upper=1.0, name="distance", equation="5", unit="m s")
    ocp.minimise(phase.integral(casadi.exp(phase.time)) + phase.end + rate[0])
    return ocp
