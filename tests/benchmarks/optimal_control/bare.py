"""Solve a declared problem by the program that an expert writes in 50 lines of CasADi.

Flipped Radau collocation on a uniform mesh of 60 intervals with 3 nodes per phase, from the guess of the
declaration, by Ipopt at its defaults (``tol`` 1e-8, ``max_iter`` 3000). The program has no scaling, no
refinement and no restart. It is the baseline of the scoreboard.

``python tests/benchmarks/optimal_control/bare.py [--intervals 60] [--degree 3] [names]`` solves problems of
``unseen.py``, or entries of the catalogue such as ``optimal-control/goddard``, and verifies the plans.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi
import numpy as np

__all__ = ["Bare", "plan_of_nodes", "solve_bare"]

#: Mesh of every phase.
INTERVALS, DEGREE = 60, 3


@dataclass(frozen=True)
class Bare:
    """Answer of the bare program.

    Attributes
    ----------
    objective : float
        Objective of the last iterate.
    success : bool
        Whether Ipopt reports an optimum ("Solve_Succeeded" or "Solved_To_Acceptable_Level").
    status : str
        Status of Ipopt.
    seconds : float
        CPU time of everything: construction of the program and solution.
    iterations : int
        Iterations of Ipopt.
    plan : ControlPlan or None
        Plan of the last iterate, for ``model.verify``; None if it is not finite or a phase has no duration.
    """

    objective: float
    success: bool
    status: str
    seconds: float
    iterations: int
    plan: Any


def _expanded(function: Any) -> Any:
    """Return the function in scalar operations if all its parts have such a form."""
    try:
        return function.expand()
    except RuntimeError:
        return function


def _transcribe(phase: Any, p: Any, intervals: int, degree: int) -> dict[str, Any]:
    """Return variables, guess, bounds, constraints and ends of the program of one phase."""
    nx, nu, count = len(phase.state_names), len(phase.control_names), intervals * degree
    nodes = np.array([0.0, *casadi.collocation_points(degree, "radau")])
    rates, _, weights = (np.array(part) for part in casadi.collocation_coeff(list(nodes[1:])))
    slopes = casadi.DM(count + 1, count)  # d/dtau at the nodes, times the length of an interval
    for k in range(intervals):
        first = k * degree
        slopes[first : first + degree + 1, first : first + degree] = rates
    x, u = casadi.MX.sym("x", nx, count + 1), casadi.MX.sym("u", nu, count)
    t = casadi.MX.sym("t", 2)
    inner = (np.arange(intervals)[:, None] + nodes[1:]).ravel() / intervals
    places = np.append(0.0, inner)
    step = (t[1] - t[0]) / intervals
    times = t[0] + (t[1] - t[0]) * casadi.DM(inner).T
    at_nodes = _expanded(phase.function).map("at_nodes", "serial", count, [3], [])
    rate, path, integrand, _ = at_nodes(times, x[:, 1:], u, p)
    integrals = step * casadi.mtimes(integrand, casadi.DM(np.tile(weights.ravel(), intervals)))
    x_low, x_high = (np.tile(side[:, None], count + 1) for side in phase.bounds("states"))
    for column, side in ((0, "initial"), (-1, "final")):
        x_low[:, column], x_high[:, column] = phase.bounds("states", side)
    u_low, u_high = (np.tile(side[:, None], count) for side in phase.bounds("controls"))
    guess = phase.guess
    tables = [
        np.array([np.interp(at, guess.fractions, row) for row in table.T]).reshape(-1, at.size)
        for at, table in ((places, guess.states), (inner, guess.controls))
    ]
    path_low, path_high = (np.tile(side, count) for side in phase.bounds("paths"))
    defects = casadi.vec(casadi.mtimes(x, slopes) - step * rate)
    zeros = np.zeros(nx * count)
    return {
        "variables": [t, casadi.vec(x), casadi.vec(u)],
        "guess": [[guess.start, guess.end], *(table.ravel("F") for table in tables)],
        "lower": [[phase.start_lower, phase.end_lower], x_low.ravel("F"), u_low.ravel("F")],
        "upper": [[phase.start_upper, phase.end_upper], x_high.ravel("F"), u_high.ravel("F")],
        "rows": [defects, casadi.vec(path), t[1] - t[0]],
        "rows_lower": [zeros, path_low, [0.0]],
        "rows_upper": [zeros, path_high, [np.inf]],
        "ends": [t, x[:, 0], x[:, -1], integrals],
        "shown": [t, x, u],
    }


def solve_bare(
    problem: Any,
    *,
    intervals: int = INTERVALS,
    degree: int = DEGREE,
    seconds: float = 1e10,
    **ipopt: Any,
) -> Bare:
    """Return the answer of the bare program for a declared problem.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        Problem; only its functions, bounds and guess are used.
    intervals, degree : int
        Uniform mesh of every phase.
    seconds : float
        Limit of Ipopt's CPU time.
    **ipopt
        Further options of Ipopt.
    """
    begin = time.process_time()
    definition = getattr(problem, "definition", problem)
    p = casadi.MX.sym("p", len(definition.parameter_names))
    parts = [_transcribe(phase, p, intervals, degree) for phase in definition.phases]
    ends = casadi.vertcat(*(piece for part in parts for piece in part["ends"]))
    objective, boundary = definition.endpoint(ends, p)
    rows = {name: [piece for part in parts for piece in part[name]] for name in parts[0]}
    variables = casadi.vertcat(*rows["variables"], p)
    program = {"x": variables, "f": objective, "g": casadi.vertcat(*rows["rows"], boundary)}
    options = {"print_level": 0, "max_cpu_time": seconds, **ipopt}
    solver = casadi.nlpsol(
        "bare", "ipopt", program, {"ipopt": options, "print_time": False, "error_on_fail": False}
    )
    start = np.concatenate([*rows["guess"], definition.stacked("parameters", "initial_lower")])
    x_bounds = zip((rows["lower"], rows["upper"]), definition.bounds("parameters"), strict=True)
    row_bounds = zip(
        (rows["rows_lower"], rows["rows_upper"]), definition.bounds("boundaries"), strict=True
    )
    lbx, ubx = (np.concatenate([*side, last]) for side, last in x_bounds)
    lbg, ubg = (np.concatenate([*side, last]) for side, last in row_bounds)
    answer = solver(x0=start, lbx=lbx, ubx=ubx, lbg=lbg, ubg=ubg)
    stats = solver.stats()
    shown = casadi.Function("shown", [variables], [*rows["shown"], p])(answer["x"])
    used = time.process_time() - begin
    tables = [part.full() for part in shown]
    return Bare(
        float(answer["f"]),
        stats["return_status"] in ("Solve_Succeeded", "Solved_To_Acceptable_Level"),
        stats["return_status"],
        used,
        int(stats.get("iter_count", 0)),
        _plan(definition, tables, intervals, degree),
    )


def _plan(definition: Any, tables: list[Any], intervals: int, degree: int) -> Any:
    """Return the plan of the node values, or None if they make no plan."""
    nodes = np.array([0.0, *casadi.collocation_points(degree, "radau")]) * 2.0 - 1.0
    phases = []
    for k in range(len(definition.phases)):
        (t0, tf), x, u = tables[3 * k].ravel(), tables[3 * k + 1].T, tables[3 * k + 2].T
        cuts = range(0, intervals * degree, degree)
        phases.append(
            {
                "knots": np.linspace(t0, tf, intervals + 1),
                "state_nodes": [nodes] * intervals,
                "states": [x[first : first + degree + 1] for first in cuts],
                "control_nodes": [nodes[1:]] * intervals,
                "controls": [u[first : first + degree] for first in cuts],
            }
        )
    return plan_of_nodes(definition, phases, tables[-1].ravel())


def plan_of_nodes(definition: Any, phases: list[dict[str, Any]], p: Any) -> Any:
    """Return the plan with the given values at nodes, or None if they make no plan.

    Parameters
    ----------
    definition : Definition
        Definition of the problem.
    phases : list of dict
        For each phase ``knots`` and, per interval, ``state_nodes``, ``states``, ``control_nodes`` and
        ``controls``: positions in [-1, 1], and one row of values per node. Controls are cut at their bounds.
    p : array_like
        Values of all parameters.
    """
    from crosstrack.errors import CrosstrackError
    from crosstrack.models.optimal_control.definition import entry_slices
    from crosstrack.models.optimal_control.plan import ControlPlan, PhasePlan, Piecewise

    parts = []
    try:
        for phase, given in zip(definition.phases, phases, strict=True):
            knots, low, high = np.array(given["knots"], float), *phase.bounds("controls")
            lists = {
                name: tuple(np.array(part, float) for part in given[name])
                for name in ("state_nodes", "states", "control_nodes", "controls")
            }
            cut = tuple(np.clip(part, low, high) for part in lists["controls"])
            parts.append(
                PhasePlan(
                    phase.name,
                    Piecewise(knots, lists["state_nodes"], lists["states"]),
                    Piecewise(knots, lists["control_nodes"], cut, low, high),
                    phase.state_names,
                    phase.control_names,
                )
            )
        values = np.asarray(p, float).ravel()
        named = {q.name: values[places] for q, places in entry_slices(definition.parameters)}
        return ControlPlan(tuple(parts), named)
    except CrosstrackError:
        return None


def main() -> None:
    """Solve and verify the named problems, or all unseen ones."""
    here = Path(__file__).resolve()
    sys.path[:0] = [str(here.parent)]
    from unseen import UNSEEN

    import crosstrack as ct

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--intervals", type=int, default=INTERVALS)
    parser.add_argument("--degree", type=int, default=DEGREE)
    parser.add_argument("--seconds", type=float, default=60.0, help="limit of Ipopt's CPU time")
    given = parser.parse_args()
    for name in given.names or UNSEEN:
        problem = UNSEEN[name].build(name) if name in UNSEEN else ct.load(name)
        answer = solve_bare(
            problem, intervals=given.intervals, degree=given.degree, seconds=given.seconds
        )
        known = UNSEEN[name].value if name in UNSEEN else float("nan")
        checked = answer.plan is not None and problem.build().verify(answer.plan)
        print(
            f"{name:28} {answer.status:28} {answer.objective:16.9g} {known:16.9g} "
            f"{'verified' if checked and checked.ok else 'rejected':9} {answer.iterations:5} "
            f"{answer.seconds:6.2f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
