"""Other packages on problems declared here: each adapter generates the program of a package from a definition.

The scoreboard runs this file with the interpreter of a package, see ``scoreboard.py``::

    python scoreboard_peers.py SOLVER FOLDER LIMIT LONGEST NAME ...

A forked process per problem solves it within `LIMIT` seconds of CPU time and writes its answer to the folder. All
packages get the same functions (CasADi graphs), bounds and guess. The mesh is uniform with 60 intervals of 3
nodes per phase (dymos: 20), and a package that has a refinement runs it with its defaults. Ipopt and the
package keep their default tolerances.
"""

from __future__ import annotations

import importlib
import itertools
import json
import math
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parent)]

import casadi  # noqa: E402
import numpy as np  # noqa: E402
from bare import DEGREE, INTERVALS, plan_of_nodes, solve_bare  # noqa: E402
from scoreboard_parts import (  # noqa: E402
    QUIET,
    Unsupported,
    bounded,
    guessed_integrals,
    nodes_per_interval,
    problem_of,
    sampled,
)

__all__ = ["SOLVERS", "TOO_LONG"]

#: Terminations of ours that claim an optimum.
CLAIMS = ("optimal", "locally_optimal")
#: Code of a process that took too long.
TOO_LONG = 124


def ours(problem: Any) -> dict[str, Any]:
    """Solve with one call at defaults."""
    import crosstrack as ct

    solution = ct.solve(problem)
    return {
        "status": str(solution.termination),
        "claims": str(solution.termination) in CLAIMS,
        "objective": solution.primal_bound,
        "message": solution.message or "",
        "plan": solution.plan,
    }


def bare(problem: Any) -> dict[str, Any]:
    """Solve by the bare program."""
    answer = solve_bare(problem)
    return {
        "status": answer.status,
        "claims": answer.success,
        "objective": answer.objective,
        "plan": answer.plan,
    }


def yapss(problem: Any) -> dict[str, Any]:
    """Solve by yapss: flipped Radau on a fixed mesh, with CasADi's derivatives."""
    import yapss as package
    from yapss.math.wrapper import SXW

    definition = problem.definition
    phases = definition.phases
    try:
        functions = [phase.function.expand() for phase in phases]
        endpoint = definition.endpoint.expand()
    except RuntimeError as error:
        raise Unsupported("a function without a form in scalar operations") from error

    def raw(values: Any) -> Any:
        return casadi.vertcat(*(SXW(value)._value for value in np.atleast_1d(values).ravel()))

    def wrapped(column: Any) -> list[Any]:
        return [SXW(column[k]) for k in range(column.numel())]

    def ends(arg: Any) -> list[Any]:
        parts = []
        for part in arg.phase:
            parts += [raw(part.initial_time), raw(part.final_time)]
            parts += [raw(part.initial_state), raw(part.final_state), raw(part.integral)]
        return wrapped(casadi.vertcat(*endpoint(casadi.vertcat(*parts), raw(arg.parameter))))

    def objective(arg: Any) -> None:
        arg.objective = ends(arg)[0]

    def discrete(arg: Any) -> None:
        arg.discrete[:] = ends(arg)[1:]

    def continuous(arg: Any) -> None:
        for k in arg.phase_list:
            part = arg.phase[k]
            t, x, u = raw(part.time), raw(part.state), raw(part.control)
            results = functions[k](t, x, u, raw(arg.parameter))
            for name, value in zip(("dynamics", "path", "integrand"), results, strict=False):
                if value.numel():
                    getattr(part, name)[:] = wrapped(value)

    boundary_low, boundary_high = definition.bounds("boundaries")
    peer = package.Problem(
        name="peer",
        nx=[len(phase.state_names) for phase in phases],
        nu=[len(phase.control_names) for phase in phases],
        nh=[phase.stacked("paths", "lower").size for phase in phases],
        nq=[phase.integrals for phase in phases],
        nd=boundary_low.size,
        ns=len(definition.parameter_names),
    )
    peer.functions.objective, peer.functions.continuous = objective, continuous
    if boundary_low.size:
        peer.functions.discrete = discrete
        peer.bounds.discrete.lower[:], peer.bounds.discrete.upper[:] = boundary_low, boundary_high
    starts = definition.stacked("parameters", "initial_lower")
    if definition.parameters:
        low, high = definition.bounds("parameters")
        peer.bounds.parameter.lower[:], peer.bounds.parameter.upper[:] = low, high
        peer.guess.parameter = starts
    for k, phase in enumerate(phases):
        bounds, guess = peer.bounds.phase[k], phase.guess
        for name, (low, high) in {
            "initial_state": phase.bounds("states", "initial"),
            "final_state": phase.bounds("states", "final"),
            "state": phase.bounds("states"),
            "control": phase.bounds("controls"),
            "path": phase.bounds("paths"),
        }.items():
            if low.size:
                getattr(bounds, name).lower[:], getattr(bounds, name).upper[:] = low, high
        bounds.initial_time.lower, bounds.initial_time.upper = phase.start_lower, phase.start_upper
        bounds.final_time.lower, bounds.final_time.upper = phase.end_lower, phase.end_upper
        fractions = guess.fractions if guess.fractions.size > 1 else np.array([0.0, 1.0])
        x, u = sampled(guess, fractions)
        peer.guess.phase[k].time = guess.start + fractions * (guess.end - guess.start)
        peer.guess.phase[k].state, peer.guess.phase[k].control = x, u
        if phase.integrals:
            peer.guess.phase[k].integral = guessed_integrals(phase, starts)
        peer.mesh.phase[k].collocation_points = INTERVALS * (DEGREE,)
        peer.mesh.phase[k].fraction = INTERVALS * (1 / INTERVALS,)
    peer.spectral_method = "lgr"
    peer.derivatives.method, peer.derivatives.order = "auto", "second"
    peer.ipopt_options.print_level, peer.ipopt_options.sb = 0, "yes"
    found = peer.solve()
    parts = []
    for part in found.phase:
        knots = np.linspace(part.initial_time, part.final_time, INTERVALS + 1)
        x, u = np.array(part.state).T, np.array(part.control).reshape(-1, len(part.time_c)).T
        cut = nodes_per_interval(x, u, [DEGREE] * INTERVALS)
        for name, times in (("state_nodes", part.time), ("control_nodes", part.time_c)):
            width = DEGREE + (name == "state_nodes")
            cut[name] = [
                np.clip(2 * (np.array(times[k * DEGREE :][:width]) - a) / (b - a) - 1, -1, 1)
                for k, (a, b) in enumerate(itertools.pairwise(knots))
            ]
        parts.append({"knots": knots, **cut})
    status = int(found.nlp_info.ipopt_status)
    return {
        "status": f"Ipopt {status}",
        "claims": status in (0, 1),
        "objective": float(found.objective),
        "plan": plan_of_nodes(definition, parts, found.parameter),
    }


