"""Native algorithms for routes with resources; the loops are compiled by Numba."""

BACKENDS = {"resource-labelling": ".labelling:ResourceLabelling"}
DIAGNOSES = {"resource-routing": ".diagnosis:diagnose_resources"}
