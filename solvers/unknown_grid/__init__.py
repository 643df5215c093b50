"""Policies that move a vehicle on an unknown map from a view around it."""

BACKENDS = {
    "d-star-lite": ".replanning:DStarLite",
    "a-star-replanning": ".replanning:AStarReplanning",
    "current-view": ".replanning:CurrentView",
    "baseline-1": ".baselines:BaselineOne",
    "baseline-1-reachable": ".baselines:BaselineOneReachable",
    "baseline-2": ".baselines:BaselineTwo",
    "baseline-2-reachable": ".baselines:BaselineTwoReachable",
    "small-vin": ".learned:SmallVin",
    "vin": ".learned:Vin",
    "macn": ".learned:Macn",
    "mcgn": ".learned:Mcgn",
    "oracle": ".oracle:Oracle",
}
DIAGNOSES = {"unknown-grid": ".diagnosis:diagnose_unknown_grid"}
TRAININGS = {
    "small-vin": ".networks:SMALL_VIN",
    "vin": ".networks:VIN",
    "macn": ".networks:MACN",
    "mcgn-1": ".networks:MCGN_1",
    "mcgn-2": ".networks:MCGN_2",
    "gmgn": ".networks:GMGN",
}
