"""
Declare an optimal control problem
==================================

A cart must turn around before a wall with minimum effort: the problem of Bryson and Denham, in
twelve lines. This example declares and solves it, shows the verification, and compares three
transcriptions. It then covers another bound, a path constraint, a free final time, costates, two
phases, a warm start, infeasibility and files.
"""

# %%
# Declare the problem
# -------------------
# States and controls are CasADi symbols. Dynamics, constraints and costs may contain every
# expression that CasADi can differentiate.

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory

import crosstrack as ct
from crosstrack.models import Model, OptimalControlProblem
from crosstrack.models.optimal_control import hamiltonian_spread
from crosstrack.solvers import Solution


def cart(wall):
    ocp = OptimalControlProblem(f"cart before a wall at {wall:.3g}")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=wall, unit="m")
    v = phase.state("v", initial=1, final=-1, unit="m/s")
    u = phase.control("u", unit="m/s^2")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2 / 2), unit="m²/s³")
    return ocp


model = cart(1 / 9)
best = ct.solve(model, tolerance=1e-6)
print(best)

# %%
# The known optimum is 4 / (9 l) for a wall at l up to 1/6, so 4 here.

print(f"off by {best.primal_bound - 4:+.1e}")
assert abs(best.primal_bound - 4) < 1e-6

# %%
# Verification
# ------------
# The verification integrates the control with a method other than the transcription, and searches
# for violations of the bound between the nodes. A small residual at the nodes would prove neither.

print(best.verification)

# %%
# The plan is a function of time. In the plot, dots are the nodes of the mesh and ticks its knots.
# The refinement has concentrated them at the contact with the wall. Costates and the distance from
# the integrated motion are drawn on request.

print("x, v and u at 0.2 s:", *(f"{best.plan[name](0.2):.6f}" for name in ("x", "v", "u")))
figure = ct.plot(model, best, costates=True, deviation=True)

# %%
# Compare three transcriptions
# ----------------------------
# Radau, Gauss and Hermite-Simpson share the declared functions and little else. Nonlinear solvers
# prove no bound, so the verdict is inconclusive at best. Agreement of the three values is the
# strongest available evidence.

comparison = ct.compare(
    [model], ["ipopt:radau", "ipopt:gauss", "ipopt:hermite-simpson"], time_limit=60
)
print(comparison)
values = [solution.primal_bound for solution in comparison.verdicts[0].solutions]
assert max(values) - min(values) < 1e-6

# %%
# From another start a solver may reach another optimum. ``starts=`` runs several random starts and
# returns all results. Here all of them reach the same optimum.

again = ct.solve(model, starts=4, seed=1)
for start in again.starts:
    print(f"{start.termination}: {start.primal_bound:.9f}")

# %%
# Another bound
# -------------
# A declaration can be a Python function of any parameter. If the wall is far away, the cart does
# not reach it.

for wall, wanted in ((1 / 9, 4), (1 / 6, 8 / 3), (0.3, 2)):
    found = ct.solve(cart(wall)).primal_bound
    print(f"wall at {wall:.3f}: {found:.6f}, exactly {wanted:.6f}")

# %%
# A path constraint
# -----------------
# A path constraint holds at every instant. Constraints can be added at any time; the problem then
# has another digest.


def gentle(wall, power):
    ocp = OptimalControlProblem(f"cart with at most {power:g} W/kg")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=wall, unit="m")
    v = phase.state("v", initial=1, final=-1, unit="m/s")
    u = phase.control("u", lower=-20, upper=20, unit="m/s^2")
    phase.dynamics({x: v, v: u})
    phase.path(u * v, lower=-power, upper=power, name="power", unit="W/kg")
    ocp.minimise(phase.integral(u**2 / 2), unit="m²/s³")
    return ocp


power = gentle(1 / 9, 4.0)
held = ct.solve(power)
print(held)
constrained = ct.plot(power, held)

# %%
# A free final time
# -----------------
# A free time has a range. Its symbol is ``phase.end``, which is the objective here: the minimum
# time for 1 m from rest to rest is 2 s. An earlier plan is a good start for a related problem:
# ``phase.guess(plan)`` copies the values with the same names, including the times.


