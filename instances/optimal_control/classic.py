"""Textbook problems with smooth optima, mostly solved in closed form."""

from __future__ import annotations

import math

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark


@benchmark
def brachistochrone(ocp: OptimalControlProblem, *, gravity: float = 9.80665) -> None:
    """Return the brachistochrone: the fastest frictionless slide of a bead from (0, 10) to (10, 5).

    The optimum is an arc of a cycloid (Johann Bernoulli, Acta Eruditorum, 1696).

    Parameters
    ----------
    gravity : float
        g, m/s².
    """
    import casadi

    phase = ocp.phase(time=(0, (0.1, 10)))
    x = phase.state("x", initial=0, final=10, lower=0, upper=20, unit="m")
    y = phase.state("y", initial=10, final=5, lower=0, upper=20, unit="m")
    v = phase.state("v", initial=0, lower=0, upper=50, unit="m/s")
    # Angle between the downward vertical and the tangent of the curve.
    slope = phase.control("slope", lower=0, upper=math.pi, unit="rad")
    phase.dynamics(
        {x: v * casadi.sin(slope), y: -v * casadi.cos(slope), v: gravity * casadi.cos(slope)}
    )
    phase.guess(time=[0, 2], v=[0, 10], slope=[0, math.pi / 2])
    ocp.minimise(phase.end, unit="s")


@benchmark
def bryson_denham(ocp: OptimalControlProblem, *, limit: float = 1 / 9) -> None:
    """Return the smallest effort that turns a cart around within a second before a wall.

    With the wall at l the optimum is 4 / (9 l) for l <= 1/6, if the cart moves along the wall;
    2 + 6 (1 - 4 l)² for 1/6 <= l <= 1/4, if it touches the wall; and 2 beyond (Bryson and Ho,
    "Applied Optimal Control", 1975, section 3.11).

    Parameters
    ----------
    limit : float
        l, position of the wall.
    """
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=limit)
    v = phase.state("v", initial=1, final=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2 / 2))


@benchmark
def double_integrator_energy(ocp: OptimalControlProblem) -> None:
    """Return the rest-to-rest move of a unit mass by 1 in a second with the smallest ∫ u² dt.

    The optimum is u = 6 - 12 t, x = 3 t² - 2 t³, and costs 12.
    """
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u", scale=6)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))


@benchmark
def linear_regulator(ocp: OptimalControlProblem, *, horizon: float = 2.0) -> None:
    """Return the regulation of the unstable plant ẋ = x + u from 1 with the smallest ∫ (x² + u²) dt.

    With the horizon T the optimum is p(0) of Riccati's equation,
    tanh(√2 T) / (√2 - tanh(√2 T)) (Bryson and Ho, 1975, chapter 5).

    Parameters
    ----------
    horizon : float
        T.
    """
    phase = ocp.phase(time=(0, horizon))
    x = phase.state("x", initial=1)
    u = phase.control("u")
    phase.dynamics({x: x + u})
    ocp.minimise(phase.integral(x**2 + u**2))


@benchmark
def hypersensitive(ocp: OptimalControlProblem, *, horizon: float = 10_000.0) -> None:
    """Return a problem with boundary layers: ẋ = -x³ + u, smallest ∫ (x² + u²) / 2 dt.

    The state leaves 1.5, stays at 0 nearly all the time, and reaches 1 at the end. A mesh that is
    not refined at the ends misses both layers (Rao and Mease, "Eigenvector approximate dichotomic
    basis method for solving hyper-sensitive optimal control problems", Optimal Control Applications
    and Methods 21, 2000).

    Parameters
    ----------
    horizon : float
        tf; the optimum is nearly independent of it from 25 on.
    """
    phase = ocp.phase(time=(0, horizon))
    x = phase.state("x", initial=1.5, final=1, lower=-2, upper=2)
    u = phase.control("u", lower=-10, upper=10, scale=1)
    phase.dynamics({x: -(x**3) + u})
    ocp.minimise(phase.integral((x**2 + u**2) / 2))


@benchmark
def zermelo(ocp: OptimalControlProblem) -> None:
    """Return a boat's fastest way home through a shear current with the drift -y along x.

    The tangent of the optimal heading grows linearly in time (Zermelo, ZAMM 11, 1931; the numbers
    are those of Bryson and Ho, 1975, section 2.7: from (3.66, -1.86) in 5.46).
    """
    import casadi

    phase = ocp.phase(time=(0, (1, 20)))
    x = phase.state("x", initial=3.66, final=0, lower=-10, upper=10)
    y = phase.state("y", initial=-1.86, final=0, lower=-10, upper=10)
    # Headings away from home are excluded: the slowest one satisfies the first-order conditions, too.
    heading = phase.control("heading", lower=math.pi / 2, upper=3 * math.pi / 2, unit="rad")
    phase.dynamics({x: casadi.cos(heading) - y, y: casadi.sin(heading)})
    phase.guess(time=[0, 5], heading=[2, 4])
    ocp.minimise(phase.end)


