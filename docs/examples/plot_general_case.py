"""
A problem and its general case
==============================

Error correction is a case of routes with resources: two errors grow along the way and are reset at
points. A model says itself what it is a case of, so that algorithms of both answer the same question,
and a fault in either shows.
"""

# %%
# The special case
# ----------------

import crosstrack as ct

model = ct.load("error-correction/1")
special = ct.solve(model, "label-setting")
print(special)

# %%
# The general one
# ---------------
# ``lower`` returns the route with resources that the model is a case of, with the same points.

general = model.lower()
print(general.describe())
lowered = ct.solve(general, "resource-labelling")
print(lowered)
assert abs(lowered.primal_bound - special.primal_bound) < 1e-6 * special.primal_bound

# %%
# Plans travel: the route of one is verified by the other, from its own data.

print(ct.verify(general, special.plan))
print(ct.verify(model, lowered.plan))

# %%
# Two algorithms and a program judge one another
# ----------------------------------------------
# The verdict is AGREED where a verified plan and a proof of another backend meet.

verdict = ct.compare(
    model, ["label-setting", "resource-labelling", "pulse", "highs"], time_limit=60
)
print(verdict)

# %%
# The route, with the errors that decide it.

picture = ct.plot(model, special)

# %%
# What to try next: a third resource, such as fuel, in :doc:`plot_resource_routing`, which the special
# case cannot say.
