"""Native algorithms for polynomial trajectories."""

#: Names that modules of other problems import.
SHARED = (
    *("minco.INSTANTS", "minco.Fastest", "minco.Region", "minco.Rows", "minco.Search"),
    *(
        "minco.coefficients_of",
        "minco.fastest",
        "minco.limits_of",
        "minco.peak",
        "minco.powers_between",
    ),
    *("minco_limits.Task", "minco_limits.measure", "minco_task.posed"),
)
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
