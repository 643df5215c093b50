"""Estimators of a vehicle's sideslip angle."""

BACKENDS = {
    "rts-smoother": ".kalman:RtsSmoother",
    "kalman-filter": ".kalman:KalmanFilter",
    "unscented-filter": ".unscented:UnscentedFilter",
    "moving-horizon": ".moving_horizon:MovingHorizon",
    "kalman-grnn": ".regression:KalmanGrnn",
    "grnn": ".regression:Grnn",
    "linear-regression": ".regression:LinearRegression",
}
DIAGNOSES = {"sideslip": ".diagnosis:diagnose_sideslip"}
