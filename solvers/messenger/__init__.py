"""Native algorithms for tours of a messenger UAV, with loops compiled by Numba."""

BACKENDS = {
    "tour-search": ".search:TourSearch",
    "crew-search": ".crew_search:CrewSearch",
    "detour-search": ".detour_search:DetourSearch",
    "memetic": ".memetic:Memetic",
    "memetic-untransformed": ".memetic:MemeticUntransformed",
    "memetic-relaxed": ".memetic:MemeticRelaxed",
    "variable-neighbourhood": ".heuristics:VariableNeighbourhood",
    "greedy-boundary": ".heuristics:GreedyBoundary",
    "greedy-centre": ".heuristics:GreedyCentre",
    "direct-sampling": ".heuristics:DirectSampling",
    "euclidean-bound": ".bound:EuclideanBound",
    "curvature-bound": ".bound:CurvatureBound",
}
DIAGNOSES = {"messenger-tour": ".diagnosis:diagnose_tour"}
