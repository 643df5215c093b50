"""Satellite slew as an optimal control problem: equations in CasADi, and the guess."""

from __future__ import annotations

from itertools import product
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..optimal_control.model import OptimalControlProblem
from .data import SlewData, VectorLimits
from .gyros import momentum_direction, singularity_measure
from .profile import EigenaxisProfile
from .quaternions import conjugate, product as quaternion_product, rotation_matrix

__all__ = ["reduced_problem", "rodrigues", "slew_problem"]

Floats = NDArray[np.float64]

#: Number of samples of the guess.
SAMPLES = 61
#: Share of the rate and torque limits in the guess, which keeps it inside of the feasible set.
SHARE = 0.9
#: Candidate gimbal angles for the middle of the guess, rad, their smallest singularity measure, and the
#: weight of squared angles: the best optimum that was found moves the gimbals least.
REACH, LEAST_MEASURE, PRICE = 1.2, 0.5, 0.2
#: Number of candidate angles per gimbal by the number of gyros: at most 17,000 combinations.
LEVELS = {3: 7, 4: 7, 5: 7, 6: 5, 7: 3, 8: 3}
#: Relative momentum below which the satellite has none.
STILL = 1e-12


def slew_problem(model: SlewData, name: str) -> OptimalControlProblem:
    """Return `model` as an optimal control problem with the independent conditions at the end.

    Of the conditions at the end, the length of q implies one and the momentum three. The problem omits
    the rates and the entry of q that is largest at the end, because only this entry is a smooth
    function of the other three. Its sign is fixed. With free final gimbals the rates are imposed.
    """
    problem = OptimalControlProblem(name)
    phase = problem.phase("slew", time=(0.0, _end(model)), equation="3 and 10")
    q = phase.state("q", 4, initial=model.initial_attitude, final=_final_attitude(model), scale=1.0)
    w = phase.state(
        "w", 3,
        initial=model.begin_rate,
        final=None if model.final_gimbals is not None else model.end_rate,
        lower=-model.rate_limit,
        upper=model.rate_limit,
        unit="rad/s",
    )  # fmt: skip
    delta, rate = _gimbals(model, phase)
    direction, jacobian = _gyros(model, delta)
    torque = -model.momentum * (jacobian @ rate)
    momentum = casadi.DM(np.array(model.inertia)) @ w + model.momentum * direction
    phase.dynamics(
        {
            q: casadi.vertcat(
                -0.5 * casadi.dot(w, q[1:]), -0.5 * casadi.cross(w, q[1:]) + 0.5 * q[0] * w
            ),
            w: casadi.DM(np.linalg.inv(model.inertia)) @ (torque - casadi.cross(w, momentum)),
            delta: rate,
        }
    )
    _limit(model, phase, w, torque, jacobian)
    phase.invariant("norm of the quaternion", casadi.dot(q, q), equation="23", scale=1.0)
    phase.invariant(
        "total momentum", _inertial(q, momentum),
        equation="1", unit="N m s", scale=model.momentum,
    )  # fmt: skip
    _minimise(model, problem, phase, rate)
    phase.guess(**_guess(model))
    return problem.build()


