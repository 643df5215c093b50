"""
Polynomial bases and QP solvers
===============================

A trajectory problem has many mathematically equivalent quadratic programs, which behave differently
in floating-point arithmetic. This example compares four formulations and several solvers on the
same problems. All numbers are printed by the code. Seconds depend on the machine that built the
page, so they are shown as ratios within one run.
"""

# %%
# One problem, four programs
# --------------------------
# The instance is a random walk of ten segments in space.

import time
import warnings

import numpy as np
import qpsolvers
from matplotlib.figure import Figure
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack.instances.minimum_snap import corridor, random_walk

BASES = ("paper", "monomial", "hermite", "legendre")

walk = random_walk(10, seed=10)
print(f"{'formulation':12} {'rows':>5} {'columns':>8} {'Hessian entries':>16}")
for basis in BASES:
    program = walk.formulate(basis).program
    print(f"{basis:12} {program.row_count:5} {program.size:8} {program.hessian.nnz:16}")

# %%
# ``paper`` uses powers of absolute time, as the paper prints its equations. ``monomial`` uses
# powers of the local time of each segment, and ``legendre`` integrated Legendre polynomials with a
# Hessian of zeros and ones. In ``hermite`` the columns are the free derivatives at the knots, and
# all equations are substituted: without corridor and limits it has no rows.
#
# Condition numbers
# -----------------
# A solver works on the optimality (KKT) system of the program, which combines Hessian and rows in
# one symmetric matrix. Its condition number bounds the amplification of rounding errors: at 1e16 no
# digit of the answer is reliable, and larger numbers are not distinguished. Many solvers scale the
# matrix first, so the condition number is computed with and without scaling.


