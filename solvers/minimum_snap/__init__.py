"""Native algorithms for polynomial trajectories."""

BACKENDS = {
    "banded": ".direct:Banded",
    "interior-point": ".interior_point:InteriorPoint",
    "time-gradient": ".time_gradient:TimeGradient",
    "time-trapezoid": ".time_heuristics:TimeTrapezoid",
    "time-distance": ".time_heuristics:TimeDistance",
    "time-simplex": ".time_simplex:TimeSimplex",
}
DIAGNOSES = {
    "minimum-derivative": ".diagnosis:diagnose_trajectory",
    "minimum-snap": ".diagnosis:diagnose_trajectory",
}
PAPER_TABLES = {"minimum-snap": ".paper_tables:TABLES"}
