"""
Three robots, one map, equal batteries
======================================

Three robots share out nine places among obstacles and come back. Their batteries are equal, so none should
go much farther than the others. This example declares the map, shares out the places by two objectives, asks
what equal shares cost, and ends with curves that can be flown, a picture of them, and files for other
software.
"""

# %%
# The mission
# -----------
# Everything is in metres. Obstacles are polygons, one of them with a yard inside; the robots are discs. The
# longest way is to be short, and then the sum of all ways.

import itertools
from pathlib import Path
from tempfile import TemporaryDirectory

import crosstrack as ct
from crosstrack.instances.fleet_mission import write_mission_samples
from crosstrack.models import FleetMission, FleetRouting
from crosstrack.models.fleet_mission.plot import animate_mission

mission = FleetMission(
    obstacles=[
        [[8, 6], [14, 4], [16, 9], [11, 12]],
        [[22, 12], [29, 10], [31, 17], [25, 20]],
        {
            "shell": [[5, 17], [15, 16], [16, 26], [6, 27]],
            "holes": [[[8, 19], [13, 19], [13, 24], [8, 24]]],
        },
        [[26, 3], [33, 2], [32, 7], [27, 8]],
    ],
    bounds=(0, 0, 40, 30),
    nodes=[[4, 8], [12, 2], [20, 6], [36, 5], [37, 14], [34, 24], [24, 27], [18, 21], [3, 22]],
    depot=(19, 14),
    vehicles=3,
    cell=0.5,
    radius=0.4,
    separation=1.0,
    velocity_limit=1.5,
    acceleration_limit=1.0,
    objective="max-sum",
    ids=["Anna", "Bert", "Cleo", "Dora", "Egon", "Frida", "Gerd", "Hanna", "Ida"],
    name="three robots",
)
print(mission)
field = ct.plot(mission)

# %%
# Routes
# ------
# First the places alone. Their distances are those of shortest paths on the map, around the obstacles. The
# least sum is one thing, the least longest route another. With this few places both are proven.

places = [mission.depot.tolist(), *mission.nodes.tolist()]
names = ["depot", *mission.ids]
routing = {"points": places, "map": mission.map, "ids": names}
shortest = FleetRouting(3, objective="sum", name="least sum", **routing)
fairest = FleetRouting(3, objective="max", name="least longest route", **routing)

by_sum = ct.solve(shortest, "subset-dp")
by_max = ct.solve(fairest, "subset-dp")
for model, found in ((shortest, by_sum), (fairest, by_max)):
    print(f"{model.name}: {found.primal_bound:.2f} m, gap {found.gap:.1%}, {found.plan}")

# %%
# The least sum leaves one robot with a single place near the depot:

unfair = ct.plot(shortest, by_sum)

# %%
# The least longest route shares them out:

fair = ct.plot(fairest, by_max)

# %%
# The search that takes larger models finds the same, without a proof; a program and the exact algorithm
# agree.

comparison = ct.compare([fairest], ["subset-dp", "fleet-search"], time_limit=5, seed=1)
print(comparison)

# %%
# What equal shares cost
# ----------------------
# Between the two there are others: the least sum for each limit on the longest route. Filled markers are
# proven.

front = ct.front(shortest, "max", time_limit=20)
for point in front.points:
    print(f"longest {point.second:6.2f} m, sum {point.objective:7.2f} m, proven {point.proven}")
for before, after in itertools.pairwise(sorted(front.points, key=lambda point: point.second)):
    assert after.objective <= before.objective
trade = ct.plot(front)

# %%
# The whole mission
# -----------------
# Now from polygons to curves: distances, routes, paths, corridors of free cells, and minimum snap in them,
# each stage checked by its own model. What comes back is verified end to end, against the polygons, at every
# instant of the curves and not only at samples.

best = ct.solve(mission, time_limit=15, seed=1)
print(best.summary())
flown = ct.plot(mission, best)

# %%
# The stages over one another: blocked cells, paths over them, these shortened by lines of sight, and the
# curves.

stages = ct.plot(mission, best, parts=["map"], layers=["cells", "grid", "smoothed", "curve"])

# %%
# The same in motion, and as samples for other software:

with TemporaryDirectory() as folder:
    file = Path(folder) / "mission.gif"
    animate_mission(mission, best, frames=10, size=(3.6, 3.2)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")
    samples = write_mission_samples(best.plan, Path(folder) / "mission.csv", rate=5.0)
    print(*samples.read_text().splitlines()[:3], sep="\n")

# %%
# What is not believed
# --------------------
# A plan from anywhere is checked in the same way. Here a route loses its last place.

data = mission.plan_to_data(best.plan)
lost = data["routes"][0].pop()
data["visits"][0].pop()
found = ct.verify(mission, data)
print("lost:", mission.label(lost))
print(found)
assert not found.ok
wrong = ct.plot(mission, data, parts=["map"])