def condition(program, scaled):
    """Return the condition number of the optimality system, as it is or with its rows scaled."""
    hessian, rows = program.hessian.toarray(), program.matrix.toarray()
    system = np.block([[hessian, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    if not system.size:
        return 1.0
    for _ in range(10 if scaled else 0):
        scale = 1 / np.sqrt(np.abs(system).max(axis=1))
        system = system * scale[:, None] * scale
    return float(min(np.linalg.cond(system), 1e17))


sizes = (1, 2, 3, 5, 8, 12, 20)
figure = Figure(figsize=(9.0, 3.6), layout="constrained")
panels = figure.subplots(1, 2, sharey=True)
for axes, scaled, title in zip(panels, (False, True), ("as written", "scaled"), strict=True):
    print(f"{title + ':':18}" + "".join(f"{n:>9}" for n in sizes) + " segments")
    for basis, marker in zip(BASES, "os^D", strict=True):
        programs = [random_walk(n, 1, seed=n).formulate(basis).program for n in sizes]
        values = [condition(program, scaled) for program in programs]
        shown = [f"{value:.0e}" if value < 1e16 else "> 1e16" for value in values]
        print(f"  {basis:16}" + "".join(f"{text:>9}" for text in shown))
        axes.semilogy(sizes, values, marker=marker, label=basis)
    axes.axhline(1e16, color="0.5", linestyle="--", linewidth=1)
    axes.text(sizes[-1], 5e15, "no digits left", color="0.4", va="top", ha="right")
    axes.set(title=title, xlabel="segments", ylim=(0.3, 1e18))
    axes.grid(alpha=0.3)
panels[0].set_ylabel("condition number")
panels[1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)

# %%
# Absolute time causes the large numbers in the first row. On the last segment, seven powers of a
# large time are multiplied by coefficients that cancel. The local time of each segment starts at 0,
# so the other rows depend little on the length of the path. ``legendre`` depends little on scaling.
#
# Effect on the answers
# ---------------------
# This block solves the paper's problem with three segments, with five, and with the same five
# segments shifted by one minute. The same solver runs in each basis. The first line of each problem
# is the answer of the direct solver, which does not use these bases.

for name in ("paper", "paper-5", "paper-late"):
    model = ct.load(f"minimum-snap/{name}")
    exact = ct.solve(model, "banded")
    print(f"{model.name}: optimum {exact.primal_bound:.6f}")
    for basis in BASES:
        answer = ct.solve(model, "clarabel", formulation=basis, time_limit=5)
        checked = "" if answer.verification is None else answer.verification.summary()
        print(f"  {basis:9} {answer.termination:12} {checked[:70]}")

# %%
# The verification evaluates the trajectory, not the status of the solver. If powers of absolute
# time lose the digits that the waypoints need, the plan is rejected, and no wrong trajectory is
# returned.
#
# Status and actual error
# -----------------------
# This instance is a corridor of 100 boxes with limits on velocity and acceleration. Its program
# initially enforces them at eight instants of each segment. The program has the same optimal value
# in every basis. The solvers are called directly with default settings, without any check of their
# results.

boxes = corridor(100, seed=1, name="a corridor of 100 boxes")
reference = ct.solve(boxes.formulate("legendre").program, "clarabel", time_limit=20)
value = reference.primal_bound
print(f"optimal value, proven to a gap of {reference.gap:.1e}: {value:.6f}")
print(f"{'basis':10} {'solver':9} {'says it solved it':18} error of its objective")
for basis in ("monomial", "hermite", "legendre"):
    program = boxes.formulate(basis).program
    problem = program.to_qpsolvers()
    for solver, settings in (("clarabel", {}), ("piqp", {}), ("osqp", {"time_limit": 3.0})):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            raw = qpsolvers.solve_problem(problem, solver=solver, **settings)
        says = "yes" if raw.found else "no"
        error = program.objective(raw.x) / value - 1 if raw.x is not None else float("nan")
        print(f"{basis:10} {solver:9} {says:18} {error:+.1e}")

# %%
# A *yes* with an error above rounding level is not necessarily a fault of the solver. In the
# reduced basis the objective is a small difference of large numbers: the fixed values contribute a
# constant, and the columns cancel most of it. A relative gap of 1e-8 then permits an absolute error
# of

reduced = boxes.formulate("hermite").program
print(f"1e-8 of {reduced.offset:.1e}: {1e-8 * reduced.offset:.3g}; the optimum is {value:.3g}")

# %%
# For this reason crosstrack does not rely on the status of a solver. It accepts an answer as
# optimal only after it has recomputed the residuals, and the gap between the objective and the dual
# bound of the multipliers, from the program. Inaccurate answers are polished if possible, and
# otherwise reported with the termination that they justify.
#
# The complete corridor
# ---------------------
# A corridor applies at every instant. For each QP solver, crosstrack adds instants at which the
# trajectory leaves the corridor until no violation remains. The native interior-point method does
# the same internally, and exploits that each segment is coupled only to its neighbours. Each backend
# has eight seconds in its own process.

comparison = ct.compare(
    [boxes],
    ["interior-point", "clarabel:legendre", "clarabel:hermite", "piqp:legendre", "osqp:legendre"],
    time_limit=8,
)
print(comparison)
verdict = comparison.verdicts[0]
assert verdict.outcome == "AGREED"

# %%
# The error compares the verified plan with the best proven bound. The time includes everything from
# the model to the verified answer, except compilation, relative to the time of the native solver.


def elapsed(solution):
    """Return the seconds of a run without those of compiling."""
    return solution.seconds["total"] - solution.seconds.get("compile", 0.0)


bound = max(s.dual_bound for s in verdict.solutions if s.termination == "optimal")
unit = elapsed(next(s for s in verdict.solutions if s.backend == "interior-point"))
for solution in verdict.solutions:
    who = solution.backend + (f":{solution.formulation}" if solution.formulation else "")
    price = f"{elapsed(solution) / unit:6.1f} times the time"
    if solution.plan is None:
        print(f"{who:20} {price}   {solution.termination}: no verified plan")
    else:
        error = solution.primal_bound / bound - 1
        print(f"{who:20} {price}   {solution.termination}, error {error:.1e}")

# %%
# Without a corridor
# ------------------
# This instance has a thousand segments and no bounds. It is solved by the direct solver, by general
# solvers, and by SciPy's spline of degree 7, which is the same trajectory if only positions and
# rest at both ends are required. The times of the backends include building, proof and
# verification. The time of SciPy does not, so the solve time of the direct solver is shown
# separately. Each time is the minimum of five runs.

many = random_walk(1000, seed=1000)
rest = [(order, np.zeros(3)) for order in (1, 2, 3)]


def spline():
    """Return the seconds that SciPy's spline takes."""
    begin = time.perf_counter()
    make_interp_spline(many.times, many.waypoints, k=7, bc_type=(rest, rest))
    return time.perf_counter() - begin


def solved(backend, basis=None):
    """Return the answer of a backend in this process."""
    return ct.solve(many, backend, formulation=basis, isolate=False)


direct = [solved("banded") for _ in range(5)]
optimum = direct[0].primal_bound
unit = min(map(elapsed, direct))
bare = min(answer.seconds["solve"] for answer in direct)
print(f"{'SciPy spline':20} {min(spline() for _ in range(5)) / unit:8.2f} times the time of banded")
print(f"{'banded, bare solve':20} {bare / unit:8.2f} times the time of banded")
for backend, basis in (("interior-point", None), ("clarabel", "legendre"), ("clarabel", "hermite"),
                       ("piqp", "legendre")):  # fmt: skip
    answers = [solved(backend, basis) for _ in range(5)]
    ratio = min(map(elapsed, answers)) / unit
    who, first = backend + (f":{basis}" if basis else ""), answers[0]
    off = abs(first.primal_bound / optimum - 1) if first.plan is not None else float("nan")
    print(f"{who:20} {ratio:8.2f} times the time of banded, {first.termination}, error {off:.1e}")

# %%
# Recommendations
# ---------------
# - Use ``auto``. It selects the direct solver without bounds and the interior-point method with
#   bounds. Both use derivatives at the knots, which avoids cancellation.
# - Use ``legendre`` for a cross-check, or if the native solvers do not support the model. It is the
#   default for QP solvers.
# - ``hermite`` is small and accurate without bounds. With a long corridor its objective suffers from
#   the cancellation shown above.
# - ``paper`` is intended for reading.
# - A solver status is a claim. Rely on the gap recomputed from the program.
