"""Native algorithms for polynomial trajectories."""

BACKENDS = {
    "banded": ".direct:Banded",
    "interior-point": ".interior_point:InteriorPoint",
    "time-gradient": ".time_gradient:TimeGradient",
    "minco": ".minco_backend:Minco",
}
DIAGNOSES = {
    "minimum-derivative": ".diagnosis:diagnose_trajectory",
    "minimum-snap": ".diagnosis:diagnose_trajectory",
}
