"""
A problem and its general case
==============================

Routing with error correction is a special case of routing with resources: two errors grow along the
route and are reset at points. A model returns its general case, so algorithms for both problems can
be compared on the same instance to detect faults.
"""

# %%
# The special case
# ----------------

import crosstrack as ct

model = ct.load("error-correction/1")
special = ct.solve(model, "label-setting")
print(special)

# %%
# The general case
# ----------------
# ``lower`` returns the equivalent model of routing with resources, with the same points.

general = model.lower()
print(general.describe())
lowered = ct.solve(general, "resource-labelling")
print(lowered)
assert abs(lowered.primal_bound - special.primal_bound) < 1e-6 * special.primal_bound

# %%
# Each model can verify the route of the other from its own data.

print(ct.verify(general, special.plan))
print(ct.verify(model, lowered.plan))

# %%
# Compare the algorithms
# ----------------------
# The verdict is AGREED if a verified plan and a proof meet.

verdict = ct.compare(
    model, ["label-setting", "resource-labelling", "pulse", "highs"], time_limit=60
)
print(verdict)

# %%
# Draw the route and its errors:

picture = ct.plot(model, special)

# %%
# Next step: add a third resource, such as fuel, as in :doc:`plot_resource_routing`. The special
# case cannot express it.
