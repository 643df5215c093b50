"""
From a map to a flight
======================

A path on a map is no flight: it has corners, and no time. Three problems, one after the other: the shortest
path among obstacles, the smoothest trajectory through its corners with the best times, and a look at
how far that trajectory stays from the obstacles. Each plan is verified by its own model.
"""

# %%
# The shortest path
# -----------------
# Any direction is allowed, so the path turns at corners of obstacles only. The exact search proves that
# there is no shorter one.

import numpy as np
import shapely

import crosstrack as ct
from crosstrack.models import TimeAllocation

field = ct.load("grid-path/corners")
path = ct.solve(field)
print(path)

corners = np.array(path.plan.paths[0])
print(f"{len(corners)} corners, {path.primal_bound:.3f} m")

# %%
# Times and a smooth trajectory
# -----------------------------
# Waypoints are the corners; what is free are the times between them. A second is worth 100 units of
# snap here, and speed is limited.

flight = TimeAllocation(corners, time_weight=100.0, velocity_limit=3.0, name="through the corners")
best = ct.solve(flight)
print(best)
print(f"{best.plan.times[-1]:.2f} s for {path.primal_bound:.2f} m")

# %%
# The native descent is only locally optimal: a general solver of nonlinear programs is a second opinion.

print(ct.compare(flight, ["time-gradient", "ipopt"], time_limit=30))

# %%
# Does it keep clear?
# -------------------
# The model of the flight knows waypoints and limits, and no obstacles: between the corners the
# trajectory leaves the path. Shapely tells how far into blocked cells it goes.

curve = best.plan(np.linspace(0, best.plan.times[-1], 4001))
cells = np.argwhere(field.map.blocked)
low = field.map.origin + cells[:, ::-1] * field.map.cell
solid = shapely.union_all(shapely.box(*low.T, *(low + field.map.cell).T))
inside = shapely.contains_xy(shapely.buffer(solid, -1e-9), *curve.T)
print(f"{inside.mean():.1%} of the flight is inside an obstacle")
assert inside.any()

# %%
# A corridor along every leg mends that: the distance from the straight line between two corners is bounded,
# so the way to say "near the path" is more waypoints on it, or the whole pipeline with corridors that
# :doc:`plot_fleet_mission` runs. With waypoints every metre:

legs = np.diff(corners, axis=0)
counts = np.maximum(np.ceil(np.linalg.norm(legs, axis=1)), 1).astype(int)
dense = np.concatenate(
    [
        a + np.linspace(0, 1, k, endpoint=False)[:, None] * d
        for a, k, d in zip(corners, counts, legs, strict=False)
    ]
    + [corners[-1:]]
)
closer = ct.solve(
    TimeAllocation(dense, time_weight=100.0, velocity_limit=3.0, name="waypoints every metre")
)
near = closer.plan(np.linspace(0, closer.plan.times[-1], 4001))
depth = shapely.distance(shapely.points(near), shapely.boundary(solid))
deep = depth[shapely.contains_xy(solid, *near.T)].max(initial=0.0)
print(f"{len(dense)} waypoints: at most {deep:.3f} m inside, {closer.plan.times[-1]:.2f} s")

# %%
# The three in one picture: the path, the first flight and the second.

figure = ct.plot(field, path, title="A path, and two flights through it")
axes = figure.axes[0]
axes.plot(*curve.T, "--", color="#d55e00", label="through the corners")
axes.plot(*near.T, ":", color="#009e73", lw=2.5, label="waypoints every metre")
axes.legend(loc="upper right", fontsize=8)

# %%
# What to try next: ``ct.diagnose`` on a field without a way, another ``time_weight``, or
# :doc:`plot_fleet_mission`, where corridors keep a whole team clear.
