"""
A flight through a forest
=========================

A quadrotor flies from one corner of a forest to the other. One call plans path, corridor and curve, and proves that the
curve is clear of all obstacles and within thrust, tilt, body rate and speed.
"""

import crosstrack as ct
from crosstrack.instances.flight import forest
from crosstrack.models import Flight, Quadrotor

ends = [[1.5, 1.5, 2.5], [23.5, 23.5, 2.5]]
world = forest(4, (25.0, 25.0, 5.0), pillars=40, rings=10, keep=ends)
quadrotor = Quadrotor(mass=0.61, thrust=(2.0, 12.0), tilt=1.05, body_rate=2.1, speed=4.0)

model = Flight(world, *ends, quadrotor, radius=0.2, name="forest")
flight = ct.solve(model)  # ct.plan_flight(world, *ends, quadrotor, radius=0.2) is the same
print(flight)
print(flight.verification)

# %%
# The dashed line is the path over free cells. The panels show the limited quantities of the vehicle.

ct.plot(model, flight)

# %%
# In the air, the rest of the flight is planned again from the state of the vehicle, here after it was blown off.

prepared = ct.prepare(model)
replan = prepared.replan(ends[0])
state = [replan.trajectory(2.0, order) for order in range(3)]
state[0] = state[0] + [0.05, 0.05, -0.05]
replan = prepared.replan(*state)
print(replan.ok, replan.warm, round(replan.trajectory.duration, 2))

# %%
# The smoothest curve in the same corridor, stretched to the limits, takes longer.

print(ct.compare([model], ["minco", "staged"]))
