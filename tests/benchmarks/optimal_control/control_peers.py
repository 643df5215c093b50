"""Other packages for optimal control in Python, each in a separate process.

Methods and requirements:

* `yapss <https://github.com/stevenrhall/yapss>`_ 0.2.3 transcribes by LG, LGR or LGL on a mesh that
  is fixed. CasADi differentiates, NumPy assembles, and the Ipopt in CasADi's wheel is called
  by ctypes. It requires ``casadi<=3.7.2``, which our pins exclude.
* `maptor <https://github.com/maptor/maptor>`_ 0.2.1 is LGR with hp refinement on ``casadi.Opti``;
  it works with any CasADi, so the extra ``benchmark`` includes it.
* `mpopt <https://github.com/mpopt/mpopt>`_ 0.2.2 moves the widths of a fixed number of segments. It
  requires ``numpy==1.22.0``, which Python 3.11 and later cannot install, but runs with current versions if it
  is installed without dependencies. Its hp method fails with an unassigned variable.

A peer is searched in ``build/peers/<name>``, then among our own packages::

    python3 -m venv build/peers/yapss
    build/peers/yapss/bin/pip install yapss==0.2.3
    python3 -m venv build/peers/mpopt
    build/peers/mpopt/bin/pip install --no-deps mpopt==0.2.2
    build/peers/mpopt/bin/pip install casadi==3.8.2 numpy scipy matplotlib

Those processes run this file as a script, so its top imports only the standard library. The equations of motion are
defined here once for all peers. Bounds, guess and typical sizes come from our own problem.
"""

from __future__ import annotations

import json
import math
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["Runner", "missing", "plan_of"]

ROOT = Path(__file__).resolve().parents[3]
#: Time limit (s) of the imports of a process.
START = 120.0


# -- the parent's side -----------------------------------------------------------------------------


def interpreter(peer: str) -> str:
    """Return the Python that has `peer`."""
    own = ROOT / "build" / "peers" / peer / "bin" / "python"
    return str(own) if own.exists() else sys.executable


def missing(peer: str) -> str:
    """Return the reason if `peer` cannot run, else an empty string."""
    if peer == "ours":
        return ""
    code = "from mpopt import mp" if peer == "mpopt" else f"import {peer}"
    found = subprocess.run([interpreter(peer), "-c", code], capture_output=True, text=True)
    if found.returncode == 0:
        return ""
    last = (found.stderr.strip().splitlines() or ["it ends"])[-1]
    return f"{peer} is not in build/peers/{peer} ({last}); see tests/benchmarks/optimal_control/control_peers.py"


class Runner:
    """One solver on one problem in a process of its own, which stays between runs.

    Parameters
    ----------
    peer : str
        ``"ours"``, ``"yapss"``, ``"maptor"`` or ``"mpopt"``.
    task : dict
        Problem, settings and options.
    """

    def __init__(self, peer: str, task: dict[str, Any]) -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            [interpreter(peer), str(Path(__file__).resolve()), peer],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )
        self.peer = peer
        self.started = self._ask(task, START)

    def _ask(self, what: Any, limit: float) -> dict[str, Any]:
        into, out = self.process.stdin, self.process.stdout
        assert into is not None
        assert out is not None
        into.write(json.dumps(what) + "\n")
        into.flush()
        ready, _, _ = select.select([out], [], [], limit)
        if not ready:
            self.process.kill()
            return {"seconds": None, "ended": f"given up after {limit:g} s"}
        line = out.readline()
        if not line:
            raise RuntimeError(f"the process of {self.peer} has ended")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def run(self, limit: float = 60.0) -> dict[str, Any]:
        """Return what one call gave: seconds, objective, iterations, the plan; or its error."""
        return self._ask("run", limit)

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def plan_of(problem: Any, answer: dict[str, Any]) -> Any:
    """Return a peer's answer as a plan of `problem`, which can then be verified."""
    import numpy as np

    from crosstrack.models.optimal_control.plan import ControlPlan, PhasePlan, Piecewise

    phase = problem.definition.phases[0]
    knots = np.array(answer["knots"])
    lists = {
        name: tuple(np.array(part, float) for part in answer[name])
        for name in ("state_nodes", "states", "control_nodes", "controls")
    }
    for name in ("state_nodes", "control_nodes"):
        lists[name] = tuple(np.clip(part, -1.0, 1.0) for part in lists[name])
    bounds = [phase.stacked("controls", side) for side in ("lower", "upper")]
    controls = tuple(np.clip(part, *bounds) for part in lists["controls"])
    return ControlPlan(
        (
            PhasePlan(
                phase.name,
                Piecewise(knots, lists["state_nodes"], lists["states"]),
                Piecewise(knots, lists["control_nodes"], controls, *bounds),
                phase.state_names,
                phase.control_names,
            ),
        ),
        {},
    )


