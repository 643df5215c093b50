"""Small declared problems for several test modules."""

import math
from types import SimpleNamespace

import casadi
import numpy as np

import crosstrack as ct
from crosstrack.models import OptimalControlProblem

INF, NAN = math.inf, math.nan


#: A coarse first mesh, sufficient for smooth problems with refinement.
COARSE = {"intervals": 3}


def solve(problem, **options):
    """Return the solution on a coarse mesh, which must have a plan."""
    answer = ct.solve(problem, **{"formulation_options": COARSE, **options})
    assert answer.plan is not None, str(answer)
    return answer


def rest_to_rest(name="rest to rest"):
    """Return the smallest effort from rest to rest: x = 3t² - 2t³, u = 6 - 12t, ∫ u² = 12."""
    ocp = OptimalControlProblem(name)
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    return SimpleNamespace(ocp=ocp, phase=phase, x=x, v=v, u=u)


def open_problem(time=(0, 1)):
    """Return the same problem without dynamics and objective, for further declarations."""
    ocp = OptimalControlProblem("open")
    phase = ocp.phase(time=time)
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u")
    return SimpleNamespace(ocp=ocp, phase=phase, x=x, v=v, u=u)


def two_phases(time=1.0, *, named=(), **link):
    ocp = OptimalControlProblem("two phases")
    parts = []
    for name, times, ends in (
        ("go", (0, time), {"initial": [0, 0]}),
        ("stop", (time, 2), {"final": [1, 0]}),
    ):
        phase = ocp.phase(name, time=times)
        q = phase.state("q", 2, **ends)
        w = phase.state("w", **({"initial": 0} if name == "go" else {}))
        u = phase.control("u")
        phase.dynamics({q: [q[1], u], w: u**2})
        parts.append(SimpleNamespace(phase=phase, q=q, w=w, u=u))
    go, stop = parts
    ocp.link(go.phase, stop.phase, *named)
    ocp.minimise(stop.phase.final(stop.w))
    return ocp, go, stop


def interpolated():
    grid = np.linspace(-2, 2, 21)
    table = casadi.interpolant("table", "bspline", [grid], np.sin(grid))
    ocp = OptimalControlProblem("interpolated")
    phase = ocp.phase()
    x, u = phase.state("x", initial=1), phase.control("u", lower=-2, upper=2)
    phase.dynamics({x: -table(x) + u})
    ocp.minimise(phase.integral(x**2 + u**2))
    return ocp


def everything(twenty):
    """Return a problem with all kinds of declarations, with `twenty` as a number of any type."""
    ocp = OptimalControlProblem("everything")
    first = ocp.phase("first", time=(0, (1, twenty)), equation="2")
    x = first.state("x", 2, initial=[0, 0], upper=twenty, unit="m")
    u = first.control("u", lower=-1, upper=1)
    p = ocp.parameter("p", lower=0, upper=twenty)
    first.dynamics({x: casadi.vertcat(x[1], u * twenty - p * x[0])})
    first.path(x[0] ** 2 + u**2 <= twenty, name="tube")
    first.invariant("nothing", p * first.time * 0, scale=twenty)
    second = ocp.phase("second", time=((1, twenty), twenty))
    y = second.state("x", 2, final=[1, 0])
    second.dynamics({y: [y[1], twenty]})
    second.guess(x=[[0, 0], [1, twenty]])
    ocp.link(first, second)
    ocp.subject_to(first.integral(u**2) <= twenty)
    ocp.minimise(first.integral(u**2) + second.final(y[0]) + twenty * p)
    return ocp