def reduced_problem(model: SlewData, name: str) -> OptimalControlProblem:
    """Return `model` as an optimal control problem without redundant states and conditions.

    The body rates follow from the conserved momentum, I w = R(q)ᵀ H - h(δ). The states are δ and the modified
    Rodrigues vector σ of the rotation from the initial attitude, the axis times tan(angle / 4), which is singular
    at 360° only: σ̇ = ¼ ((1 - σ·σ) w + 2 σ×w + 2 (σ·w) σ).
    """
    problem = OptimalControlProblem(name)
    phase = problem.phase("slew", time=(0.0, _end(model)), equation="1 and 10")
    turn = rodrigues(model, model.target)
    sigma = phase.state("sigma", 3, initial=np.zeros(3), final=turn, scale=1.0)
    delta, rate = _gimbals(model, phase)
    direction, jacobian = _gyros(model, delta)
    square = casadi.dot(sigma, sigma)
    body: Any = rotation_matrix(model.initial_attitude).T @ model.total_momentum
    if np.abs(body).max() > STILL * model.momentum:
        back = casadi.vertcat(1.0 - square, -2.0 * sigma) / (1.0 + square)
        momentum = _inertial(back, casadi.DM(body)) - model.momentum * direction
    else:
        momentum = -model.momentum * direction
    w = casadi.DM(np.linalg.inv(model.inertia)) @ momentum
    turning = 2.0 * casadi.cross(sigma, w) + 2.0 * casadi.dot(sigma, w) * sigma
    phase.dynamics({sigma: 0.25 * ((1.0 - square) * w + turning), delta: rate})
    _limit(model, phase, w, -model.momentum * (jacobian @ rate), jacobian)
    if model.vector_limits != VectorLimits.NORM:
        phase.path(
            w, lower=-model.rate_limit, upper=model.rate_limit,
            name="body rates", equation="23", unit="rad/s",
        )  # fmt: skip
    if model.final_gimbals is None:
        problem.subject_to(
            phase.final(direction), equals=model.final_momentum / model.momentum,
            name="final momentum of the gyros", equation="13", scale=1.0,
        )  # fmt: skip
    _minimise(model, problem, phase, rate)
    guess = _guess(model)
    attitudes = guess.pop("q")
    guess.pop("w")
    phase.guess(sigma=rodrigues(model, attitudes), **guess)
    return problem.build()


def rodrigues(model: SlewData, attitudes: Floats) -> Floats:
    """Return the modified Rodrigues vectors σ from the initial attitude to `attitudes`, shape (…, 3)."""
    turned = quaternion_product(conjugate(model.initial_attitude), attitudes)
    # The path starts at the initial attitude, given as q or -q.
    turned = turned if turned.reshape(-1, 4)[0, 0] >= 0.0 else -turned
    return turned[..., 1:] / np.maximum(1.0 + turned[..., :1], STILL)


def _end(model: SlewData) -> Any:
    """Return the final time or its range."""
    low, high = (float(t) for t in model.time_range)
    return low if low == high else (low, high)


def _gimbals(model: SlewData, phase: Any) -> tuple[Any, Any]:
    """Declare gimbal angles and gimbal rates."""
    count, fastest = model.gyro_count, model.planned_gimbal_rate
    delta = phase.state(
        "delta", count,
        initial=model.initial_gimbals, final=model.final_gimbals, scale=1.0, unit="rad",
    )  # fmt: skip
    return delta, phase.control("rate", count, lower=-fastest, upper=fastest, unit="rad/s")


def _limit(model: SlewData, phase: Any, w: Any, torque: Any, jacobian: Any) -> None:
    """Declare the limits of eq. 23 other than bounds of states and controls."""
    # With `casadi.det`, the Hessian of all functions at a node has 4,028 operations instead of 2,279.
    gram = jacobian @ jacobian.T
    phase.path(
        casadi.dot(gram[:, 0], casadi.cross(gram[:, 1], gram[:, 2])),
        lower=model.singularity_limit, name="singularity measure", equation="23", scale=1.0,
    )  # fmt: skip
    most = model.planned_torque
    if model.vector_limits != VectorLimits.NORM:
        phase.path(
            torque, lower=-most, upper=most, name="control torque", equation="23", unit="N m"
        )
        return
    # Squares, because the norm has no derivative at rest.
    for name, vector, square, unit in (
        ("body rate squared", w, model.rate_limit**2, "rad^2/s^2"),
        ("control torque squared", torque, most**2, "N^2 m^2"),
    ):
        value = casadi.dot(vector, vector)
        phase.path(value, upper=square, name=name, equation="23", unit=unit, scale=square)


