"""
From a grid path to a trajectory
================================

A path on a map has corners and no times, so it cannot be flown directly. This example computes the
shortest path among obstacles, then the smoothest trajectory through its corners with optimal times,
and measures the distance of the trajectory from the obstacles. Each plan is verified by its own
model.
"""

# %%
# The shortest path
# -----------------
# Any direction is allowed, so the path turns only at corners of obstacles. The exact search proves
# that the path is optimal.

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
# The corners are the waypoints, and the times between them are variables. One second costs as much
# as 100 units of snap, and the speed is limited.

flight = TimeAllocation(corners, time_weight=100.0, velocity_limit=3.0, name="through the corners")
best = ct.solve(flight)
print(best)
print(f"{best.plan.times[-1]:.2f} s for {path.primal_bound:.2f} m")

# %%
# The native descent is only locally optimal. A general nonlinear solver serves as comparison.

print(ct.compare(flight, ["time-gradient", "ipopt"], time_limit=30))

# %%
# Distance to the obstacles
# -------------------------
# The trajectory model contains waypoints and limits, but no obstacles. Between the corners the
# trajectory leaves the path. Shapely computes the part inside blocked cells.

curve = best.plan(np.linspace(0, best.plan.times[-1], 4001))
cells = np.argwhere(field.map.blocked)
low = field.map.origin + cells[:, ::-1] * field.map.cell
solid = shapely.union_all(shapely.box(*low.T, *(low + field.map.cell).T))
inside = shapely.contains_xy(shapely.buffer(solid, -1e-9), *curve.T)
print(f"{inside.mean():.1%} of the flight is inside an obstacle")
assert inside.any()

# %%
# Two methods keep the trajectory near the path: more waypoints on it, or corridors, as in
# :doc:`plot_fleet_mission`. With one waypoint per metre:

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
# The picture shows the path and both trajectories.

figure = ct.plot(field, path, title="A path, and two flights through it")
axes = figure.axes[0]
axes.plot(*curve.T, "--", color="#d55e00", label="through the corners")
axes.plot(*near.T, ":", color="#009e73", lw=2.5, label="waypoints every metre")
axes.legend(loc="upper right", fontsize=8)

# %%
# Next steps: ``ct.diagnose`` on a map without a path, another ``time_weight``, or
# :doc:`plot_fleet_mission`, which uses corridors for a fleet.