def facts(problem: Any) -> dict[str, Any]:
    """Return bounds, guess and typical sizes of a problem of one phase, as JSON data."""
    phase = problem.definition.phases[0]
    data: dict[str, Any] = {
        f"{what}_{side}": phase.stacked(what, side).tolist()
        for what in ("states", "controls", "paths")
        for side in ("lower", "upper", "scale")
    }
    for side in ("initial_lower", "initial_upper", "final_lower", "final_upper"):
        data[side] = phase.stacked("states", side).tolist()
    guess = phase.guess
    data["start"] = [phase.start_lower, phase.start_upper]
    data["end"] = [phase.end_lower, phase.end_upper]
    data["guess_times"] = [guess.start, guess.end]
    data["guess_fractions"] = guess.fractions.tolist()
    data["guess_states"] = guess.states.T.tolist()
    data["guess_controls"] = guess.controls.T.tolist()
    return data


# -- equations of motion, for all peers ------------------------------------------------------------
# Each takes states, controls and a module with sin, cos, exp; and returns rates, paths, and what is
# integrated (None where the end alone counts).


def brachistochrone(x: Any, u: Any, m: Any) -> tuple[list[Any], list[Any], Any]:
    return [x[2] * m.sin(u[0]), -x[2] * m.cos(u[0]), 9.80665 * m.cos(u[0])], [], None


def bryson_denham(x: Any, u: Any, m: Any) -> tuple[list[Any], list[Any], Any]:
    return [x[1], u[0]], [], u[0] ** 2 / 2


def hypersensitive(x: Any, u: Any, m: Any) -> tuple[list[Any], list[Any], Any]:
    return [-(x[0] ** 3) + u[0]], [], (x[0] ** 2 + u[0] ** 2) / 2


def goddard(x: Any, u: Any, m: Any) -> tuple[list[Any], list[Any], Any]:
    h, v, mass = x[0], x[1], x[2]
    drag = 310.0 * v**2 * m.exp(-500.0 * (h - 1))
    return [v, (u[0] - drag) / mass - 1 / h**2, -u[0] / 0.5], [], None


def slew(x: Any, u: Any, m: Any) -> tuple[list[Any], list[Any], Any]:
    """Return the paper's slew, in components."""
    q, w, delta = (
        [x[k] for k in range(4)],
        [x[k] for k in range(4, 7)],
        [x[k] for k in range(7, 11)],
    )
    h0, inertia = 17.53, (228.0, 188.0, 176.0)
    cb, sb = math.cos(math.radians(54.73)), math.sin(math.radians(54.73))
    s, c = [m.sin(d) for d in delta], [m.cos(d) for d in delta]
    rows = [
        [-cb * c[0], s[1], cb * c[2], -s[3]],
        [-s[0], -cb * c[1], s[2], cb * c[3]],
        [sb * c[0], sb * c[1], sb * c[2], sb * c[3]],
    ]
    torque = [-h0 * sum(rows[i][k] * u[k] for k in range(4)) for i in range(3)]
    direction = [
        -cb * s[0] - c[1] + cb * s[2] + c[3],
        c[0] - cb * s[1] - c[2] + cb * s[3],
        sb * (s[0] + s[1] + s[2] + s[3]),
    ]
    g = [[sum(a[k] * b[k] for k in range(4)) for b in rows] for a in rows]
    measure = (
        g[0][0] * (g[1][1] * g[2][2] - g[1][2] * g[1][2])
        - g[0][1] * (g[0][1] * g[2][2] - g[1][2] * g[0][2])
        + g[0][2] * (g[0][1] * g[1][2] - g[1][1] * g[0][2])
    )
    total = [inertia[i] * w[i] + h0 * direction[i] for i in range(3)]

    def cross(a: Any, b: Any) -> list[Any]:
        return [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]

    turning, gyration = cross(w, q[1:]), cross(w, total)
    rates = [
        -0.5 * sum(w[i] * q[1 + i] for i in range(3)),
        *(0.5 * q[0] * w[i] - 0.5 * turning[i] for i in range(3)),
        *((torque[i] - gyration[i]) / inertia[i] for i in range(3)),
        *(u[k] for k in range(4)),
    ]
    return rates, [measure, *torque], 1.0 + 0.1 * sum(u[k] ** 2 for k in range(4))


