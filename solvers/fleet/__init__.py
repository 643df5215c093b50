"""Algorithms for the routes of a fleet; the loops are compiled by Numba."""

BACKENDS = {
    "subset-dp": ".subset_dp:SubsetDP",
    "column-generation": ".column_generation:ColumnGeneration",
    "fleet-search": ".fleet_search:FleetSearch",
    "pso-ac": ".two_phases:PsoAntColony",
    "pso-ac-serial": ".two_phases:PsoAntColonySerial",
    "tpha": ".two_phases:TwoPhase",
    "kmeans-ac": ".two_phases:KMeansAntColony",
    # "auto" takes the first heuristic that supports a rich fleet; tests/benchmarks/fleet/rich_classes.py.
    "pyvrp": ".pyvrp_routing:PyVrpRouting",
    "ortools-routing": ".ortools_routing:OrToolsRouting",
}
DIAGNOSES = {"fleet-routing": ".diagnosis:diagnose_fleet"}
