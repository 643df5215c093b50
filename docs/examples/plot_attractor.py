"""
Detect chaos in a time series
=============================

This example decides whether a measured time series is chaotic. States are reconstructed from
delayed values, and two quantities are estimated from them: the largest Lyapunov exponent and the
correlation dimension. The example estimates both for a system with known values, shows that linear
noise can also have a positive exponent, and uses surrogates to distinguish the two.
"""

# %%
# A known system
# --------------
# The series is one coordinate of the Lorenz system, 5000 samples. The diagnosis shows before any
# fit which estimates the series supports.

import math

import crosstrack as ct
from crosstrack.models import AttractorAnalysis

lorenz = ct.load("attractor/lorenz")
print(lorenz)
print(ct.diagnose(lorenz))

# %%
# The full analysis selects an embedding, fits both slopes and compares the series with surrogates.
# The known values are 0.906 nats/s for the exponent and 2.05 for the dimension. They are hidden
# from the backends.

found = ct.solve(lorenz, "full-analysis", seed=1)
print(found.plan)
print(
    f"an error doubles in {found.plan.doubling_time:.2f} s, grows e-fold in {found.plan.horizon:.2f} s"
)
few, enough = found.plan.variables
print(f"{few} variables at the least, {enough} suffice")
print(found.verification)

# %%
# The plot shows each curve with the fitted slope and the shaded region of the fit. A slope is
# meaningless if its curve is not straight there.

curves = ct.plot(lorenz, found)

# %%
# The local slopes show this more clearly: they are constant in a scaling region.

slopes = ct.plot(lorenz, found, view="slopes")

# %%
# Noise with a positive exponent
# ------------------------------
# Filtered noise is not a motion on an attractor. But nearby values diverge for a while in any
# series, so a line fitted to a fixed region has a positive slope. The delay and the dimension are
# those of the paper.

noise = ct.load("attractor/ar2")
forced = ct.solve(
    noise, "rosenstein",
    backend_options={"delay": 8, "dimension": 10, "theiler": 80, "low": 0, "high": 20},
)  # fmt: skip
exponent = forced.plan.exponent
print(f"exponent of noise: {exponent} nats/s, {exponent.value / math.log(2):.3g} bits/s")
assert exponent.value > 2 * exponent.deviation

# %%
# If the same backend selects the region itself, it finds no scaling region and reports this.
# Surrogates are linear noise with the same values and the same spectrum. They are predicted as well
# as the series.

judged = ct.solve(noise, "full-analysis", seed=1)
print(judged.plan)
print(judged.message)
assert str(judged.plan.surrogates.judgement) == "noise"

# %%
# Two methods, one exponent
# -------------------------
# Rosenstein's method follows the nearest neighbour, Kantz' method all neighbours within a radius.
# Both are estimates, so agreement is not a proof, and the verdict states this.

henon = ct.load("attractor/henon")
comparison = ct.compare([henon], ["rosenstein", "kantz"])
print(comparison)

# %%
# Use your own series
# -------------------
# A series is an array with the time between samples. ``read_series`` of
# ``crosstrack.instances.attractor`` reads a file with units. Without a plan, the plot shows the
# series and its delay plot.

positions = [math.sin(0.31 * k) + 0.4 * math.sin(0.31 * math.sqrt(2) * k) for k in range(1500)]
own = AttractorAnalysis(positions, period=0.1, unit="m", name="two sines")
measured = ct.plot(own)
print(ct.diagnose(own))
