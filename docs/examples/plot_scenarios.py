"""
Control an uncertain mass
=========================

A lander descends without feedback to a low point, and brakes by itself there. Its mass is known to 4 %.
The cheapest plan for the nominal mass ends close to a limit, which about a quarter of all landers
violate. One control for several masses keeps the limits for all of them. This example declares both, and flies 1,000
landers with drawn masses.
"""

# %%
# Declare the problem
# -------------------
# The mass is declared as data. The height must stay positive and end below 4 m.

import numpy as np

import crosstrack as ct
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import monte_carlo, scenario_plan

ocp = OptimalControlProblem("descent")
mass = ocp.data("mass", value=1.0, unit="t")
phase = ocp.phase(time=(0, 6))
height = phase.state("height", initial=10, lower=0, final=(0, 4), unit="m")
speed = phase.state("speed", initial=-2, unit="m/s")
thrust = phase.control("thrust", lower=0, upper=3, unit="kN")
phase.dynamics({height: speed, speed: thrust / mass - 1.5})
ocp.minimise(phase.integral(thrust**2) + 10 * phase.final(speed) ** 2)

# %%
# The nominal plan
# ----------------
# Every limit holds for the mass of 1 t. ``monte_carlo`` flies the same thrust with drawn masses, and
# counts the flights that keep each limit, with a 95 % interval. This is sampled evidence, not a proof.

nominal = ct.solve(ocp)
print(nominal)
flights = monte_carlo(ocp, nominal.plan, {"mass": (0.96, 1.04)}, draws=1000, seed=0)
print(flights)
assert flights.all_limits.high < 0.8

# %%
# One thrust for three masses
# ---------------------------
# The problem with scenarios has the states of all three landers, and one thrust. Its constraints hold for
# each of them. The objective is the mean, or with ``objective="worst"`` the largest one.

masses = {"light": {"mass": 0.96}, "nominal": {"mass": 1.0}, "heavy": {"mass": 1.04}}
robust = ocp.scenarios(masses)
print(robust.definition.phases[0].state_names)
best = ct.solve(robust)
print(best)
figure = ct.plot(robust, best)

# %%
# The plan of each scenario is a plan of the original problem with these data, and verifies by itself.

for name, data in masses.items():
    part = scenario_plan(ocp, best.plan, name)
    result = ocp.given(**data).verify(part)
    print(f"{name}: ends at {float(part['height'](6.0)):.3f} m, objective {result.objective:.4f}")
    assert result.ok

# %%
# The motion is monotone in the mass, so the limits of the two extreme masses hold for all masses between.
# The flights confirm it.

part = scenario_plan(ocp, best.plan, "nominal")
flights = monte_carlo(ocp, part, {"mass": (0.96, 1.04)}, draws=1000, seed=0, tolerance=1e-5)
print(flights)
assert flights.all_limits.kept == 1000

# %%
# The price of robustness
# -----------------------
# The robust thrust costs more than the nominal one for the nominal mass.

print(f"nominal {nominal.primal_bound:.4f}, robust {ocp.verify(part).objective:.4f}")
print("heights at the end:", np.round([best.plan[f"height ({name})"](6.0) for name in masses], 3))

# %%
# Another transcription confirms the optimum of all scenarios.

print(ct.compare(robust, ["ipopt:radau", "ipopt:gauss"], time_limit=60))
