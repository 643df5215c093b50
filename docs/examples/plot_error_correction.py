"""
Declare, solve, cross-check: a UAV route with error correction
==============================================================

A UAV flies from A to B while its positioning errors grow. On the way it may correct them, the
horizontal one at some points, the vertical one at others, but only while they are small enough.
This example declares such a problem, solves it, checks the answer by several independent ways,
looks at it, and asks what is wrong with a problem that has no answer.
"""

# %%
# Declare
# -------
# A model is made from arrays. Four points in a plane: A, a horizontal and a vertical correction
# point, and B. Every unit of length adds 0.1 to both errors, and no error may exceed 0.3.

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
# The catalogue holds larger instances. This one has the sizes and thresholds of row 7 of the
# paper's table 1.

model = ct.load("error-correction/7")
print(model)

# %%
# Solve
# -----
# A native exact search. The answer has been verified before we see it: the route was walked from
# the raw coordinates, by other code than the search.

best = ct.solve(model, "label-setting")
print("route:       ", best.plan)
print("corrections: ", best.plan.corrections)
print("length:      ", round(best.primal_bound, 3), model.objective_unit)
print("gap:         ", best.gap)
print(best.verification)

# %%
# The same route must satisfy every row of the paper's own program, too: it is encoded into the
# program's columns. Here are the rows that add up lengths and errors along the arcs.

rows = ct.verify(model, best.plan, formulation="paper")
for check in rows.checks:
    if check.equation in ("6", "7", "8"):
        print(check)

# %%
# Cross-check
# -----------
# The exact search, the paper's two-stage algorithm, and a mixed-integer solver on another
# formulation of the problem, each in a process of its own. The solver is given the route as a warm
# start; it still has to prove by itself that no route is shorter.

comparison = ct.compare(
    [model],
    ["label-setting", "two-stage", "highs:arc-flow"],
    warm_start=best,
    time_limit=60,
)
print(comparison)

# %%
# The verdict is data as well as text.

verdict = comparison.verdicts[0]
print(verdict.outcome)
print(verdict.evidence)
assert verdict.outcome == "AGREED"

# %%
# Look at it
# ----------
# The route among the points, and both errors along it against the thresholds.

figure = ct.plot(model, best.plan)

# %%
# A problem without an answer
# ---------------------------
# Let B ask for more than the four points can give: both errors at most 0.1 on arrival. The search
# proves that there is no route, and the diagnosis says where every attempt ends.

tight = replace(small, theta=0.1, name="four points and a strict B")
print(ct.solve(tight, "label-setting"))
print(ct.diagnose(tight))

# %%
# The same question put to the paper's program: which of its equations cannot hold together, while
# they can without any one of them?

print(ct.diagnose(tight, "highs", formulation="paper"))

# %%
# Corrections that may fail
# -------------------------
# Hollow points are suspect: there a correction may fail and leave an error of 5. The route keeps all
# thresholds even if all of them fail. The front tells what fewer corrections cost.

doubtful = ct.load("error-correction/suspect-38")
safe = ct.solve(doubtful)
print(safe)
ct.plot(doubtful, safe.plan)
print(ct.front(doubtful, "corrections"))

# %%
# Keep it
# -------
# Models and solutions go to JSON and come back the same. The digest identifies the content.

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
