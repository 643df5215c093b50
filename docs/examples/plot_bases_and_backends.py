"""
Bases and backends, honestly
============================

A trajectory problem can be written as a quadratic program in many ways that are equal on paper. On
a computer they are not. This page measures what four formulations and several solvers make of the
same problems, here and now: whatever it says of a number is printed by the code above it. Seconds
are those of the machine that built the page, so they are shown as ratios within one run.
"""

# %%
# One problem, four programs
# --------------------------
# A random walk of ten segments in space, in each of the four formulations.

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
# ``paper`` has powers of absolute time, as its equations are printed. ``monomial`` has powers of each
# segment's own time, ``legendre`` integrated Legendre polynomials with a Hessian of zeros and ones. In
# ``hermite`` the columns are the free derivatives at the knots, and all equations are substituted:
# without corridor and limits it has no rows.
#
# How hard they are to solve
# --------------------------
# A solver meets the optimality system of the program, Hessian and rows in one symmetric matrix. Its
# condition number says by how much rounding may be magnified: with 1e16 no digit of the answer is
# certain, and numbers above that only say so. Many solvers scale the matrix first, so it is measured
# both ways.


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
# The reason for the first row is the clock. On the last segment, seven powers of a large time are
# multiplied with coefficients that cancel. A segment's own time begins at 0 everywhere, and the other
# rows hardly know how long the path is. In ``legendre`` it matters little whether anybody scales.
#
# What comes of it
# ----------------
# The paper's own problem with three segments, with five, and with the same five a minute after the
# clock began. One solver, in each basis. The first line of a problem is the answer of the direct
# solver, which needs no basis of this kind.

for name in ("paper", "paper-5", "paper-late"):
    model = ct.load(f"minimum-snap/{name}")
    exact = ct.solve(model, "banded")
    print(f"{model.name}: optimum {exact.primal_bound:.6f}")
    for basis in BASES:
        answer = ct.solve(model, "clarabel", formulation=basis, time_limit=5)
        checked = "" if answer.verification is None else answer.verification.summary()
        print(f"  {basis:9} {answer.termination:12} {checked[:70]}")

# %%
# Verification looks at the trajectory, not at the status of the solver. Where the powers of absolute
# time have lost the digits that the waypoints need, the plan is rejected, and no wrong trajectory
# comes out.
#
# What a status is worth
# ----------------------
# Now a corridor of 100 boxes with limits of velocity and acceleration. Its program holds them at
# eight instants of each segment at first; in every basis, this program has the same optimal value.
# Here the solvers are called directly, with settings as they come, and believed.

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
# Look for a *yes* beside an error that is no rounding. It need not be a fault of the solver. In the
# reduced basis the objective is a small difference of large numbers: what is fixed costs a constant,
# and the columns take nearly all of it back. A solver that is content with a relative gap of 1e-8 is
# content with an error of

reduced = boxes.formulate("hermite").program
print(f"1e-8 of {reduced.offset:.1e}: {1e-8 * reduced.offset:.3g}; the optimum is {value:.3g}")

# %%
# That is why crosstrack believes no status. A backend's claim becomes an optimum only after its
# residuals and the gap between its objective and the bound that its multipliers prove have been
# computed anew from the program. What falls short is polished where that helps, and else called by
# what it is.
#
# The whole corridor
# ------------------
# A corridor holds at every instant. Each solver's program gets further instants where the
# trajectory sticks out, until it does no more; our interior point does the same by itself, and uses
# that segments only meet their neighbours. Each has eight seconds, in a process of its own.

comparison = ct.compare(
    [boxes],
    ["interior-point", "clarabel:legendre", "clarabel:hermite", "piqp:legendre", "osqp:legendre"],
    time_limit=8,
)
print(comparison)
verdict = comparison.verdicts[0]
assert verdict.outcome == "AGREED"

# %%
# Who is right, and at which price? The error is that of the verified plan against the best proven
# bound. The time is everything from the model to the verified answer, compiling left out, in units
# of the native solver's.


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
# A thousand segments and no bounds: the direct solver, the general ones, and SciPy's spline of
# degree 7, which is the same trajectory where nothing but positions and rest at both ends is asked.
# The times of the backends have building, proof and verification in them, SciPy's has not; so the
# direct solver's bare solve is shown as well. The shortest of five runs counts.

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
# What to take from it
# --------------------
# - Take ``auto``: without bounds that is the direct solver, with them the interior point. Both work on
#   derivatives at the knots and keep their digits by never forming what would lose them.
# - For a cross-check, or where a model is beyond the native solvers, take ``legendre``. It is the
#   default for every solver of quadratic programs.
# - ``hermite`` is small, and right where there are no bounds. With a long corridor its objective is
#   the difference that was printed above.
# - ``paper`` is there to be looked at.
# - A status is a claim. What counts is the gap that is left when somebody else recomputes it.
