"""
Charging on the way, and two limits at once
===========================================

A drive of 400 km with a battery for 150 km needs stations. Full charges take long, quick ones leave the
battery half empty, and there is an appointment at the end. This example declares such a drive with two
resources, proves the shortest route, draws it, and asks what is to blame where there is none.
"""

# %%
# The drive
# ---------
# Stations along the way, in km; two charge fully, the others to two thirds. A resource has a rate for
# each unit of length, and by kind of point a limit on arrival, a gain and a reset. Energy here is what
# has been taken out of the battery: a full charge resets it to 0, a quick one to 10 kWh at the most.

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
# The labelling keeps every level of a route, and one route dominates another only where it is no worse in
# all of them. The mixed-integer program says the same by other means.

best = ct.solve(model)
print(best.summary())
print(ct.compare([model], ["resource-labelling", "highs"], time_limit=20))
picture = ct.plot(model, best)

# %%
# In a hurry
# ----------
# With half an hour less three quick charges take the place of a full one; with an hour less there is no
# route, and the diagnosis names the limits that contradict one another.

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
# A network of streets
# --------------------
# Arcs may be listed, with lengths and uses of their own. In this network energy is reset at stations, and
# a shelter leaves 1 of the exposure.

streets = ct.load("resource-routing/network-20")
way = ct.solve(streets)
print(f"{way.primal_bound:.4f}, {way.termination}, {way.statistics['labels made']} labels")
network = ct.plot(streets, way)

# %%
# Errors that are corrected
# -------------------------
# A UAV whose positioning errors must be corrected on the way is a case of the same: two errors grow with
# the length, and each kind of point resets one of them. The general model bounds it alike.

uav = ct.load("error-correction/example-1")
general = uav.lower()
print(general)
assert ct.solve(general).primal_bound == ct.solve(uav).primal_bound
