"""Native algorithms for routes with resources; the loops are compiled by Numba."""

#: Names that modules of other problems import, beside the public ones.
SHARED = (
    "diagnosis.diagnose_resources",
    "elementary.Found",
    "first.route_in_time",
    "front_kernels.trace",
    "front_kernels.widened",
    "labelling.ResourceLabelling",
    "native.RouteSearch",
    "outcomes.DEAR",
    "outcomes.FOUND",
    "outcomes.FULL",
    "outcomes.NOTHING",
    "outcomes.OPEN",
    "outcomes.STOPPED",
)
BACKENDS = {"resource-labelling": ".labelling:ResourceLabelling"}
DIAGNOSES = {"resource-routing": ".diagnosis:diagnose_resources"}
