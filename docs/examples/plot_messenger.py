"""
Messenger UAV for moving lorries
================================

A fixed-wing UAV with a minimum turning radius must visit moving lorries within radio range in the
shortest time. This example declares such a problem, solves it, animates the tour, compares it with
the paper's algorithm, and computes a lower bound.
"""

# %%
# Declare the problem
# -------------------
# Positions are at time 0. Positions and velocities are in metres and metres per second. The UAV
# starts at the origin and flies north. By default it has a speed of 10 m/s, a turning radius of 5 m
# and a radio range of 5 m.

from pathlib import Path
from tempfile import TemporaryDirectory

import crosstrack as ct
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.plot import animate_tour, draw_progress

model = MessengerTour(
    positions=[[30, 12], [62, 40], [15, 55], [48, 70], [80, 15], [40, 35]],
    velocities=[[1.0, 0.5], [-2.0, 0.0], [0.0, 1.5], [1.5, -2.0], [0.0, 3.0], [-0.5, -0.5]],
    ids=["Ada", "Bea", "Cleo", "Dora", "Edda", "Fay"],
    name="six lorries",
)
print(model)
print(f"sparsity {model.sparsity:.2f}")

# %%
# Arrows show the motion of the lorries.

field = ct.plot(model)

# %%
# Solve the problem
# -----------------
# The verification integrates the turns and lines of the tour, and checks that every lorry is within
# range at its time. The bound is proven, so the gap limits the possible improvement.

best = ct.solve(model, time_limit=1, seed=1)
print(best.summary())
for lorry, time in zip(best.plan.order, best.plan.times, strict=True):
    print(f"{time:6.2f} s  {model.label(lorry)}")

# %%
# The colour of the path shows the time. Discs show the positions of the lorries at the encounters.

tour = ct.plot(model, best)

# %%
# Write an animation:

with TemporaryDirectory() as folder:
    file = Path(folder) / "tour.gif"
    animate_tour(model, best, frames=10, size=(3.4, 3.4)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")

# %%
# Compare with the paper's algorithm
# ----------------------------------
# The memetic algorithm and the greedy algorithm are heuristics, and both meet lorries only at the
# edge of their discs. ``curvature-bound`` proves a lower bound on the length of every tour. No
# backend proves optimality here, so the verdict is inconclusive. A tour below the bound would be a
# contradiction.

comparison = ct.compare(
    [model], ["memetic", "greedy-boundary", "curvature-bound"], time_limit=10, seed=1
)
print(comparison)
runs = comparison.verdicts[0].solutions
progress = draw_progress([best, *runs])

bound = max(run.dual_bound for run in runs if run.dual_bound is not None)
lengths = [run.primal_bound for run in (best, *runs) if run.primal_bound is not None]
assert bound <= min(lengths)
print(f"bound {bound:.2f} m, best {min(lengths):.2f} m, gap {1 - bound / min(lengths):.1%}")

# %%
# Verify a modified plan
# ----------------------
# A plan from any source is verified in the same way. Here one turn is too long, so all later
# positions are wrong. The plot marks the worst violations.

data = model.plan_to_data(best.plan)
turn = next(
    k for k, one in enumerate(data["primitives"]) if one["turn"] != "S" and one["length"] > 0
)
data["primitives"][turn]["length"] += 0.5
found = ct.verify(model, data)
print(found)
assert not found.ok
wrong = ct.plot(model, data)

# %%
# Instances with gaps in the path length
# --------------------------------------
# A lorry leaves the UAV's left turning circle just when a short turn would arrive too early. No
# feasible path is slightly longer than this turn, so the lorry is met much later.

gap = ct.load("messenger/gap")
waited = ct.solve(gap, time_limit=1, seed=1)
print(waited.plan)
detour = ct.plot(gap, waited)