@benchmark
def dido(ocp: OptimalControlProblem, *, length: float = 2.0) -> None:
    """Return the largest area between a rope and a straight shore: a half-disc, l² / (2 π).

    Time is the arc length of the rope, which fixes its length (the isoperimetric problem of Queen
    Dido).

    Parameters
    ----------
    length : float
        l, m.
    """
    import casadi

    phase = ocp.phase(time=(0, length), unit="m")
    x = phase.state("x", initial=0, lower=-length, upper=length, unit="m")
    y = phase.state("y", initial=0, final=0, lower=0, upper=length, unit="m")
    heading = phase.control("heading", lower=-math.pi, upper=math.pi, unit="rad")
    phase.dynamics({x: casadi.cos(heading), y: casadi.sin(heading)})
    phase.guess(x=[0, length / 2], y=[0, length / 4, 0], heading=[math.pi / 4, -math.pi / 4])
    ocp.minimise(-phase.integral(y * casadi.cos(heading)), unit="m²")


@benchmark
def hanging_chain(ocp: OptimalControlProblem) -> None:
    """Return the shape of a chain of length 4 between (0, 1) and (1, 3) with the smallest potential energy.

    An integral constraint fixes the length. The optimum is a catenary (Dolan, Moré and Munson,
    "Benchmarking optimization software with COPS 3.0", 2004, problem 4).
    """
    import casadi

    phase = ocp.phase(time=(0, 1), unit="m")
    height = phase.state("height", initial=1, final=3, lower=-2, upper=5, unit="m")
    slope = phase.control("slope", lower=-50, upper=50, scale=10)
    phase.dynamics({height: slope})
    arc = casadi.sqrt(1 + slope**2)
    ocp.subject_to(phase.integral(arc), equals=4, name="length of the chain", unit="m")
    # A sagging chain: a parabola through both ends.
    phase.guess(height=lambda t: 1 - 4 * t + 6 * t**2, slope=lambda t: -4 + 12 * t)
    ocp.minimise(phase.integral(height * arc), unit="m²")


@benchmark
def brockett(ocp: OptimalControlProblem) -> None:
    """Return Brockett's integrator: a closed curve in the plane whose area lifts z from 0 to 1.

    ż = x v - y u is twice the rate of the enclosed area, so the smallest ∫ (u² + v²) dt in a unit of
    time is the square of the length of the shortest closed curve around 1/2: a circle, and 4 π / 2
    (Brockett, "Control theory and singular Riemannian geometry", in "New Directions in Applied
    Mathematics", Springer, 1982). The circle may begin in any direction. A search that begins at rest
    on the straight line is stationary.
    """
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0)
    y = phase.state("y", initial=0, final=0)
    z = phase.state("z", initial=0, final=1)
    u, v = phase.control("u"), phase.control("v")
    phase.dynamics({x: u, y: v, z: x * v - y * u})
    ocp.minimise(phase.integral(u**2 + v**2))


@benchmark
def maximal_range(ocp: OptimalControlProblem) -> None:
    """Return the largest range in two time units of a mass with a thrust of g / 2.

    The thrust acts along the velocity and provides no lift. The control is its direction, as two
    components (Bryson, "Dynamic Optimization", Addison-Wesley, 1999).
    """
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=0)
    y = phase.state("y", initial=0, final=0.1)
    v = phase.state("v", initial=0)
    along, up = phase.control("along"), phase.control("up")
    phase.dynamics({x: v * along, y: v * up, v: 0.5 - up})
    phase.path(along**2 + up**2, equals=1)
    ocp.minimise(-phase.final(x))


@benchmark
def decay_fit(ocp: OptimalControlProblem) -> None:
    """Return the fit of the rate p of ẋ = -p x to 1 / (1 + t) over 4 s.

    The problem has a parameter and no control. No p fits exactly, so the smallest
    ∫ (x - 1 / (1 + t))² dt is positive. It is the minimum of a function of one variable.
    """
    rate = ocp.parameter("rate", lower=0, upper=5, guess=1, unit="1/s")
    phase = ocp.phase(time=(0, 4))
    x = phase.state("x", initial=1, lower=0, upper=1)
    phase.dynamics({x: -rate * x})
    measured = 1 / (1 + phase.time)
    phase.guess(x=lambda t: 1 / (1 + t))
    ocp.minimise(phase.integral((x - measured) ** 2), unit="s")