def _one_or_all(values: Any) -> Any:
    """Return the only value as a float, or all values."""
    return float(values[0]) if len(values) == 1 else values


def maptor(problem: Any) -> dict[str, Any]:
    """Solve by maptor: Radau with its hp refinement at defaults."""
    import logging

    import maptor as package
    from maptor.radau import _compute_radau_collocation_components as radau

    logging.disable(logging.CRITICAL)
    definition = problem.definition

    def side(low: float, high: float) -> Any:
        if low == high:
            return float(low)
        pair = tuple(float(v) if math.isfinite(v) else None for v in (low, high))
        return None if pair == (None, None) else pair

    peer = package.Problem("peer")
    low, high = definition.bounds("parameters")
    p = casadi.MX(0, 1)
    starts = definition.stacked("parameters", "initial_lower")
    for k, start in enumerate(starts):
        fixed = (
            {"fixed": float(low[k])} if low[k] == high[k] else {"boundary": side(low[k], high[k])}
        )
        p = casadi.vertcat(p, peer.parameter(f"p{k}", **fixed))
        peer.parameter_guess(**{f"p{k}": float(start)})
    ends, nodes, parts = [], radau(DEGREE), []
    cuts = np.linspace(-1, 1, INTERVALS + 1)
    for number, phase in enumerate(definition.phases, 1):
        part = peer.set_phase(number)
        clock = part.time(
            initial=side(phase.start_lower, phase.start_upper),
            final=side(phase.end_lower, phase.end_upper),
        )
        sides = [b for at in ("initial", "final", "") for b in phase.bounds("states", at)]
        states = [
            part.state(f"x{k}", initial=side(*b[:2]), final=side(*b[2:4]), boundary=side(*b[4:]))
            for k, b in enumerate(zip(*sides, strict=True))
        ]
        controls = [
            part.control(f"u{k}", boundary=side(*b))
            for k, b in enumerate(zip(*phase.bounds("controls"), strict=True))
        ]
        x, u = (casadi.vertcat(*(v._symbolic_var if hasattr(v, "_symbolic_var") else v for v in group))
                for group in (states, controls))  # fmt: skip
        rate, path, integrand, _ = phase.function(clock._symbolic_var, x, u, p)
        part.dynamics({state: rate[k] for k, state in enumerate(states)})
        limits = list(bounded(path, *phase.bounds("paths")))
        if limits:
            part.path_constraints(*limits)
        integrals = [part.add_integral(integrand[k]) for k in range(phase.integrals)]
        ends += [clock.initial, clock.final]
        ends += [*(s.initial for s in states), *(s.final for s in states), *integrals]
        part.mesh([DEGREE] * INTERVALS, cuts)
        tables: list[list[Any]] = [[], []]
        for k in range(INTERVALS):
            for which, points in enumerate(
                (nodes.state_approximation_nodes, nodes.collocation_nodes)
            ):
                at = cuts[k] + 0.5 * (np.ravel(points) + 1) * (cuts[k + 1] - cuts[k])
                tables[which].append(sampled(phase.guess, 0.5 * (at + 1))[which])
        part.guess(
            states=tables[0],
            controls=tables[1] if controls else None,
            initial_time=phase.guess.start,
            terminal_time=phase.guess.end,
            integrals=_one_or_all(guessed_integrals(phase, starts)) if integrals else None,
        )
        parts.append((len(states), len(controls)))
    objective, boundary = definition.endpoint(casadi.vertcat(*ends), p)
    limits = list(bounded(boundary, *definition.bounds("boundaries")))
    if limits:
        part.event_constraints(*limits)
    peer.minimize(objective)
    found = package.solve_adaptive(peer, nlp_options=dict(QUIET), show_summary=False)
    if not found.status["success"]:
        return {"status": str(found.status.get("message", "failed"))[:200], "claims": False,
                "objective": None, "plan": None}  # fmt: skip
    plans = []
    for number, (nx, nu) in enumerate(parts, 1):
        one = found.phases[number]
        degrees = [int(n) for n in one["mesh"]["polynomial_degrees"]]
        first, last = one["times"]["initial"], one["times"]["final"]
        knots = first + 0.5 * (np.array(one["mesh"]["mesh_nodes"], float) + 1) * (last - first)
        x = np.array([found[number, f"x{k}"] for k in range(nx)]).T
        u = np.array([found[number, f"u{k}"] for k in range(nu)]).reshape(nu, -1).T
        plans.append(
            {
                "knots": knots,
                "state_nodes": [np.ravel(radau(d).state_approximation_nodes) for d in degrees],
                "control_nodes": [np.ravel(radau(d).collocation_nodes) for d in degrees],
                **nodes_per_interval(x, u, degrees, overlap=0),
            }
        )
    refined = found.adaptive["converged"]
    return {
        "status": "converged" if refined else "not converged",
        "claims": bool(refined),
        "objective": float(found.status["objective"]),
        "plan": plan_of_nodes(definition, plans, found.parameters.get("values", [])),
    }


