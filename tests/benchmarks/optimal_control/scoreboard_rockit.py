"""Problems declared here as programs of rockit."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
from bare import DEGREE, INTERVALS, plan_of_nodes
from scoreboard_parts import QUIET, bounded, sampled

__all__ = ["solve"]


def _at_time(phase: Any, t: Any, x: Any, u: Any, p: Any) -> tuple[Any, Any, Any]:
    """Return rate, path and integrand of a phase.

    rockit rejects dynamics that contain the time without depending on it.
    """
    function = phase.function
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    rate, _, integrand, _ = function(*arguments)
    moving = casadi.depends_on(casadi.vertcat(rate, integrand), arguments[0])
    rate, _, integrand, _ = function(t if moving else 0.0, x, u, p)
    path = function(t, x, u, p)[1] if phase.paths else casadi.MX(0, 1)
    return rate, path, integrand


def solve(problem: Any) -> dict[str, Any]:
    """Solve by rockit: Radau collocation with controls that are constant per interval."""
    import rockit as package

    definition = problem.definition
    starts = definition.stacked("parameters", "initial_lower")
    p_low, p_high = definition.bounds("parameters")
    master = package.Ocp()
    ends: list[Any] = []
    first_p: list[Any] = []
    parts = []
    for phase in definition.phases:
        guess, nx, nu = phase.guess, len(phase.state_names), len(phase.control_names)
        span = guess.end - guess.start
        t0 = (
            phase.start_lower
            if phase.start_lower == phase.start_upper
            else package.FreeTime(guess.start)
        )
        fixed = phase.end_lower == phase.end_upper and not isinstance(t0, package.FreeTime)
        duration = phase.end_lower - t0 if fixed else package.FreeTime(span)
        stage = master.stage(t0=t0, T=duration)
        x = stage.state(nx)
        u = stage.control(nu) if nu else casadi.MX(0, 1)
        values = []
        for k, start in enumerate(starts):
            if p_low[k] == p_high[k]:
                values.append(casadi.MX(start))
                continue
            values.append(stage.variable())
            stage.set_initial(values[-1], start)
            for constraint in bounded(values[-1], p_low[k : k + 1], p_high[k : k + 1]):
                stage.subject_to(constraint)
            if first_p:
                master.subject_to(stage.at_t0(values[-1]) == first_p[k])
        # The objective and the constraints between phases see a variable of a stage as its value at the start.
        first_p = first_p or [
            value if p_low[k] == p_high[k] else stage.at_t0(value) for k, value in enumerate(values)
        ]
        p = casadi.vertcat(*values) if values else casadi.MX(0, 1)
        rate, path, integrand = _at_time(phase, stage.t, x, u, p)
        stage.set_der(x, rate)
        limits = [(x, "states"), (path, "paths")] + [(u, "controls")] * bool(nu)
        for expression, what in limits:
            for constraint in bounded(expression, *phase.bounds(what)):
                stage.subject_to(constraint)
        for at, end in ((stage.at_t0(x), "initial"), (stage.at_tf(x), "final")):
            for constraint in bounded(at, *phase.bounds("states", end)):
                stage.subject_to(constraint)
        for at, low, high in (
            (stage.t0, phase.start_lower, phase.start_upper),
            (stage.tf, phase.end_lower, phase.end_upper),
        ):
            if not (fixed or (low == high and at is stage.t0)):
                for constraint in bounded(at, [low], [high]):
                    stage.subject_to(constraint)
        integrals = [stage.integral(integrand[k]) for k in range(phase.integrals)]
        ends += [stage.t0, stage.tf, stage.at_t0(x), stage.at_tf(x), *integrals]
        # rockit 0.6.7 fails on arrays for states of collocation; it accepts functions of time.
        places = np.linspace(0, 1, 4 * INTERVALS + 1)
        times = guess.start + places * span
        for symbol, values_at in zip((x, u), sampled(guess, places), strict=True):
            if symbol.numel():
                line = casadi.interpolant("line", "linear", [times], values_at.ravel("F"))
                stage.set_initial(symbol, line(stage.t))
        stage.method(package.DirectCollocation(N=INTERVALS, M=1, degree=DEGREE))
        parts.append((stage, x, u, nx, nu))
    objective, boundary = definition.endpoint(
        casadi.vertcat(*ends), casadi.vertcat(*first_p) if first_p else casadi.MX(0, 1)
    )
    for constraint in bounded(boundary, *definition.bounds("boundaries")):
        master.subject_to(constraint)
    master.add_objective(objective)
    master.solver("ipopt", dict(QUIET))
    try:
        found, status = master.solve(), "Solve_Succeeded"
    except RuntimeError as error:
        if "return_status" not in str(error):
            raise
        found, status = master.non_converged_solution, str(error).rsplit("'", 2)[-2][:80]
    nodes = np.array([0.0, *casadi.collocation_points(DEGREE, "radau")]) * 2 - 1
    plans = []
    for stage, x, u, nx, nu in parts:
        part = found(stage)
        knots, at_knots = part.sample(x, grid="control")
        _, roots = part.sample(x, grid="integrator_roots")
        at_knots, roots = at_knots.reshape(-1, nx), roots.reshape(-1, nx)
        controls = np.empty((INTERVALS, 0))
        if nu:
            controls = part.sample(u, grid="control")[1].reshape(-1, nu)[:INTERVALS]
        plans.append(
            {
                "knots": knots,
                "state_nodes": [nodes] * INTERVALS,
                "control_nodes": [[0.0]] * INTERVALS,
                "states": [
                    np.vstack([at_knots[k], roots[k * DEGREE : (k + 1) * DEGREE]])
                    for k in range(INTERVALS)
                ],
                "controls": [controls[k : k + 1] for k in range(INTERVALS)],
            }
        )
    values = [float(found(parts[0][0]).value(value)) for value in first_p]
    return {
        "status": status,
        "claims": status == "Solve_Succeeded",
        "objective": float(found.value(objective)),
        "plan": plan_of_nodes(definition, plans, values),
    }
