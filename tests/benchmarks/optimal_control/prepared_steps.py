"""Closed loops of two tracking problems: prepared steps beside CasADi's ``nlpsol`` written by hand.

``python tests/benchmarks/optimal_control/prepared_steps.py`` writes ``docs/measured/prepared-steps.json``.
All solvers get the same states in turn, each warm from its own last step, on the same Radau transcription.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import casadi
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from optimal_control.steered import TRACKING, tracking

import crosstrack as ct

INTERVALS, DEGREE, STEPS = 10, 3, 60
#: Seconds between two steps, standard deviation of the disturbance of a state, and tolerance of the
#: verification.
STEP, NOISE, TOLERANCE = 0.05, 1e-3, 1e-2
#: Ipopt options of the bare program, cold and warm: those of a prepared solver.
IPOPT = {"tol": 3e-9, "constr_viol_tol": 1e-10, "print_level": 0, "sb": "yes", "max_iter": 3000}
NEAR = 1e-8
WARM = {
    "warm_start_init_point": "yes",
    "mu_init": NEAR,
    "warm_start_bound_push": NEAR,
    "warm_start_mult_bound_push": NEAR,
    "warm_start_slack_bound_push": NEAR,
}


def bare(name: str) -> tuple[Any, Any, dict[str, Any]]:
    """Return Radau collocation of a tracking problem as plain ``nlpsol``, cold and warm, and its arguments."""
    rates, cost, horizon, first, control, state_bounds, control_bounds = TRACKING[name]
    tau = casadi.collocation_points(DEGREE, "radau")
    slope, _, weights = casadi.collocation_coeff(tau)
    length, points, states = horizon / INTERVALS, INTERVALS * DEGREE, len(first)
    x, u = casadi.SX.sym("x", states, points + 1), casadi.SX.sym("u", len(control), points)
    p, now = casadi.SX.sym("p", states), casadi.SX.sym("now")
    rows, total = [x[:, 0] - p], 0
    for k in range(INTERVALS):
        own = x[:, k * DEGREE : (k + 1) * DEGREE + 1]
        slopes = casadi.mtimes(own, slope)
        for j in range(DEGREE):
            at = own[:, j + 1], u[:, k * DEGREE + j]
            rows.append(slopes[:, j] - length * rates(*at))
            total += length * weights[j] * cost(*at, now + length * (k + tau[j]))
    total += cost(x[:, -1], casadi.DM.zeros(len(control)), now + horizon)
    columns = casadi.vertcat(casadi.vec(x), casadi.vec(u))
    program = {"x": columns, "p": casadi.vertcat(p, now), "f": total, "g": casadi.vertcat(*rows)}
    call: Any = casadi
    cold, warm = (
        call.nlpsol("bare", "ipopt", program, {"print_time": False, "ipopt": {**IPOPT, **more}})
        for more in ({}, WARM)
    )
    arguments: dict[str, Any] = {"lbg": 0.0, "ubg": 0.0}
    for key, at_states, at_controls in (
        ("lbx", state_bounds[0], control_bounds[0]),
        ("ubx", state_bounds[1], control_bounds[1]),
        ("x0", first, control),
    ):
        arguments[key] = np.append(np.tile(at_states, points + 1), np.tile(at_controls, points))
    return cold, warm, arguments


def loop(name: str, steps: int = STEPS) -> dict[str, Any]:
    """Return CPU seconds and iterations of every step by solver, and the largest differences of the optima.

    The seconds of the prepared steps include the first controls, without a plan. ``"verification"``
    contains the seconds of the verification of every tenth step, ``"accepted"`` the number that verified.
    """
    rates, _, _, first, control, _, _ = TRACKING[name]
    cold, warm, arguments = bare(name)
    options = {"formulation": "radau", "intervals": INTERVALS, "degree": DEGREE}
    solvers = {
        "prepared, structured": ct.prepare(tracking(name), structured=True, **options),
        "prepared, ipopt": ct.prepare(tracking(name), structured=False, **options),
    }
    s, c = casadi.SX.sym("s", len(first)), casadi.SX.sym("c", len(control))
    plant = casadi.integrator("plant", "rk", {"x": s, "p": c, "ode": rates(s, c)}, 0, STEP)
    rng, state = np.random.default_rng(0), np.array(first, float)
    seconds: dict[str, list[float]] = {"bare nlpsol, ipopt": [], **{key: [] for key in solvers}}
    iterations = {key: [] for key in seconds}
    differences, verified, last = {key: [] for key in solvers}, [], arguments
    accepted = 0
    for number in range(steps):
        solver = warm if number else cold
        begin = time.process_time()
        found = solver(p=np.append(state, number * STEP), **last)
        np.array(found["x"])
        seconds["bare nlpsol, ipopt"].append(time.process_time() - begin)
        assert solver.stats()["success"]
        iterations["bare nlpsol, ipopt"].append(int(solver.stats()["iter_count"]))
        last = {**arguments, "x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        force = None
        for key, prepared in solvers.items():
            begin = time.process_time()
            step = prepared(x0=state, now=number * STEP, warm=True)
            applied = step.u0
            seconds[key].append(time.process_time() - begin)
            assert step.ok
            iterations[key].append(step.iterations)
            objective = float(found["f"])
            differences[key].append(abs(step.objective - objective) / abs(objective))
            if force is None:
                force = applied
                if number % 10 == 0:
                    step.plan  # noqa: B018 - decoding is not part of the verification
                    begin = time.process_time()
                    accepted += step.verification(TOLERANCE).ok
                    verified.append(time.process_time() - begin)
        state = np.array(plant(x0=state, p=force)["xf"]).reshape(-1)
        state += NOISE * rng.normal(size=state.size)
    return {
        "seconds": {key: np.array(value) for key, value in seconds.items()},
        "iterations": iterations,
        "difference": {key: max(value) for key, value in differences.items()},
        "verification": np.array(verified),
        "accepted": accepted,
    }


def rows(name: str, result: dict[str, Any]) -> list[list[Any]]:
    """Return the rows of the table: milliseconds of the warm steps, and of the cold first one."""
    base = result["seconds"]["bare nlpsol, ipopt"][1:]
    table = []
    for key, value in result["seconds"].items():
        own = value[1:]
        table.append([
            name, key, 1e3 * np.median(own), 1e3 * np.percentile(own, 99), 1e3 * value[0],
            float(np.mean(result["iterations"][key][1:])), float(np.median(own / base)),
            result["difference"].get(key),
        ])  # fmt: skip
    checked = result["verification"]
    label = f"verification of {checked.size} steps, {result['accepted']} accepted"
    table.append([name, label, 1e3 * np.median(checked), 1e3 * checked.max(), None,
                  None, float(np.median(checked) / np.median(base)), None])  # fmt: skip
    return table


if __name__ == "__main__":
    from benchmarks.measured import write

    columns = {
        "problem": "", "solver": "", "median, ms": ".2f", "99th percentile, ms": ".2f",
        "cold, ms": ".1f", "iterations": ".1f", "ratio": ".2f", "largest difference": ".1e",
    }  # fmt: skip
    table = [row for name in TRACKING for row in rows(name, loop(name))]
    write("prepared-steps", "tracking", __file__, columns, table, ["casadi", "numpy"])
    for row in table:
        print(*row)