#: Equations of motion, and the objective of the final state and time, or None for an integral objective.
MOTIONS: dict[str, tuple[Callable[..., Any], Callable[..., Any] | None]] = {
    "optimal-control/brachistochrone": (brachistochrone, lambda x, t: t),
    "optimal-control/bryson-denham": (bryson_denham, None),
    "optimal-control/hypersensitive-40": (hypersensitive, None),
    "optimal-control/goddard": (goddard, lambda x, t: -x[0]),
    "satellite-slew/paper-components": (slew, None),
}


# -- the processes' side ---------------------------------------------------------------------------


def numbers(values: list[Any]) -> list[float]:
    """Return floats, JSON's names of infinity read."""
    return [float(v) for v in values]


def guessed(task: dict[str, Any], fractions: Any) -> tuple[Any, Any]:
    """Return the guess at `fractions`: states and controls, a row each."""
    import numpy as np

    at = task["guess_fractions"]
    states = np.array([np.interp(fractions, at, row) for row in task["guess_states"]])
    controls = np.array([np.interp(fractions, at, row) for row in task["guess_controls"]])
    return states, controls


def ours(task: dict[str, Any]) -> Callable[[], dict[str, Any]]:
    """Return our own call: the problem is declared at the first one."""
    import crosstrack as ct

    ct.load("optimal-control/double-integrator-energy")
    kept: list[Any] = []

    def call() -> dict[str, Any]:
        begin = time.perf_counter()
        if not kept:
            kept.append(ct.load(task["case"]))
        options = task["options"]
        found = ct.solve(
            kept[0],
            task.get("backend", "ipopt"),
            tolerance=task["tolerance"],
            formulation=task["formulation"],
            formulation_options=options,
            starts=1,
        )
        whole = time.perf_counter() - begin
        checks = found.verification.checks if found.verification else ()
        worst = {one.name: one.worst / one.tolerance * task["tolerance"] for one in checks}
        own = whole - found.seconds.get("verify", 0.0)
        return {
            "seconds": whole,
            "own": own,
            "parts": dict(found.seconds),
            "objective": found.verification.objective if found.verification else None,
            "iterations": found.statistics.get("iterations"),
            "nodes": found.statistics.get("nodes"),
            "meshes": found.statistics.get("meshes", 1),
            "worst": worst,
            "ended": str(found.termination) + (f": {found.message}" if found.message else ""),
        }

    return call


