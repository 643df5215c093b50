"""
Is this motion chaotic?
=======================

A series is measured once, and nothing else is known of what made it. Its states are rebuilt from delayed values, and two
slopes are read from how they lie and part: the largest Lyapunov exponent and the correlation dimension. This
example estimates both where the truth is known, shows that linear noise has a positive exponent as well, and what tells the
two apart.
"""

# %%
# A motion that is known
# ----------------------
# One coordinate of Lorenz' equations, 5000 samples. A diagnosis tells what the series lets an estimate mean, before anything
# is fitted.

import math

import crosstrack as ct
from crosstrack.models import AttractorAnalysis

lorenz = ct.load("attractor/lorenz")
print(lorenz)
print(ct.diagnose(lorenz))

# %%
# The full analysis chooses an embedding, fits both slopes and sets the series against surrogates. The exponent and the
# dimension are known for this one, 0.906 nats/s and 2.05, but backends do not see them.

found = ct.solve(lorenz, "full-analysis", seed=1)
print(found.plan)
print(
    f"an error doubles in {found.plan.doubling_time:.2f} s, grows e-fold in {found.plan.horizon:.2f} s"
)
few, enough = found.plan.variables
print(f"{few} variables at the least, {enough} suffice")
print(found.verification)

# %%
# Every slope stands beside the curve it was fitted to, and the region is shaded. A slope whose curve is not straight
# there says nothing.

curves = ct.plot(lorenz, found)

# %%
# The slopes of the curves from place to place show it better: they are level where there is a scaling region.

slopes = ct.plot(lorenz, found, view="slopes")

# %%
# A noise that is called chaotic
# ------------------------------
# Filtered noise is no motion on an attractor. But nearby values part for a while in any series, so a line that
# is fitted to a region given beforehand has a positive slope. The delay and the dimension are those of the paper.

noise = ct.load("attractor/ar2")
forced = ct.solve(
    noise, "rosenstein",
    backend_options={"delay": 8, "dimension": 10, "theiler": 80, "low": 0, "high": 20},
)  # fmt: skip
exponent = forced.plan.exponent
print(f"exponent of noise: {exponent} nats/s, {exponent.value / math.log(2):.3g} bits/s")
assert exponent.value > 2 * exponent.deviation

# %%
# Asked to choose its region, the same backend finds none, and says so; and surrogates, which are linear noise with
# the same values and the same spectrum, are predicted no worse than the series.

judged = ct.solve(noise, "full-analysis", seed=1)
print(judged.plan)
print(judged.message)
assert str(judged.plan.surrogates.judgement) == "noise"

# %%
# Two methods, one exponent
# -------------------------
# Rosenstein's method follows the nearest neighbour, Kantz' all within a radius. Both are estimates, so however well they
# agree, nothing is proven, and the verdict says so.

henon = ct.load("attractor/henon")
comparison = ct.compare([henon], ["rosenstein", "kantz"])
print(comparison)

# %%
# One's own series
# ----------------
# An array and the time between samples are all it takes; ``read_series`` of ``crosstrack.instances.attractor`` reads
# a file with units. Without a plan, the picture is the series and its delay plot.

positions = [math.sin(0.31 * k) + 0.4 * math.sin(0.31 * math.sqrt(2) * k) for k in range(1500)]
own = AttractorAnalysis(positions, period=0.1, unit="m", name="two sines")
measured = ct.plot(own)
print(ct.diagnose(own))
