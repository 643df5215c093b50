"""Satellite slew as an optimal control problem: equations in CasADi, and the guess."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..optimal_control.model import OptimalControlProblem
from .data import SlewData, VectorLimits
from .gyros import momentum_direction, singularity_measure
from .profile import EigenaxisProfile
from .quaternions import rotation_matrix

__all__ = ["slew_problem"]

Floats = NDArray[np.float64]

#: Number of samples of the guess.
SAMPLES = 61
#: Share of the rate and torque limits in the guess, which keeps it inside of the feasible set.
SHARE = 0.9
#: Candidate gimbal angles for the middle of the guess, rad, their smallest singularity measure, and the
#: weight of squared angles: the best optimum that was found moves the gimbals least.
LEVELS, LEAST_MEASURE, PRICE = (-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2), 0.5, 0.2


def slew_problem(model: SlewData, name: str) -> OptimalControlProblem:
    """Return `model` as an optimal control problem with the independent conditions at the end.

    Of the eleven conditions at the end, the length of q implies one and the momentum three. The
    problem omits the rates and the entry of q that is largest at the end, because only this entry is
    a smooth function of the other three. Its sign is fixed. With free final gimbals the rates are
    imposed.
    """
    import casadi

    problem = OptimalControlProblem(name)
    low, high = (float(t) for t in model.time_range)
    end: Any = low if low == high else (low, high)
    phase = problem.phase("slew", time=(0.0, end), equation="3 and 10")
    q = phase.state("q", 4, initial=model.initial_attitude, final=_final_attitude(model), scale=1.0)
    has_final_gimbals = model.final_gimbals is not None
    w = phase.state(
        "w", 3,
        initial=np.zeros(3),
        final=None if has_final_gimbals else np.zeros(3),
        lower=-model.rate_limit,
        upper=model.rate_limit,
        unit="rad/s",
    )  # fmt: skip
    delta = phase.state(
        "delta", 4, initial=model.initial_gimbals, final=model.final_gimbals, scale=1.0, unit="rad"
    )
    fastest = model.planned_gimbal_rate
    rate = phase.control("rate", 4, lower=-fastest, upper=fastest, unit="rad/s")

    inertia = casadi.DM(np.array(model.inertia))
    direction, jacobian = _pyramid(casadi, delta, model.beta)
    torque = -model.momentum * (jacobian @ rate)
    momentum = inertia @ w + model.momentum * direction
    phase.dynamics(
        {
            q: casadi.vertcat(
                -0.5 * casadi.dot(w, q[1:]), -0.5 * casadi.cross(w, q[1:]) + 0.5 * q[0] * w
            ),
            w: casadi.DM(np.linalg.inv(model.inertia)) @ (torque - casadi.cross(w, momentum)),
            delta: rate,
        }
    )
    phase.path(
        casadi.det(jacobian @ jacobian.T),
        lower=model.singularity_limit, name="singularity measure", equation="23", scale=1.0,
    )  # fmt: skip
    torque_limit = model.planned_torque
    if model.vector_limits == VectorLimits.NORM:
        # Squares, because the norm has no derivative at rest.
        for name, vector, limit, unit in (
            ("body rate squared", w, model.rate_limit, "rad^2/s^2"),
            ("control torque squared", torque, torque_limit, "N^2 m^2"),
        ):
            square = limit**2
            phase.path(
                casadi.dot(vector, vector),
                upper=square, name=name, equation="23", unit=unit, scale=square,
            )  # fmt: skip
    else:
        phase.path(
            torque,
            lower=-torque_limit,
            upper=torque_limit,
            name="control torque",
            equation="23",
            unit="N m",
        )
    phase.invariant("norm of the quaternion", casadi.dot(q, q), equation="23", scale=1.0)
    phase.invariant(
        "total momentum", _inertial(casadi, q, momentum),
        equation="1", unit="N m s", scale=model.momentum,
    )  # fmt: skip
    weight = casadi.DM(np.array(model.rate_weight))
    problem.minimise(phase.integral(1.0 + casadi.dot(weight, rate**2)), unit="s")
    phase.guess(**_guess(model))
    return problem.build()


def _final_attitude(model: SlewData) -> tuple[Floats, Floats]:
    """Return the range of q at the end: fixed except for the largest entry, whose sign is kept."""
    low, high = model.target.copy(), model.target.copy()
    largest = int(np.abs(model.target).argmax())
    positive = model.target[largest] > 0.0
    low[largest] = 0.0 if positive else -np.inf
    high[largest] = np.inf if positive else 0.0
    return low, high


def _pyramid(casadi: Any, delta: Any, beta: float) -> tuple[Any, Any]:
    """Return A_s·1 and its Jacobian A_t, differentiated by CasADi."""
    s, c = casadi.sin(delta), casadi.cos(delta)
    cb, sb = float(np.cos(beta)), float(np.sin(beta))
    direction = casadi.vertcat(
        -cb * s[0] - c[1] + cb * s[2] + c[3],
        c[0] - cb * s[1] - c[2] + cb * s[3],
        sb * (s[0] + s[1] + s[2] + s[3]),
    )
    return direction, casadi.jacobian(direction, delta)


def _inertial(casadi: Any, q: Any, vector: Any) -> Any:
    """Return R(q) v, the inertial components of a vector in body axes."""
    scalar, axis = q[0], q[1:]
    return (
        (scalar**2 - casadi.dot(axis, axis)) * vector
        + 2.0 * casadi.dot(axis, vector) * axis
        + 2.0 * scalar * casadi.cross(axis, vector)
    )


def _guess(model: SlewData) -> dict[str, Any]:
    """Return the samples of an eigenaxis slew, with gimbal angles that provide the coasting momentum."""
    axis, angle = model.turn
    peak = SHARE * model.rate_limit / float(model.magnitudes(axis).max())
    push = SHARE * model.planned_torque / float(model.magnitudes(model.inertia @ axis).max())
    profile = EigenaxisProfile(model.initial_attitude, axis, angle, peak, push)
    low, high = (float(t) for t in model.time_range)
    long = float(np.clip(profile.duration, max(low, 0.1 * high if angle == 0.0 else 0.0), high))
    fractions = np.linspace(0.0, 1.0, SAMPLES)
    stretch = profile.duration / long
    attitude, rates, _ = profile.course(fractions * profile.duration)
    begin = model.initial_gimbals
    end = begin if model.final_gimbals is None else model.final_gimbals
    half = SAMPLES // 2
    bulge = _coasting_gimbals(model, attitude[half], rates[half]) - 0.5 * (begin + end)
    gimbals = begin + fractions[:, None] * (end - begin)
    gimbals = gimbals + np.sin(np.pi * fractions)[:, None] * bulge
    return {
        "time": fractions * long,
        "q": attitude,
        "w": rates * stretch,
        "delta": gimbals,
        "rate": np.gradient(gimbals, fractions * long, axis=0),
    }


def _coasting_gimbals(model: SlewData, attitude: Floats, rates: Floats) -> Floats:
    """Return gimbal angles with approximately the momentum of the coast, far from singularities.

    Constant or equal gimbal angles are a symmetry, which a search has to leave first. From there it
    took two to four times as many steps and ended at worse optima.
    """
    angles = np.array(list(product(LEVELS, repeat=4)))
    needed = rotation_matrix(attitude).T @ model.total_momentum - model.inertia @ rates
    mismatch = momentum_direction(angles, model.beta) - needed / model.momentum
    measures = singularity_measure(angles, model.beta)
    smallest = min(max(LEAST_MEASURE, 1.5 * model.singularity_limit), float(measures.max()))
    value = (mismatch**2).sum(axis=1) + PRICE * (angles**2).sum(axis=1)
    result: Floats = angles[int(np.where(measures >= smallest, value, np.inf).argmin())]
    return result
