"""Native algorithms for routes of a fleet."""

BACKENDS = {
    "subset-dp": ".subset_dp:SubsetDP",
}
DIAGNOSES = {"fleet-routing": ".diagnosis:diagnose_fleet"}
