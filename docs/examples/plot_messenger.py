"""
One UAV, six lorries and a proven bound
=======================================

A fixed-wing UAV must come within radio range of lorries that drive while it flies, as soon as it can. It
cannot turn on the spot. This example declares such a problem, solves it, draws it still and in motion,
sets the paper's algorithm beside it, and ends with a bound that no tour can beat.
"""

# %%
# The problem
# -----------
# Positions at time 0 and velocities, in metres and metres a second. The UAV begins at the origin and
# flies north; by default it makes 10 m/s, turns with a radius of 5 m and must come within 5 m.

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
# Arrows tell where the lorries go.

field = ct.plot(model)

# %%
# The answer
# ----------
# The tour is verified: its turns and lines are integrated anew, and every lorry has to be within range
# when the tour says so. The bound is proven, so the gap says how much shorter a tour could be at best.

best = ct.solve(model, time_limit=1, seed=1)
print(best.summary())
for lorry, time in zip(best.plan.order, best.plan.times, strict=True):
    print(f"{time:6.2f} s  {model.label(lorry)}")

# %%
# The path takes its colour from time. Discs stand where the lorries are when they are met.

tour = ct.plot(model, best)

# %%
# The same in motion:

with TemporaryDirectory() as folder:
    file = Path(folder) / "tour.gif"
    animate_tour(model, best, frames=10, size=(3.4, 3.4)).save(file, writer="pillow", dpi=60)
    print("an animation of", file.stat().st_size // 1024, "kB")

# %%
# Beside the paper's algorithm
# ----------------------------
# The memetic algorithm is the paper's, the greedy one a rival of it; both are heuristics, and both meet
# lorries on the edge of their discs only. The third proves what no tour can be shorter than. Nobody
# proves that a tour is the best here, so the verdict stays inconclusive; a tour below the bound would be
# a contradiction.

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
# What is not believed
# --------------------
# A plan from anywhere is checked in the same way. Here a turn is a little longer than it should be: all
# that follows is off its place, and the worst places are ringed.

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
# When waiting is not possible
# ----------------------------
# A lorry slips out of the UAV's left turning circle just when a short turn would lead there too early.
# No path that the UAV can fly is a little longer than that turn, so the lorry is met much later.

gap = ct.load("messenger/gap")
waited = ct.solve(gap, time_limit=1, seed=1)
print(waited.plan)
detour = ct.plot(gap, waited)