def _minimise(model: SlewData, problem: Any, phase: Any, rate: Any) -> None:
    """Declare the objective, eq. 22."""
    weight = casadi.DM(np.array(model.rate_weight))
    problem.minimise(phase.integral(1.0 + casadi.dot(weight, rate**2)), unit="s")


def _final_attitude(model: SlewData) -> tuple[Floats, Floats]:
    """Return the range of q at the end: fixed except for the largest entry, whose sign is kept."""
    low, high = model.target.copy(), model.target.copy()
    largest = int(np.abs(model.target).argmax())
    positive = model.target[largest] > 0.0
    low[largest] = 0.0 if positive else -np.inf
    high[largest] = np.inf if positive else 0.0
    return low, high


def _gyros(model: SlewData, delta: Any) -> tuple[Any, Any]:
    """Return A_s·1 and its Jacobian A_t, differentiated by CasADi."""
    s, c = casadi.sin(delta), casadi.cos(delta)
    if model.gimbal_axes is not None:
        direction = casadi.DM.zeros(3)
        for k, (axis, wheel) in enumerate(zip(model.gimbal_axes, model.wheels, strict=True)):
            direction += c[k] * casadi.DM(wheel) + s[k] * casadi.cross(
                casadi.DM(axis), casadi.DM(wheel)
            )
        return direction, casadi.jacobian(direction, delta)
    cb, sb = float(np.cos(model.beta)), float(np.sin(model.beta))
    direction = casadi.vertcat(
        -cb * s[0] - c[1] + cb * s[2] + c[3],
        c[0] - cb * s[1] - c[2] + cb * s[3],
        sb * (s[0] + s[1] + s[2] + s[3]),
    )
    return direction, casadi.jacobian(direction, delta)


def _inertial(q: Any, vector: Any) -> Any:
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
    ramp = fractions[:, None]
    stretch = profile.duration / long
    attitude, rates, _ = profile.course(fractions * profile.duration)
    begin = model.initial_gimbals
    end = model.final_gimbals
    if end is None:
        moved = np.abs(
            model.final_momentum - model.momentum * momentum_direction(begin, model.gyros)
        )
        is_kept = moved.max() <= STILL * model.momentum
        end = begin if is_kept else _coasting_gimbals(model, model.target, model.end_rate)
    half = SAMPLES // 2
    bulge = _coasting_gimbals(model, attitude[half], rates[half]) - 0.5 * (begin + end)
    gimbals = begin + ramp * (end - begin)
    gimbals = gimbals + np.sin(np.pi * fractions)[:, None] * bulge
    return {
        "time": fractions * long,
        "q": attitude,
        "w": rates * stretch + (1.0 - ramp) * model.begin_rate + ramp * model.end_rate,
        "delta": gimbals,
        "rate": np.gradient(gimbals, fractions * long, axis=0),
    }


def _coasting_gimbals(model: SlewData, attitude: Floats, rates: Floats) -> Floats:
    """Return gimbal angles with approximately the momentum of the coast, far from singularities.

    Constant or equal gimbal angles are a symmetry, which a search has to leave first. From there it
    took two to four times as many steps and ended at worse optima.
    """
    levels = np.linspace(-REACH, REACH, LEVELS[model.gyro_count])
    angles = np.array(list(product(levels, repeat=model.gyro_count)))
    needed = rotation_matrix(attitude).T @ model.total_momentum - model.inertia @ rates
    mismatch = momentum_direction(angles, model.gyros) - needed / model.momentum
    measures = singularity_measure(angles, model.gyros)
    smallest = min(max(LEAST_MEASURE, 1.5 * model.singularity_limit), float(measures.max()))
    value = (mismatch**2).sum(axis=1) + PRICE * (angles**2).sum(axis=1)
    result: Floats = angles[int(np.where(measures >= smallest, value, np.inf).argmin())]
    return result
