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


#: Thrust limits of a rotor in N, and steering angle in rad and acceleration in m/s² of the car.
THRUST = (1.2, 3.3)
STEER, PULL = (-0.2, 0.2), (-6.0, 3.0)
FAR = float("inf")


def quadrotor_rates(x, u):
    """Return the rates of a quadrotor: position, velocity, roll, pitch and yaw, body rates; four thrusts."""
    mass, gravity, arm, drag, inertia = 1.0, 9.81, 0.2, 0.02, (0.03, 0.03, 0.05)
    (roll, pitch, yaw), (p, q, r) = casadi.vertsplit(x[6:9]), casadi.vertsplit(x[9:12])
    lift = casadi.sum1(u) / mass
    sr, cr, sy, cy = casadi.sin(roll), casadi.cos(roll), casadi.sin(yaw), casadi.cos(yaw)
    sp, cp = casadi.sin(pitch), casadi.cos(pitch)
    push = casadi.vertcat(cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp) * lift
    swirl = q * sr + r * cr
    turn = casadi.vertcat(p + swirl * sp / cp, q * cr - r * sr, swirl / cp)
    spin = casadi.vertcat(
        (arm * (u[1] - u[3]) - (inertia[2] - inertia[1]) * q * r) / inertia[0],
        (arm * (u[2] - u[0]) - (inertia[0] - inertia[2]) * p * r) / inertia[1],
        (drag * (u[0] - u[1] + u[2] - u[3]) - (inertia[1] - inertia[0]) * p * q) / inertia[2],
    )
    return casadi.vertcat(x[3:6], push - casadi.vertcat(0, 0, gravity), turn, spin)


def quadrotor_cost(x, u, t):
    """Return the cost of a quadrotor's states and controls at time `t` of a helical flight."""
    goal = casadi.vertcat(1.2 * casadi.sin(1.5 * t), 1.2 - 1.2 * casadi.cos(1.5 * t), 0.3 * t)
    calm = 0.05 * casadi.sumsqr(x[3:6]) + casadi.sumsqr(x[6:9]) + 0.2 * casadi.sumsqr(x[9:12])
    return 10 * casadi.sumsqr(x[:3] - goal) + calm + 0.1 * casadi.sumsqr(u)


def car_rates(x, u):
    """Return the rates of a bicycle model: position, heading, two velocities, yaw rate; steering, pull."""
    mass, inertia, front, rear, stiff = 1000.0, 1500.0, 1.2, 1.4, 6e4
    heading, ahead, aside, turn = casadi.vertsplit(x[2:6])
    slip_front = u[0] - casadi.atan2(aside + front * turn, ahead)
    slip_rear = -casadi.atan2(aside - rear * turn, ahead)
    force_front, force_rear = (
        stiff * casadi.atan(1.5 * slip) / 1.5 for slip in (slip_front, slip_rear)
    )
    s, c, sd, cd = casadi.sin(heading), casadi.cos(heading), casadi.sin(u[0]), casadi.cos(u[0])
    return casadi.vertcat(
        ahead * c - aside * s,
        ahead * s + aside * c,
        turn,
        u[1] - force_front * sd / mass + aside * turn - 0.002 * ahead**2,
        (force_front * cd + force_rear) / mass - ahead * turn,
        (front * force_front * cd - rear * force_rear) / inertia,
    )


def car_track_cost(x, u, t):
    """Return the cost of a car's states and controls at time `t` of a slalom at 14.5 m/s."""
    goal = casadi.vertcat(14.5 * t, 3 * casadi.sin(1.2 * t))
    calm = 0.01 * x[4] ** 2 + 0.1 * x[5] ** 2
    return casadi.sumsqr(x[:2] - goal) + calm + 10 * u[0] ** 2 + 0.1 * u[1] ** 2


#: Rates, cost, horizon, first state, control, and bounds of states and controls of the two tracking problems.
TRACKING = {
    "quadrotor": (
        quadrotor_rates,
        quadrotor_cost,
        1.5,
        [0, 0, 0, 1.8, *[0] * 8],
        [9.81 / 4] * 4,
        ([-FAR] * 6 + [-0.6] * 2 + [-FAR] * 4, [FAR] * 6 + [0.6] * 2 + [FAR] * 4),
        ([THRUST[0]] * 4, [THRUST[1]] * 4),
    ),
    "race car": (
        car_rates,
        car_track_cost,
        1.5,
        [0, 0, 0, 14.5, 0, 0],
        [0, 0],
        ([-FAR] * 3 + [1.0] + [-FAR] * 2, [FAR] * 3 + [15.0] + [FAR] * 2),
        ([STEER[0], PULL[0]], [STEER[1], PULL[1]]),
    ),
}


def tracking(name):
    """Return a tracking problem of `TRACKING` with the data `x0` and `now`, its start time."""
    rates, cost, horizon, first, control, state_bounds, control_bounds = TRACKING[name]
    problem = OptimalControlProblem(name)
    x0, now = problem.data("x0", len(first), value=first), problem.data("now", value=0.0)
    phase = problem.phase(time=(0, horizon))
    x = phase.state("x", len(first), initial=x0, lower=state_bounds[0], upper=state_bounds[1])
    u = phase.control("u", len(control), lower=control_bounds[0], upper=control_bounds[1])
    phase.dynamics({x: rates(x, u)})
    final = cost(phase.final(x), casadi.DM.zeros(len(control)), now + horizon)
    problem.minimise(phase.integral(cost(x, u, now + phase.time)) + final)
    phase.guess(x=first, u=control)
    return problem