def yapss(task: dict[str, Any]) -> Callable[[], dict[str, Any]]:
    """Return the call of yapss on a fixed mesh."""
    import numpy as np
    import yapss as package
    from yapss import math as functions
    from yapss._private import solver

    rates, objective = MOTIONS[task["case"]]
    spent: list[float] = []
    within = solver._solve_ipopt_problem

    def timed(*args: Any) -> Any:
        begin = time.perf_counter()
        try:
            return within(*args)
        finally:
            spent.append(time.perf_counter() - begin)

    solver._solve_ipopt_problem = timed
    kept: list[Any] = []
    count = [0]
    plain = package.Problem._intermediate_cb

    def counted(problem: Any, *args: Any) -> bool:
        count[0] = int(args[1])
        return bool(plain(problem, *args))

    package.Problem._intermediate_cb = counted

    def declared() -> Any:
        nx, nu, nh = (len(task[f"{what}_lower"]) for what in ("states", "controls", "paths"))
        nq = int(objective is None)
        problem = package.Problem(name="peer", nx=[nx], nu=[nu], nq=[nq], nh=[nh])

        def goal(arg: Any) -> None:
            one = arg.phase[0]
            if objective is None:
                arg.objective = one.integral[0]
            else:
                arg.objective = objective(one.final_state, one.final_time)

        def motion(arg: Any) -> None:
            one = arg.phase[0]
            f, path, integrand = rates(one.state, one.control, functions)
            one.dynamics[:] = f
            if nh:
                one.path[:] = path
            if nq:
                one.integrand[:] = (integrand,)

        problem.functions.objective, problem.functions.continuous = goal, motion
        bounds = problem.bounds.phase[0]
        for name, low, high in (
            ("initial_state", "initial_lower", "initial_upper"),
            ("final_state", "final_lower", "final_upper"),
            ("state", "states_lower", "states_upper"),
            ("control", "controls_lower", "controls_upper"),
            ("path", "paths_lower", "paths_upper"),
        ):
            if task[low]:
                getattr(bounds, name).lower[:] = numbers(task[low])
                getattr(bounds, name).upper[:] = numbers(task[high])
        bounds.initial_time.lower, bounds.initial_time.upper = numbers(task["start"])
        bounds.final_time.lower, bounds.final_time.upper = numbers(task["end"])
        guess = problem.guess.phase[0]
        first, last = task["guess_times"]
        guess.time = [first + f * (last - first) for f in task["guess_fractions"]]
        guess.state, guess.control = task["guess_states"], task["guess_controls"]
        if nq:
            guess.integral = [1.0]
        scale = problem.scale.phase[0]
        scale.state = scale.dynamics = numbers(task["states_scale"])
        scale.control = numbers(task["controls_scale"])
        if nh:
            scale.path = numbers(task["paths_scale"])
        scale.time = float(last - first)
        problem.spectral_method = task["method"]
        intervals, degree = task["intervals"], task["degree"]
        problem.mesh.phase[0].collocation_points = intervals * (degree,)
        problem.mesh.phase[0].fraction = intervals * (1 / intervals,)
        problem.derivatives.method, problem.derivatives.order = "auto", "second"
        problem.ipopt_options.print_level, problem.ipopt_options.sb = 0, "yes"
        for name, value in task["ipopt"].items():
            setattr(problem.ipopt_options, name, value)
        return problem

    def call() -> dict[str, Any]:
        begin = time.perf_counter()
        if not kept:
            kept.append(declared())
        found = kept[0].solve()
        whole = time.perf_counter() - begin
        one = found.phase[0]
        intervals, degree = task["intervals"], task["degree"]
        knots = np.linspace(one.initial_time, one.final_time, intervals + 1)
        x, u = np.array(one.state), np.array(one.control)
        at, at_control = np.array(one.time), np.array(one.time_c)
        plan: dict[str, Any] = {
            "state_nodes": [],
            "states": [],
            "control_nodes": [],
            "controls": [],
        }
        step = degree + int(task["method"] == "lg")
        for k in range(intervals):
            middle, half = 0.5 * (knots[k] + knots[k + 1]), 0.5 * (knots[k + 1] - knots[k])
            own = slice(k * step, (k + 1) * step + 1)
            plan["state_nodes"].append(((at[own] - middle) / half).tolist())
            plan["states"].append(x[:, own].T.tolist())
            own = slice(k * degree, (k + 1) * degree)
            plan["control_nodes"].append(((at_control[own] - middle) / half).tolist())
            plan["controls"].append(u[:, own].T.tolist())
        return {
            "seconds": whole,
            "parts": {"solve": spent[-1]},
            "objective": float(found.objective),
            "iterations": count[0],
            "nodes": intervals * degree,
            "ended": str(found.nlp_info.ipopt_status),
            "knots": knots.tolist(),
            **plan,
        }

    return call


