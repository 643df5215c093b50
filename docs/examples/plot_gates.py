"""
Minimum time through gates
==========================

A quadrotor flies through a ring, a window and a ball as fast as its thrust, tilt and body rates allow. The
passing points are free. Two polynomials per leg and then three are compared.
"""

# %%
# The track
# ---------
# A gate belongs to a knot whose waypoint is free. Knots between the gates are free, too.

import numpy as np

import crosstrack as ct
from crosstrack.models import Gate, MinimumDerivative, Quadrotor, TimeAllocation

quadrotor = Quadrotor(mass=0.6, thrust=(2.0, 12.0), tilt=1.0, body_rate=5.0)
window = [[6, -1.5, 1], [6, -1.5, 2], [6, -0.5, 2], [6, -0.5, 1]]


def track(pieces: int) -> TimeAllocation:
    gates = [
        Gate(pieces, centre=[3, 1, 1.5], radius=0.4, normal=[1, 0, 0]),
        Gate(2 * pieces, polygon=window),
        Gate(3 * pieces, centre=[9, 1, 1], radius=0.4),
    ]
    free = [[None] * 3] * (4 * pieces - 1)
    return TimeAllocation(
        [[0, 0, 1], *free, [12, 0, 1]], order=3, gates=gates, vehicle=quadrotor, minimise="time"
    )


for pieces in (1, 2, 3):
    solution = ct.solve(track(pieces))
    print(f"{pieces} per leg: {solution.plan.duration:.3f} s, verified: {solution.verification.ok}")

# %%
# The flight
# ----------
# The largest values of the limited quantities are close to their limits. The verification proves the extremes; the
# samples below only show them.

model = track(3)
plan = ct.solve(model).plan
for name, value in quadrotor.quantities(plan, np.linspace(0, plan.duration, 2001)).items():
    if name in ("thrust", "tilt", "body_rate"):
        print(f"{name}: {value.min():.3f} to {value.max():.3f}")

ct.plot(model, plan)

# %%
# At the times of this flight, the passing points of least effort are a convex problem. Two interfaces of cone
# solvers agree on its optimum:

model = track(1)
timed = model.at(ct.solve(model).plan.times)
timed = MinimumDerivative(timed.waypoints, timed.times, order=3, gates=timed.gates)
print(ct.compare(timed, ["clarabel", "cvxpy"]))
