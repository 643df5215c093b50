"""CPU time per iteration of Ipopt by number of scenarios, and by ordering of the linear solver.

``python tests/benchmarks/optimal_control/scenario_growth.py`` solves chains of integrators with quadratic drag on
25 Gauss intervals of 4 nodes, with 1, 5 and 20 scenarios of the mass, and writes the table of
``docs/problems/optimal-control.md``. The evaluation of the program's functions is measured apart from the rest, which
is nearly the linear solver alone.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import casadi

from crosstrack.models import OptimalControlProblem
from crosstrack.solvers.nlp.casadi_nlp import DERIVATIVES
from crosstrack.solvers.nlp.scaled import Scaled

#: Numbers of states and controls, and of scenarios.
SIZES, SCENARIOS = ((2, 1), (6, 1), (6, 3)), (1, 5, 20)
#: MUMPS's orderings: approximate minimum degree and METIS.
DEGREE, METIS = 0, 5
#: Iterations of each search.
ITERATIONS = 12


def chain(states: int, controls: int) -> Any:
    """Return a chain of integrators with drag, driven by the sum of all controls."""
    ocp = OptimalControlProblem("chain")
    mass = ocp.data("mass", value=1.0)
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", states, initial=0, upper=[1.5, *[2] * (states - 1)])
    u = phase.control("u", controls, lower=-3, upper=3)
    links = [x[k + 1] - 0.1 * x[k] ** 2 for k in range(states - 1)]
    phase.dynamics({x: [*links, (casadi.sum1(u) - 0.1 * x[states - 1] ** 2) / mass]})
    final = phase.final(x)
    cost = 0.1 * phase.integral(casadi.sumsqr(u))
    ocp.minimise(10 * (final[0] - 1) ** 2 + final[1] ** 2 + cost)
    return ocp


def measure(problem: Any, ordering: int) -> tuple[int, float, float]:
    """Return the columns, and the CPU milliseconds per iteration: all, and of function evaluations."""
    program = problem.formulate("gauss", intervals=25, degree=4, refine=False).program
    scaled = Scaled(program)
    options = {name: getattr(scaled, kind) for name, kind in DERIVATIVES.items()}
    ipopt = {
        "print_level": 0, "sb": "yes", "tol": 1e-8, "mu_strategy": "adaptive", "max_iter": ITERATIONS,
        "bound_relax_factor": 0.0, "mumps_pivot_order": ordering, "mumps_permuting_scaling": 0,
    }  # fmt: skip
    options |= {"print_time": False, "ipopt": ipopt}
    solver = casadi.nlpsol("solver", "ipopt", scaled.problem(), options)
    begin = time.process_time()
    solver(x0=scaled.start(program.guess), **scaled.bounds)
    used, stats = time.process_time() - begin, solver.stats()
    inside = sum(value for name, value in stats.items() if name.startswith("t_proc_nlp_"))
    count = int(stats["iter_count"])
    return program.size, 1e3 * used / count, 1e3 * inside / count


def main() -> None:
    """Measure all cases and write the table."""
    sys.path[:0] = [str(Path(__file__).resolve().parents[2])]
    from benchmarks.measured import write

    rows = []
    for size in SIZES:
        first: list[float] = []
        for count in SCENARIOS:
            data = {str(k): {"mass": 0.8 + 0.4 * k / max(count - 1, 1)} for k in range(count)}
            problem = chain(*size).scenarios(data)
            columns, used, inside = measure(problem, DEGREE)
            values = [used, inside, used - inside]
            first = first or values
            growth = [value / one for value, one in zip(values, first, strict=True)]
            metis = measure(problem, METIS)[1]
            rows.append([*size, count, columns, used, *growth, metis])
            print(*rows[-1], flush=True)
    heads = {
        "states": "d", "controls": "d", "scenarios": "d", "columns": "d", "ms per iteration": ".1f",
        "times one scenario": ".1f", "evaluations": ".1f", "linear solver": ".1f",
        "ms with METIS": ".1f",
    }  # fmt: skip
    write("optimal-control", "scenarios", __file__, heads, rows, ("casadi",))


if __name__ == "__main__":
    main()
