"""
One wire, five jobs and the shortest tour
=========================================

A vehicle follows a wire in the floor. Parts are fetched at some places of the wire and brought to others, some
jobs have several stops, and one waits for another. This example declares such a tour, solves it to
optimality by different means, draws it, and turns a question about words into a tour.
"""

# %%
# The tour
# --------
# Places along the wire in metres; the vehicle starts at 0, between its customers. A chain is a job: its
# stops are served in this order. The pair says that the press is set up before the last part is fetched.

from pathlib import Path
from tempfile import TemporaryDirectory

import crosstrack as ct
from crosstrack.instances.guided_path import (
    read_sop,
    supersequence_of,
    supersequence_tour,
    write_sop,
)
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path.plot import animate_tour

stops = {
    "dock": 0, "steel": 42, "press": -18, "paint": 25, "store": 60, "castings": -30, "mill": 33,
    "wash": 8, "tools": 51, "set-up": -18, "oil": 12, "scrap": -45, "drill": 20, "packing": 55,
}  # fmt: skip
names = list(stops)
jobs = [
    ["steel", "press", "paint", "store"],
    ["castings", "mill", "wash"],
    ["tools", "set-up"],
    ["oil", "scrap"],
    ["drill", "packing"],
]
model = GuidedPathTour(
    coordinates=list(stops.values()),
    chains=[[names.index(stop) for stop in job] for job in jobs],
    precedence=[[names.index("set-up"), names.index("press")]],
    ids=names,
    name="five jobs",
)
print(model)
plan = ct.plot(model)

# %%
# The shortest tour
# -----------------
# The position of the vehicle runs to the right, what it has walked runs downwards.

best = ct.solve(model)
print(best.summary())
tour = ct.plot(model, best)

# %%
# Beside others
# -------------
# Two exact methods, and the paper's two heuristics: merging of chains and greedy insertion.

comparison = ct.compare(
    [model], ["a-star", "dynamic-programming", "insert-nearest", "greedy"], time_limit=20
)
print(comparison)
for run in comparison.solutions:
    assert run.primal_bound >= best.primal_bound

# %%
# What is not believed
# --------------------
# A plan from anywhere is checked. Here the tools come too late for the set-up.

data = model.plan_to_data(best.plan)
order = data["order"]
order.remove(names.index("tools"))
order.append(names.index("tools"))
found = ct.verify(model, data)
print(found)
assert not found.ok
wrong = ct.plot(model, data, parts=["tour"])

# %%
# A larger one
# ------------
# Ten chains of five as in the paper's table 1, at whole coordinates from 1 to 200. Few chains have names and
# lines in the picture; colours and markers tell the others apart.

table = ct.load("guided-path/table-1-k10")
solved = ct.solve(table)
print(f"{solved.primal_bound:g} m, {solved.termination}")
many = ct.plot(table, solved)

# %%
# In motion, and for other solvers:

with TemporaryDirectory() as folder:
    file = Path(folder) / "tour.gif"
    animate_tour(model, best, frames=10, size=(3.6, 3.2)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")
    line = write_sop(model, Path(folder) / "tour.sop")
    print(*line.read_text().splitlines()[:7], sep="\n")
    again = ct.solve(read_sop(line))
    assert again.primal_bound == best.primal_bound

# %%
# Words as tours
# --------------
# The shortest word that holds each of these as a subsequence is a tour as well: one letter lies at 1, the
# other one at 3, and every chain returns to 2 between its letters. Half of the tour's length without 4 is the
# length of the word. As the former is hard for many words, so are tours for many chains.

words = ["abbab", "babba", "aabab", "bbaab"]
letters = supersequence_tour(words, name="four words")
spelled = ct.solve(letters)
word = supersequence_of(letters, spelled.plan)
print(f"{word}, from a tour of {spelled.primal_bound:g}")
assert len(word) == (spelled.primal_bound - 4) / 2
read = ct.plot(letters, spelled, over="stops")
