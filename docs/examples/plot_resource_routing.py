"""
Electric vehicle with charging stops
====================================

A drive of 400 km with a range of 150 km needs charging stops. Full charges take long, quick charges
fill only a part of the battery, and the arrival time is limited. This example declares the drive
with two resources, proves the shortest route, draws it, and diagnoses an infeasible limit.
"""

# %%
# Declare the drive
# -----------------
# Station coordinates are in km. Two stations charge fully, the others to two thirds. A resource has
# a rate per unit of length. Each kind of point has a limit on arrival, a gain and a reset. The
# resource energy is the energy taken from the battery: a full charge resets it to 0, a quick charge
# to at most 10 kWh.

from dataclasses import replace

import crosstrack as ct
from crosstrack.models import Resource, ResourceRouting

stations = {
    "start": (0, 0), "Ash": (70, 20), "Birch": (110, -10), "Cedar": (140, 25), "Elm": (190, 0),
    "Fir": (225, -20), "Hazel": (260, 15), "Larch": (300, -5), "Maple": (345, 20), "end": (400, 0),
}  # fmt: skip
full = {"Cedar", "Hazel"}
kinds = ["start", *("full" if name in full else "quick" for name in list(stations)[1:-1]), "end"]
energy = Resource(
    "energy",
    rate=0.2,
    limits={"full": 30, "quick": 30, "end": 30},
    resets={"full": 0, "quick": 10},
    unit="kWh",
)
charging = {"full": 0.75, "quick": 0.25}
time = Resource("time", rate=1 / 90, gains=charging, limits={"end": 6.5}, unit="h")
model = ResourceRouting(
    kinds,
    [energy, time],
    start=0,
    end=len(kinds) - 1,
    points=list(stations.values()),
    ids=list(stations),
    name="charging",
)
print(model)

# %%
# The shortest route
# ------------------
# The labelling algorithm stores all resource levels of a partial route. One label dominates another
# only if it is no worse in all of them. The mixed-integer program confirms the result
# independently.

best = ct.solve(model)
print(best.summary())
print(ct.compare([model], ["resource-labelling", "highs"], time_limit=20))
picture = ct.plot(model, best)

# %%
# Earlier arrival
# ---------------
# If the arrival is half an hour earlier, three quick charges replace a full one. If it is an hour
# earlier, no route is feasible, and the diagnosis names the conflicting limits.

for latest in (5.9, 5.5):
    hurried = Resource("time", time.rate, gains=charging, limits={"end": latest}, unit="h")
    asked = replace(model, resources=(energy, hurried), name=f"by {latest} h")
    answer = ct.solve(asked)
    if answer.plan is None:
        print(ct.diagnose(asked))
    else:
        print(
            f"{asked.name}: {answer.primal_bound:.2f} km by {model.plan_to_data(answer.plan)['ids']}"
        )

# %%
# Street network
# --------------
# Arcs can be listed explicitly, with individual lengths and consumptions. In this network energy is
# reset at stations, and a shelter reduces the exposure to 1.

streets = ct.load("resource-routing/network-20")
way = ct.solve(streets)
print(f"{way.primal_bound:.4f}, {way.termination}, {way.statistics['labels made']} labels")
network = ct.plot(streets, way)

# %%
# Error correction as a special case
# ----------------------------------
# The route of a UAV whose positioning errors must be corrected is a special case: two errors grow
# with the length, and each kind of point resets one of them. The general model has the same
# optimum.

uav = ct.load("error-correction/example-1")
general = uav.lower()
print(general)
assert ct.solve(general).primal_bound == ct.solve(uav).primal_bound