def quickest(guess=None):
    ocp = OptimalControlProblem("quickest metre")
    phase = ocp.phase(time=(0, (0.5, 10)))
    x = phase.state("x", initial=0, final=1, unit="m")
    v = phase.state("v", initial=0, final=0, unit="m/s")
    u = phase.control("u", lower=-1, upper=1, unit="m/s^2")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.end, unit="s")
    if guess is not None:
        phase.guess(guess)
    return ocp


quick = ct.solve(quickest())
print(f"{quick.plan.end:.9f} s")
assert abs(quick.plan.end - 2) < 1e-6
warm = ct.solve(quickest(guess=quick))
print(
    "iterations:",
    quick.statistics["iterations"],
    "and from its plan",
    warm.statistics["iterations"],
)

# %%
# Costates
# --------
# The plan contains the costates. They determine the Hamiltonian, which is constant at an optimum.
# The solver does not use this necessary condition. Here one second of free time costs 1, so the
# Hamiltonian must be -1 throughout. Discrete costates are inaccurate at jumps of the control.

(report,) = hamiltonian_spread(quickest(), quick.plan)
print(f"Hamiltonian: mean {report.mean:+.4f}, at the end {report.end:+.4f}")
print(f"farthest from its median by {report.spread:.1e}, at {report.time:.4f} s")

# %%
# Two phases
# ----------
# The engine accelerates with up to 1 m/s², and the brakes decelerate with up to half of that. Each
# phase has its own controls and limits. ``link`` makes the second phase begin at the final time and
# state of the first. The analytical optimum is √6 s.

relay = OptimalControlProblem("push, then brake")
push = relay.phase("push", time=(0, (0.1, 5)))
brake = relay.phase("brake", time=((0.1, 5), (0.2, 10)))
for phase, name, low, high in ((push, "engine", 0, 1), (brake, "brakes", -0.5, 0)):
    x = phase.state("x", initial=0 if phase is push else None, unit="m")
    v = phase.state("v", initial=0 if phase is push else None, lower=0, unit="m/s")
    u = phase.control(name, lower=low, upper=high, unit="m/s^2")
    phase.dynamics({x: v, v: u})
relay.subject_to(brake.final(brake.symbols["x"]), equals=1, name="arrives", unit="m")
relay.subject_to(brake.final(brake.symbols["v"]), equals=0, name="stands", unit="m/s")
relay.link(push, brake)
relay.minimise(brake.end, unit="s")
both = ct.solve(relay)
print(both)
print(f"exactly {math.sqrt(6):.9f} s")
assert abs(both.primal_bound - math.sqrt(6)) < 1e-6
phases = ct.plot(relay, both)

# %%
# Infeasible problems
# -------------------
# Half a second is too short. A nonlinear solver cannot prove this, so the answer is *locally
# infeasible*, with the most violated blocks. ``diagnose`` lists the constraints that would have to
# be relaxed.

hasty = OptimalControlProblem("too hasty")
phase = hasty.phase(time=(0, 0.5))
x = phase.state("x", initial=0, final=1, unit="m")
v = phase.state("v", initial=0, final=0, unit="m/s")
u = phase.control("u", lower=-1, upper=1, unit="m/s^2")
phase.dynamics({x: v, v: u})
hasty.minimise(phase.integral(u**2))
print(ct.solve(hasty))
print(ct.diagnose(hasty))

# %%
# An invalid declaration raises an error immediately, and a missing one at the first use:

try:
    forgotten = OptimalControlProblem()
    phase = forgotten.phase(time=(0, 1))
    y = phase.state("y", initial=0)
    forgotten.minimise(phase.final(y))
    ct.solve(forgotten)
except ct.CrosstrackError as error:
    print(error)

# %%
# Save and load
# -------------
# Problem and solution are written to JSON and read back without loss, including compiled functions.

with TemporaryDirectory() as folder:
    problem_file, answer_file = Path(folder) / "cart.json", Path(folder) / "answer.json"
    problem_file.write_text(model.to_json())
    answer_file.write_text(best.to_json())
    same = Model.from_json(problem_file.read_text())
    kept = Solution.from_dict(json.loads(answer_file.read_text()), model=same)
assert same.digest == model.digest
print(ct.verify(same, kept).summary())
