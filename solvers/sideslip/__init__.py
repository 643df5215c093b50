"""Estimators of a vehicle's sideslip angle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .online import OnlineEstimate as OnlineEstimate, OnlineFilter as OnlineFilter

BACKENDS = {
    "rts-smoother": ".kalman:RtsSmoother",
    "kalman-filter": ".kalman:KalmanFilter",
    "unscented-filter": ".unscented:UnscentedFilter",
    "moving-horizon": ".moving_horizon:MovingHorizon",
    "kalman-grnn": ".regression:KalmanGrnn",
    "smoother-grnn": ".regression:SmootherGrnn",
    "grnn": ".regression:Grnn",
    "linear-regression": ".regression:LinearRegression",
}
DIAGNOSES = {"sideslip": ".diagnosis:diagnose_sideslip"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