#: Adapters by the name of the package.
SOLVERS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "ours": ours,
    "bare": bare,
    "yapss": yapss,
    "maptor": maptor,
    "rockit": lambda problem: importlib.import_module("scoreboard_rockit").solve(problem),
    "dymos": lambda problem: importlib.import_module("scoreboard_dymos").solve(problem),
}


def _used() -> float:
    """Return the CPU time of this process and its children."""
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def _solve(solver: str, name: str, file: Path, limit: float) -> None:
    """Solve one problem within a limit of CPU time, and write the answer."""
    problem = problem_of(name).build(name).build()
    if solver == "ours":
        import crosstrack as ct

        ct.solve(ct.load("optimal-control/double-integrator-energy"))  # loads modules
    begin = _used()
    most = math.ceil(time.process_time() + limit)
    resource.setrlimit(resource.RLIMIT_CPU, (most, most + 1))
    try:
        answer = SOLVERS[solver](problem)
    except Exception as error:
        kind = "unsupported" if isinstance(error, Unsupported) else type(error).__name__
        answer = {
            "status": f"{kind}: {error}"[:200],
            "claims": False,
            "objective": None,
            "plan": None,
        }
    answer["seconds"] = _used() - begin
    answer["plan"] = None if answer["plan"] is None else answer["plan"].data()
    if answer["objective"] is not None and not math.isfinite(answer["objective"]):
        answer["objective"] = None
    file.write_text(json.dumps(answer))


def main(solver: str, folder: str, limit: float, longest: float, names: list[str]) -> None:
    """Solve each problem in a forked process, and print its name and exit code when it ends.

    Parameters
    ----------
    solver, folder : str
        Key of `SOLVERS`, and folder for the answers, ``NAME.json`` each.
    limit, longest : float
        Limits of CPU and elapsed time (s) per problem.
    names : list of str
        Problems.
    """
    lines = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries print to the standard error
    problem_of(names[0])
    if solver not in ("ours", "bare"):
        importlib.import_module(solver)
    for name in names:
        child = os.fork()
        if not child:
            code = 1
            try:
                _solve(solver, name, Path(folder) / f"{name}.json", limit)
                code = 0
            except Exception:
                traceback.print_exc()
            finally:
                os._exit(code)
        end, status = time.monotonic() + longest, None
        while status is None:
            ended, word = os.waitpid(child, os.WNOHANG)
            if ended:
                status = os.waitstatus_to_exitcode(word)
            elif time.monotonic() > end:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                status = TOO_LONG
            else:
                time.sleep(0.02)
        lines.write(f"{name} {status}\n")
        lines.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), sys.argv[5:])
