"""
Fleet mission with equal batteries
==================================

Three robots visit nine places among obstacles and return to the depot. Their batteries are equal,
so the routes should have similar lengths. This example declares the mission, computes routes for
two objectives, computes the trade-off between them, and plans trajectories. It ends with an
animation and files for other software.
"""

# %%
# The mission
# -----------
# All lengths are in metres. Obstacles are polygons, one of them with a courtyard. The robots are
# discs. The objective is the longest route, and then the sum of all routes.

import itertools
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

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
# The first model contains only the places. Distances between them are shortest paths around the
# obstacles. The minimum total length and the minimum longest route are different objectives. For
# this few places both are solved to proven optimality.

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
# The minimum total length leaves one robot with a single place near the depot:

unfair = ct.plot(shortest, by_sum)

# %%
# The minimum longest route balances the workload:

fair = ct.plot(fairest, by_max)

# %%
# The heuristic for larger models finds the same objective without a proof.

comparison = ct.compare([fairest], ["subset-dp", "fleet-search"], time_limit=5, seed=1)
print(comparison)

# %%
# Trade-off between both objectives
# ---------------------------------
# The Pareto front contains the minimum total length for each limit on the longest route. The
# backend is exact and the step is small, so the front is complete. Filled markers are proven.

front = ct.front(shortest, "max", step=1e-6, points=20)
print(front)
for before, after in itertools.pairwise(front.points):
    assert after.objective >= before.objective
trade = ct.plot(front)

# %%
# From polygons to trajectories
# -----------------------------
# The mission combines distances, routes, paths, corridors of free cells, and fast trajectories in
# the corridors. The model of each stage verifies its result. The complete plan is
# verified against the polygons, at every instant and not only at samples.

best = ct.solve(mission, time_limit=15, seed=1)
print(best.summary())
flown = ct.plot(mission, best)

# %%
# This picture overlays the stages: blocked cells, grid paths, paths shortened by lines of sight,
# and trajectories.

stages = ct.plot(mission, best, parts=["map"], layers=["cells", "grid", "smoothed", "curve"])

# %%
# The robots fly on straight lines at the limits and round the corners. Minimum snap is smoother and
# slower. The picture shows the largest component of the velocity of the first robot:

snap = ct.solve(
    mission, "staged", time_limit=15, seed=1, backend_options={"trajectories": "interior-point"}
)
speeds, axes = plt.subplots(figsize=(7, 2.5), layout="constrained")
for name, found in (("rounded polyline", best), ("minimum snap", snap)):
    curve = found.plan.trajectories[0]
    t = np.linspace(curve.times[0], curve.times[-1], 1000)
    axes.plot(t - t[0], np.abs(curve(t, 1)).max(axis=1), label=name)
    total = sum(flight.duration for flight in found.plan.trajectories)
    print(f"{name}: {found.primal_bound:.1f} m, {total:.1f} s of flight")
axes.set(xlabel="time since departure, s", ylabel="speed, m/s")
_ = axes.legend()

# %%
# Write an animation, and samples for other software:

with TemporaryDirectory() as folder:
    file = Path(folder) / "mission.gif"
    animate_mission(mission, best, frames=10, size=(3.6, 3.2)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")
    samples = write_mission_samples(best.plan, Path(folder) / "mission.csv", rate=5.0)
    print(*samples.read_text().splitlines()[:3], sep="\n")

# %%
# Verify a modified plan
# ----------------------
# A plan from any source is verified in the same way. Here the last place of a route is removed.

data = mission.plan_to_data(best.plan)
lost = data["routes"][0].pop()
data["visits"][0].pop()
found = ct.verify(mission, data)
print("lost:", mission.label(lost))
print(found)
assert not found.ok
wrong = ct.plot(mission, data, parts=["map"])
