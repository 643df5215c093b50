"""Problems with data, as in model-predictive control."""

import casadi

from crosstrack.models import OptimalControlProblem

#: Largest force of the cart, and weights of its states.
FORCE = 20.0
WEIGHTS = (1.0, 0.1, 10.0, 0.1)


def cart_rates(x, force):
    """Return the rates of a cart's position and speed, and of its pole's angle and angular speed."""
    cart, pole, length, gravity = 1.0, 0.3, 0.5, 9.81
    sine, cosine = casadi.sin(x[2]), casadi.cos(x[2])
    inertia = cart + pole * sine**2
    swing = length * x[3] ** 2
    push = (force + pole * sine * (swing - gravity * cosine)) / inertia
    whole = (cart + pole) * gravity * sine
    turn = (-force * cosine - pole * swing * sine * cosine + whole) / (length * inertia)
    return casadi.vertcat(x[1], push, x[3], turn)


def cart_cost(x):
    """Return the cost of a cart's states."""
    return sum(weight * x[k] ** 2 for k, weight in enumerate(WEIGHTS))


def cart_pole(value=(0.0, 0.0, 0.2, 0.0)):
    """Return a cart that balances its pole for a second from the state `x0`."""
    problem = OptimalControlProblem("cart-pole")
    x0 = problem.data("x0", 4, value=value)
    phase = problem.phase(time=(0, 1))
    x = phase.state("x", 4, initial=x0)
    force = phase.control("force", lower=-FORCE, upper=FORCE, unit="N")
    phase.dynamics({x: cart_rates(x, force)})
    cost = phase.integral(cart_cost(x) + 0.01 * force**2)
    problem.minimise(cost + 10 * cart_cost(phase.final(x)))
    return problem


def brake(value=(1.0, 0.0), limit=3.0):
    """Return the stop of a mass at 0 by a bounded force, from the state `x0`; a convex program."""
    problem = OptimalControlProblem("brake")
    x0 = problem.data("x0", 2, value=value)
    weight = problem.data("weight", value=0.1)
    phase = problem.phase(time=(0, 2))
    x = phase.state("x", 2, initial=x0)
    u = phase.control("u", lower=-limit, upper=limit)
    phase.dynamics({x: [x[1], u]})
    final = phase.final(x)
    cost = phase.integral(10 * x[0] ** 2 + weight * u**2)
    problem.minimise(cost + final[0] ** 2 + final[1] ** 2)
    return problem
