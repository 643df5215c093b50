"""
Compare solvers on your own CVXPY problem
=========================================

A crane moves a load by 1 m and must limit its swing: a small model predictive control problem in
CVXPY. This example solves it as CVXPY does, finds an answer that is wrong, compares five solvers under
equal conditions, and certifies the best answer.
"""

# %%
# The problem
# -----------
# The state is the position of the trolley (m), its speed (m/s), the angle of the rope (rad) and its
# rate (rad/s). The control is the acceleration of the trolley (m/s²). Labels of constraints are
# optional; crosstrack uses them in its reports.

import warnings
from contextlib import suppress

import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np

import crosstrack as ct

STEPS, SECONDS = 40, 0.05
dynamics = np.array(
    [
        [1, SECONDS, 0, 0],
        [0, 1, -0.4 * SECONDS, 0],
        [0, 0, 1, SECONDS],
        [0, 0, -30 * SECONDS, 1],
    ]
)
gain = np.array([[0, SECONDS, 0, -2 * SECONDS]])

x = cp.Variable((STEPS + 1, 4), name="x")
u = cp.Variable((STEPS, 1), name="u")
problem = cp.Problem(
    cp.Minimize(cp.sum_squares(x[:, 0]) + 1e-4 * cp.sum_squares(u)),
    [
        (x[0] == [1, 0, 0, 0]).set_label("start"),
        (x[1:] == x[:-1] @ dynamics.T + u @ gain).set_label("dynamics"),
        (u <= 2).set_label("largest acceleration"),
        (u >= -2).set_label("largest deceleration"),
        (x[:, 2] <= 0.05).set_label("swing ahead"),
        (x[:, 2] >= -0.05).set_label("swing behind"),
    ],
)

# %%
# One solver at a time
# --------------------
# This is how CVXPY is used: one call per solver, each with its own default accuracy. The objectives
# are printed beside the largest violation of a constraint.

SOLVERS = ("CLARABEL", "OSQP", "SCS", "HIGHS", "PIQP")
statuses, violations = {}, {}
for name in SOLVERS:
    with warnings.catch_warnings(), suppress(cp.SolverError):
        warnings.simplefilter("ignore")
        problem.solve(solver=name)
    statuses[name] = problem.status
    if x.value is None:
        print(f"{name:9} {problem.status}")
        continue
    violations[name] = max(float(np.max(c.violation())) for c in problem.constraints)
    print(f"{name:9} {problem.status:12} {problem.value:.8f}  violation {violations[name]:.1e}")

# %%
# HiGHS claims that the problem is unbounded. This is wrong: a sum of squares is at least 0. OSQP stops at
# its limit of iterations, and CVXPY returns its motion with a warning, although it violates the
# constraints. The other three solvers agree.

assert statuses["HIGHS"] == "unbounded"
assert violations["OSQP"] > 1e-5 > violations["CLARABEL"]

# %%
# Five solvers under equal conditions
# -----------------------------------
# :func:`crosstrack.compare` converts the problem once. Every solver runs in its own process with the
# same tolerance and time limit, and its point is verified against the data.

names = [name.lower() for name in SOLVERS]
comparison = ct.compare([problem], names, time_limit=10)
print(comparison)
answers = {answer.backend: answer for answer in comparison.verdicts[0].solutions}
assert comparison.outcome == "AGREED"

# %%
# The false claim of HiGHS is gone, because crosstrack scales the program before a solver receives it. It
# would not be accepted either: "unbounded" needs a ray that proves it. The bound of HiGHS does not reach the
# required gap, so its answer is "feasible" instead of "optimal". OSQP reaches the tolerance as well, because
# crosstrack allows it more iterations. The price is its time.

fastest = min(answers.values(), key=lambda answer: answer.seconds["solve"])
ratio = answers["osqp"].seconds["solve"] / fastest.seconds["solve"]
print(f"osqp needs {ratio:.0f} times the seconds of {fastest.backend}")
assert ratio > 20

# %%
# Certify the best
# ----------------
# ``solve`` with one solver polishes the point and recomputes the bound from the multipliers.
# ``verify(…, exact=True)`` evaluates every row in rational arithmetic, and proves the bound from the
# multipliers with all rounding errors bounded. The difference of objective and bound is then a proof
# that no other motion is better by more.

best = ct.solve(problem, "clarabel")
print(best)
exact = ct.verify(problem, best, exact=True)
print(exact)
print(f"no motion is better by more than {exact.objective - exact.bound:.1e}, proof: {exact.proof}")
assert exact.ok and exact.objective - exact.bound < 1e-6

# %%
# ``assign`` sets the variables and multipliers of CVXPY, as ``problem.solve()`` does.

best.assign()
print(problem.status, f"{problem.value:.8f}")
print("largest price of the swing limit:", f"{np.max(problem.constraints[4].dual_value):.3f}")

# %%
# The picture
# -----------
# Left: the certified motion; thin lines are the limits of the swing. Right:
# seconds of each solver for the same verified answer.

moments = SECONDS * np.arange(STEPS + 1)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
left.plot(moments, 10 * x.value[:, 2], label="angle of the rope (0.1 rad)")
left.plot(moments, x.value[:, 0], label="position (m)")
left.axhline(0.5, color="0.6", linewidth=0.8)
left.axhline(-0.5, color="0.6", linewidth=0.8)
left.set(xlabel="time (s)")
left.legend()
order = sorted(answers, key=lambda name: answers[name].seconds["solve"], reverse=True)
right.barh(order, [1e3 * answers[name].seconds["solve"] for name in order])
right.set(xscale="log", xlim=(0.1, None), xlabel="time of the solver (ms)")
