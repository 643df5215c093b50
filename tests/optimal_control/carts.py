"""Small control problems for pictures, with plans in closed form."""

import itertools

import numpy as np

from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.plan import Piecewise

NODES = np.array([-1.0, -0.5, 0.5, 1.0])


def piecewise(function, knots, low=None, high=None):
    """Return a function of time (columns) as cubics between the knots."""
    knots = np.asarray(knots, float)
    at = [a + (NODES + 1) * (b - a) / 2 for a, b in itertools.pairwise(knots)]
    values = tuple(np.column_stack(function(t)) for t in at)
    return Piecewise(knots, (NODES,) * len(at), values, low, high)


def braking(name="braking", bound=np.inf, push=6.0, **more):
    """Return a cart that moves back and forth: x'' = u."""
    problem = OptimalControlProblem(name)
    phase = problem.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=bound, unit="m")
    v = phase.state("v", initial=1, final=-1, unit="m/s")
    u = phase.control("u", lower=-push, upper=push, unit="m/s^2")
    phase.dynamics({x: v, v: u})
    for label, options in more.items():
        phase.path(x + v, name=label.replace("_", " "), **options)
    problem.minimise(phase.integral(u**2), unit="m²/s³")
    return problem


def cruising(knots=(0, 0.5, 1), costates=False, force=-2.0):
    """Return the exact motion of `braking` under a constant force."""
    states = piecewise(lambda t: (t + force * t**2 / 2, 1 + force * t), knots)
    controls = piecewise(lambda t: (np.full(t.size, force),), knots)
    multipliers = piecewise(lambda t: (0 * t, 4 + 0 * t), knots) if costates else None
    return ControlPlan((PhasePlan("phase 1", states, controls, ("x", "v"), ("u",), multipliers),))


def relay():
    """Return two consecutive phases, with a vector and a state of only one of them."""
    problem = OptimalControlProblem("relay")
    first, second = problem.phase("go", time=(0, 1)), problem.phase("stay", time=(1, 3), unit="s")
    r = first.state("r", 2, upper=[1.5, np.inf])
    w = first.control("w", 2, lower=-1, upper=1)
    first.dynamics({r: w})
    r2, extra = second.state("r", 2), second.state("fuel", lower=0)
    second.dynamics({r2: [0.0, 0.0], extra: -0.1})
    problem.link(first, second, "r")
    problem.minimise(first.integral(w[0] ** 2 + w[1] ** 2))
    return problem


def relayed():
    go = PhasePlan(
        "go", piecewise(lambda t: (t, 2 * t), (0, 0.3, 1)),
        piecewise(lambda t: (1 + 0 * t, 2 + 0 * t), (0, 0.3, 1), [-1, -1], [1, 1]),
        ("r[0]", "r[1]"), ("w[0]", "w[1]"),
    )  # fmt: skip
    none = Piecewise(np.array([1.0, 3.0]), (NODES,), (np.zeros((4, 0)),))
    stay = PhasePlan(
        "stay", piecewise(lambda t: (1 + 0 * t, 2 + 0 * t, 1 - 0.1 * t), (1, 3)), none,
        ("r[0]", "r[1]", "fuel"), (),
    )  # fmt: skip
    return ControlPlan((go, stay))
