"""
Tour of a guided vehicle
========================

A vehicle follows a wire in the floor. It fetches parts at some places of the wire and delivers them
to others. Some jobs have several stops, and one job waits for another. This example declares such a
tour, solves it to optimality with several methods, draws it, and solves a shortest common
supersequence problem as a tour.
"""

# %%
# Declare the tour
# ----------------
# Places are positions along the wire in metres. The vehicle starts at 0, between its customers. A
# chain is a job: its stops are served in this order. The pair requires that the press is set up
# before the part arrives.

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
# The horizontal axis is the position of the vehicle, the vertical axis the distance travelled,
# downwards.

best = ct.solve(model)
print(best.summary())
tour = ct.plot(model, best)

# %%
# Compare methods
# ---------------
# The comparison includes two exact methods and the paper's two heuristics, merging of chains and
# greedy insertion.

comparison = ct.compare(
    [model], ["a-star", "dynamic-programming", "insert-nearest", "greedy"], time_limit=20
)
print(comparison)
for run in comparison.solutions:
    assert run.primal_bound >= best.primal_bound

# %%
# Verify a modified plan
# ----------------------
# A plan from any source can be verified. Here the tools arrive too late for the set-up.

data = model.plan_to_data(best.plan)
order = data["order"]
order.remove(names.index("tools"))
order.append(names.index("tools"))
found = ct.verify(model, data)
print(found)
assert not found.ok
wrong = ct.plot(model, data, parts=["tour"])

# %%
# A larger instance
# -----------------
# This instance has ten chains of five customers, as in the paper's table 1, at integer coordinates
# from 1 to 200. The plot names and connects only a few chains; colours and markers distinguish the
# others.

table = ct.load("guided-path/table-1-k10")
solved = ct.solve(table)
print(f"{solved.primal_bound:g} m, {solved.termination}")
many = ct.plot(table, solved)

# %%
# Write an animation, and a file for other solvers:

with TemporaryDirectory() as folder:
    file = Path(folder) / "tour.gif"
    animate_tour(model, best, frames=10, size=(3.6, 3.2)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")
    line = write_sop(model, Path(folder) / "tour.sop")
    print(*line.read_text().splitlines()[:7], sep="\n")
    again = ct.solve(read_sop(line))
    assert again.primal_bound == best.primal_bound

# %%
# Shortest common supersequence
# -----------------------------
# The shortest word that contains each given word as a subsequence is also a tour: one letter is at
# position 1, the other one at 3, and every chain returns to 2 between its letters. The length of
# the word is (tour length - 4) / 2. The supersequence problem is NP-hard for many words. The tour
# is therefore NP-hard for many chains.

words = ["abbab", "babba", "aabab", "bbaab"]
letters = supersequence_tour(words, name="four words")
spelled = ct.solve(letters)
word = supersequence_of(letters, spelled.plan)
print(f"{word}, from a tour of {spelled.primal_bound:g}")
assert len(word) == (spelled.primal_bound - 4) / 2
read = ct.plot(letters, spelled, over="stops")
