"""
UAV route with error correction
===============================

A UAV flies from A to B while its positioning errors grow. It can correct the horizontal error at
some points and the vertical error at others, but only while the errors are small enough. This
example declares such a problem, solves it, compares several backends, draws the route and diagnoses
an infeasible instance.
"""

# %%
# Declare a model
# ---------------
# A model is built from arrays. This one has four points in a plane: A, a horizontal and a vertical
# correction point, and B. Every unit of length adds 0.1 to both errors, and no error may exceed
# 0.3.

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import crosstrack as ct
from crosstrack.models import ErrorCorrectionRouting, Model

small = ErrorCorrectionRouting(
    points=[[0, 0, 0], [1.2, 1.6, 0], [1.5, 2, 0], [2.7, 3.6, 0]],
    kinds=["A", "horizontal", "vertical", "B"],
    alpha1=0.3,
    alpha2=0.3,
    beta1=0.3,
    beta2=0.3,
    theta=0.3,
    delta=0.1,
    name="four points",
)
print(ct.solve(small))

# %%
# The catalogue contains larger instances. This one has the size and the thresholds of row 7 of the
# paper's table 1.

model = ct.load("error-correction/7")
print(model)

# %%
# Solve the model
# ---------------
# ``label-setting`` is a native exact algorithm. The returned route has been verified from the raw
# coordinates, by code that is independent of the algorithm.

best = ct.solve(model, "label-setting")
print("route:       ", best.plan)
print("corrections: ", best.plan.corrections)
print("length:      ", round(best.primal_bound, 3), model.objective_unit)
print("gap:         ", best.gap)
print(best.verification)

# %%
# The route must also satisfy every row of the paper's program. For this check it is encoded into
# the columns of the program. These rows add up lengths and errors along the arcs:

rows = ct.verify(model, best.plan, formulation="paper")
for check in rows.checks:
    if check.equation in ("6", "7", "8"):
        print(check)

# %%
# Compare backends
# ----------------
# The exact search, the paper's two-stage algorithm and a mixed-integer solver on another
# formulation each run in their own process. The solver receives the route as a warm start, but has
# to prove optimality itself.

comparison = ct.compare(
    [model],
    ["label-setting", "two-stage", "highs:arc-flow"],
    warm_start=best,
    time_limit=60,
)
print(comparison)

# %%
# The verdict is also available as data.

verdict = comparison.verdicts[0]
print(verdict.outcome)
print(verdict.evidence)
assert verdict.outcome == "AGREED"

# %%
# Draw the route
# --------------
# The plot shows the route among the points, and both errors along it with their thresholds.

figure = ct.plot(model, best.plan)

# %%
# Diagnose an infeasible problem
# ------------------------------
# Require both errors to be at most 0.1 at B, which the four points cannot satisfy. The search
# proves infeasibility, and the diagnosis lists the position at which every partial route ends.

tight = replace(small, theta=0.1, name="four points and a strict B")
print(ct.solve(tight, "label-setting"))
print(ct.diagnose(tight))

# %%
# The diagnosis of the paper's program returns an irreducible infeasible subset of its equations:
# they are inconsistent together, and consistent if any one of them is removed.

print(ct.diagnose(tight, "highs", formulation="paper"))

# %%
# Corrections that may fail
# -------------------------
# A correction at a hollow point may fail and leave an error of 5. The route satisfies all
# thresholds even if all of them fail. The Pareto front shows the cost of fewer corrections.

doubtful = ct.load("error-correction/suspect-38")
safe = ct.solve(doubtful)
print(safe)
ct.plot(doubtful, safe.plan)
print(ct.front(doubtful, "corrections"))

# %%
# Save and load
# -------------
# Models and solutions are written to JSON and read back without loss. The digest identifies the
# content.

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "model.json"
    file.write_text(model.to_json())
    again = Model.from_json(file.read_text())
    kept = Path(folder) / "solution.json"
    kept.write_text(best.to_json())
    solution = ct.Solution.from_dict(json.loads(kept.read_text()), model=again)

assert again.digest == model.digest
assert solution.plan == best.plan
print(solution)