def maptor(task: dict[str, Any]) -> Callable[[], dict[str, Any]]:
    """Return the call of maptor: on a fixed mesh, or refined where ``adaptive`` has a tolerance."""
    import logging

    import casadi
    import maptor as package
    import numpy as np
    from maptor.radau import _compute_radau_collocation_components as radau

    logging.disable(logging.CRITICAL)
    rates, objective = MOTIONS[task["case"]]

    def side(low: float, high: float) -> Any:
        if low == high:
            return low
        pair = tuple(None if not math.isfinite(v) else v for v in (low, high))
        return None if pair == (None, None) else pair

    def declared() -> Any:
        problem = package.Problem("peer")
        phase = problem.set_phase(1)
        clock = phase.time(initial=side(*task["start"]), final=side(*task["end"]))
        states = [
            phase.state(
                f"x{k}",
                initial=side(task["initial_lower"][k], task["initial_upper"][k]),
                final=side(task["final_lower"][k], task["final_upper"][k]),
                boundary=side(task["states_lower"][k], task["states_upper"][k]),
            )
            for k in range(len(task["states_lower"]))
        ]
        controls = [
            phase.control(
                f"u{k}", boundary=side(task["controls_lower"][k], task["controls_upper"][k])
            )
            for k in range(len(task["controls_lower"]))
        ]
        f, path, integrand = rates(states, controls, casadi)
        phase.dynamics(dict(zip(states, f, strict=True)))
        limits = []
        for k, one in enumerate(path):
            low, high = task["paths_lower"][k], task["paths_upper"][k]
            limits += [one >= low] * math.isfinite(low) + [one <= high] * math.isfinite(high)
        if limits:
            phase.path_constraints(*limits)
        if objective is None:
            problem.minimize(phase.add_integral(integrand))
        else:
            problem.minimize(objective([one.final for one in states], clock.final))
        intervals, degree = task["intervals"], task["degree"]
        cuts = np.linspace(-1, 1, intervals + 1)
        phase.mesh([degree] * intervals, cuts)
        nodes = radau(degree)
        tables: tuple[list[Any], list[Any]] = ([], [])
        for k in range(intervals):
            for table, points, which in (
                (tables[0], nodes.state_approximation_nodes, 0),
                (tables[1], nodes.collocation_nodes, 1),
            ):
                place = cuts[k] + 0.5 * (np.ravel(points) + 1) * (cuts[k + 1] - cuts[k])
                table.append(guessed(task, 0.5 * (place + 1))[which])
        phase.guess(
            states=tables[0],
            controls=tables[1],
            initial_time=task["guess_times"][0],
            terminal_time=task["guess_times"][1],
            integrals=1.0 if objective is None else None,
        )
        return problem

    def call() -> dict[str, Any]:
        begin = time.perf_counter()
        options = {f"ipopt.{name}": value for name, value in task["ipopt"].items()}
        options.update({"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False})
        problem = declared()
        if "adaptive" in task:
            found = package.solve_adaptive(
                problem, nlp_options=options, show_summary=False, **task["adaptive"]
            )
        else:
            found = package.solve_fixed_mesh(problem, nlp_options=options, show_summary=False)
        whole = time.perf_counter() - begin
        if not found.status["success"]:
            return {"seconds": whole, "ended": str(found.status.get("message", "failed"))[:200]}
        one = found.phases[1]
        degrees = [int(n) for n in one["mesh"]["polynomial_degrees"]]
        first, last = one["times"]["initial"], one["times"]["final"]
        knots = first + 0.5 * (np.array(one["mesh"]["mesh_nodes"], float) + 1) * (last - first)
        x = np.array([found[1, f"x{k}"] for k in range(len(task["states_lower"]))])
        u = np.array([found[1, f"u{k}"] for k in range(len(task["controls_lower"]))])
        plan: dict[str, Any] = {
            "state_nodes": [],
            "states": [],
            "control_nodes": [],
            "controls": [],
        }
        at = at_state = 0
        for degree in degrees:
            nodes = radau(degree)
            plan["state_nodes"].append(np.ravel(nodes.state_approximation_nodes).tolist())
            plan["states"].append(x[:, at_state : at_state + degree + 1].T.tolist())
            plan["control_nodes"].append(np.ravel(nodes.collocation_nodes).tolist())
            plan["controls"].append(u[:, at : at + degree].T.tolist())
            at, at_state = at + degree, at_state + degree + 1
        refined = found.adaptive if "adaptive" in task else {}
        return {
            "seconds": whole,
            "objective": float(found.status["objective"]),
            "nodes": sum(degrees),
            "meshes": refined.get("iterations", 0) + 1,
            "ended": "converged" if refined.get("converged", True) else "not converged",
            "knots": knots.tolist(),
            **plan,
        }

    return call


def mpopt(task: dict[str, Any]) -> Callable[[], dict[str, Any]]:
    """Return the call of mpopt: on equal segments, or on moved ones where ``adaptive`` is given."""
    import casadi
    import numpy as np
    from mpopt import mp

    mp.mpopt._MUTE_ = True
    rates, objective = MOTIONS[task["case"]]
    nx, nu = len(task["states_lower"]), len(task["controls_lower"])

    def declared() -> Any:
        problem = mp.OCP(n_states=nx, n_controls=nu)

        def parts(x: Any, u: Any) -> Any:
            return rates([x[k] for k in range(nx)], [u[k] for k in range(nu)], casadi)

        problem.dynamics[0] = lambda x, u, t: parts(x, u)[0]
        if objective is None:
            problem.running_costs[0] = lambda x, u, t: parts(x, u)[2]
        else:
            problem.terminal_costs[0] = lambda xf, tf, x0, t0: objective(
                [xf[k] for k in range(nx)], tf
            )
        if task["paths_lower"]:
            problem.path_constraints[0] = lambda x, u, t: [
                piece
                for k, one in enumerate(parts(x, u)[1])
                for piece in (
                    [task["paths_lower"][k] - one] * math.isfinite(task["paths_lower"][k])
                    + [one - task["paths_upper"][k]] * math.isfinite(task["paths_upper"][k])
                )
            ]
        ends = [k for k in range(nx) if task["final_lower"][k] == task["final_upper"][k]]
        if ends:
            problem.terminal_constraints[0] = lambda xf, tf, x0, t0: [
                xf[k] - task["final_lower"][k] for k in ends
            ]
        problem.x00[0] = numbers(task["initial_lower"])
        problem.lbx[0], problem.ubx[0] = (
            numbers(task["states_lower"]),
            numbers(task["states_upper"]),
        )
        problem.lbu[0] = numbers(task["controls_lower"])
        problem.ubu[0] = numbers(task["controls_upper"])
        problem.lbtf[0], problem.ubtf[0] = task["end"]
        problem.tf0[0] = task["guess_times"][1]
        problem.scale_x = 1.0 / np.array(numbers(task["states_scale"]))
        problem.scale_u = 1.0 / np.array(numbers(task["controls_scale"]))
        problem.midu[:] = int(task.get("between", True))
        problem.validate()
        return problem

    def call() -> dict[str, Any]:
        begin = time.perf_counter()
        problem = declared()
        intervals, degree = task["intervals"], task["degree"]
        options = {f"ipopt.{name}": value for name, value in task["ipopt"].items()}
        fractions = []
        taus = mp.CollocationRoots("LGR")._taus_fn(degree)
        for k in range(intervals):
            fractions += [(k + 0.5 * (t + 1)) / intervals for t in taus[int(k > 0) :]]
        x, u = guessed(task, fractions)
        first, last = task["guess_times"]
        start = np.concatenate(
            [
                (x * problem.scale_x[:, None]).ravel(),
                (u * problem.scale_u[:, None]).ravel(),
                [first, last],
            ]
        )
        if "adaptive" in task:
            mp.mpopt_h_adaptive._TOL_RESIDUAL = task["adaptive"]["residual"]
            call = mp.mpopt_h_adaptive(problem, intervals, degree)
            extra = {
                "max_iter": task["adaptive"]["rounds"],
                "mpopt_options": {"method": "residual", "sub_method": "merge_split"},
            }
        else:
            call, extra = mp.mpopt(problem, intervals, degree), {}
        found = call.solve(initial_solution={"x": start}, nlp_solver_options=options, **extra)
        whole = time.perf_counter() - begin
        stats = call.nlp_solver.stats()
        post = call.process_results(found, plot=False)
        x, u, t, _ = post.get_original_data()
        t = t.ravel()
        knots = t[::degree]
        plan: dict[str, Any] = {
            "state_nodes": [],
            "states": [],
            "control_nodes": [],
            "controls": [],
        }
        for k in range(intervals):
            own = slice(k * degree, (k + 1) * degree + 1)
            for nodes, values, table in (
                ("state_nodes", "states", x),
                ("control_nodes", "controls", u),
            ):
                plan[nodes].append(np.asarray(taus).tolist())
                plan[values].append(table[own].tolist())
        return {
            "seconds": whole,
            "objective": float(found["f"]),
            "nodes": intervals * degree + 1,
            "meshes": getattr(call, "iter_count", 1),
            "iterations": stats.get("iter_count"),
            "ended": str(stats.get("return_status")),
            "knots": knots.tolist(),
            **plan,
        }

    return call


def serve(peer: str) -> None:
    """Answer on the standard output what is asked on the standard input, a JSON line each."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever libraries print goes elsewhere

    def reply(data: Any) -> None:
        answers.write(json.dumps(data) + "\n")
        answers.flush()

    task = json.loads(sys.stdin.readline())
    begin = time.perf_counter()
    call = {"ours": ours, "yapss": yapss, "maptor": maptor, "mpopt": mpopt}[peer](task)
    import casadi

    reply({"imports": time.perf_counter() - begin, "casadi": casadi.__version__})
    for line in sys.stdin:
        if json.loads(line) != "run":
            break
        try:
            reply(call())
        except Exception as error:
            reply({"seconds": None, "ended": f"{type(error).__name__}: {error}"[:300]})


if __name__ == "__main__":
    serve(sys.argv[1])
