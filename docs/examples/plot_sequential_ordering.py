"""
Order of jobs with setup times
==============================

A machine processes jobs. The setup time depends on the job before, and some jobs must precede others. This example
declares the problem, proves the shortest order, compares methods, verifies a modified order, and writes a file of
TSPLIB.
"""

# %%
# Declare the problem
# -------------------
# Entry (i, j) of the matrix is the setup time in minutes if job j follows job i. The first and the last node are
# the idle machine. Parts are milled and drilled after they are cut, ground after they are milled, and painted after
# both. The fixture cannot be removed directly after the cleaning: this entry is infinite.

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import crosstrack as ct
from crosstrack.instances.sequential_ordering import (
    generate_ordering,
    read_ordering,
    write_ordering,
)
from crosstrack.models import SequentialOrdering

names = ["start", "cut", "mill", "drill", "grind", "clean", "fixture", "paint", "end"]
minutes = np.array(
    [
        [0, 4, 9, 7, 8, 3, 2, 9, 9],
        [0, 0, 5, 2, 6, 4, 7, 8, 1],
        [0, 3, 0, 4, 2, 5, 6, 7, 2],
        [0, 6, 2, 0, 5, 3, 4, 9, 2],
        [0, 7, 4, 6, 0, 2, 1, 5, 3],
        [0, 2, 6, 3, 4, 0, np.inf, 4, 1],
        [0, 5, 3, 4, 2, 6, 0, 8, 2],
        [0, 9, 8, 9, 7, 5, 9, 0, 1],
        [0, 0, 0, 0, 0, 0, 0, 0, 0],
    ]
)
job = {name: number for number, name in enumerate(names)}
pairs = [
    ("cut", "mill"),
    ("cut", "drill"),
    ("mill", "grind"),
    ("grind", "paint"),
    ("drill", "paint"),
]
model = SequentialOrdering(
    minutes, precedence=[[job[a], job[b]] for a, b in pairs], ids=names, name="jobs"
)
best = ct.solve(model)
print([names[node] for node in best.plan.order], best.primal_bound, best.termination)
picture = ct.plot(model, best)

# %%
# Compare methods
# ---------------
# ``bounded-levels`` and the solvers of mixed-integer programs prove the optimum; ``three-exchange`` is a local
# search without a bound.

comparison = ct.compare([model], ["bounded-levels", "highs", "three-exchange"], time_limit=20)
print(comparison)
assert all(run.primal_bound == best.primal_bound for run in comparison.solutions)

# %%
# Verify a modified order
# -----------------------
# An order from any source can be verified. Here the painting comes before the grinding.

order = list(best.plan.order)
order.remove(job["paint"])
order.insert(order.index(job["grind"]), job["paint"])
verified = ct.verify(model, {"order": order})
print(verified)
assert not verified.ok
wrong = ct.plot(model, {"order": order})

# %%
# A larger problem
# ----------------
# A random problem by the rule of SOPLIB has 60 nodes; two nodes are in a relation with a probability of 30 %, and
# further ones through other nodes.

large = generate_ordering(60, 1000, 30, seed=1)
result = ct.solve(large, seed=1, backend_options={"width": 64})
print(large.describe(), result.primal_bound, f"gap {result.gap:.1%}")

# %%
# Files
# -----
# The files of TSPLIB and SOPLIB are read and written.

with TemporaryDirectory() as folder:
    file = write_ordering(model, Path(folder) / "jobs.sop")
    print(*file.read_text().splitlines()[:8], sep="\n")
    assert ct.solve(read_ordering(file)).primal_bound == best.primal_bound
