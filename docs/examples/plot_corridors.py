"""
Corridors in two and three dimensions
=====================================

A corridor is a chain of convex polytopes along a path without obstacles inside. This example computes
corridors among polygons and in a forest, verifies them by exact arithmetic, and plans a trajectory inside.
"""

# %%
# Among polygons
# --------------
# The path is the shortest one through a grid. The vehicle has a radius of 0.15 m.

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull

import crosstrack as ct
from crosstrack.instances.flight import forest
from crosstrack.instances.grid_path import random_polygons
from crosstrack.models import GridMap, GridPath, MinimumSnap
from crosstrack.models.flight import corridor

ends = np.array([[0.5, 0.5], [9.5, 9.5]])
polygons = random_polygons(8, 3, (0, 0, 10, 10), keep=ends, gap=0.6, size=0.7)
grid = GridMap.from_polygons(polygons, (0, 0, 10, 10), 0.25, radius=0.2)
path = ct.solve(GridPath(grid, *grid.cells_of(ends))).plan.paths[0]

flat = corridor(polygons, path, radius=0.15, bounds=[0, 0, 10, 10])
print(flat)
print(flat.verify(polygons))

# %%
# One polynomial per polytope with free inner waypoints stays inside at every instant. Two solvers
# agree on it.

waypoints = np.full((len(flat) + 1, 2), np.inf)
waypoints[[0, -1]] = path[[0, -1]]
model = MinimumSnap(waypoints, np.arange(len(flat) + 1.0), **flat.fields())
best = ct.solve(model, "clarabel")
assert best.verified
print(ct.compare(model, ["clarabel", "interior-point"]))

figure, axes = plt.subplots(figsize=(6, 6))
for polygon in polygons:
    axes.fill(*polygon.shell.T, color="0.4")
for corners in flat.corners:
    axes.fill(*corners[ConvexHull(corners).vertices].T, color="C0", alpha=0.15, ec="C0")
axes.plot(*np.array(path).T, "k:", label="path")
axes.plot(*best.plan(np.linspace(0, len(flat), 500)).T, "C3", label="minimum snap")
axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
axes.legend()

# %%
# In a forest
# -----------
# The map consists of cubes. The polytopes are proven to contain no part of a blocked cube.

way = np.array([[0.6, 0.6, 1.5], [5.0, 2.2, 1.5], [7.0, 7.0, 2.0], [9.4, 9.4, 1.5]])
trees = forest(
    4,
    (10, 10, 3),
    0.2,
    pillars=14,
    rings=3,
    keep=np.linspace(way[:-1], way[1:], 9).reshape(-1, 3),
    gap=0.7,
)
deep = corridor(trees, way, radius=0.3, reach=7)
print(deep.verify(trees))
print("volumes (m³):", deep.volumes.round(1))

figure = plt.figure(figsize=(7, 6))
axes = figure.add_subplot(projection="3d")
cubes = np.argwhere(trees.blocked[:, :, ::3])
axes.scatter(*trees.centres(cubes * [1, 1, 3]).T, s=3, color="0.6", depthshade=True)
for k, corners in enumerate(deep.corners):
    faces = corners[ConvexHull(corners).simplices]
    axes.add_collection3d(Poly3DCollection(faces, alpha=0.08, facecolor=f"C{k}", edgecolor="none"))
axes.plot(*way.T, "k.-")
axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", box_aspect=(10, 10, 3))
plt.show()
