"""Errors of the recommended estimator and of all others on the catalogue and on drawn drives."""

import numpy as np

from crosstrack.instances.sideslip.drivers import FIXED, RANGES, Driver
from crosstrack.instances.sideslip.generator import generate
from crosstrack.instances.sideslip.listing import _WILD, MISMATCH
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.contract.selection import recommended

#: All estimators but ``moving-horizon``, which equals ``kalman-filter`` for linear tyres.
NAMES = (
    "rts-smoother", "kalman-filter", "unscented-filter", "kalman-grnn", "smoother-grnn", "grnn", "linear-regression",
)  # fmt: skip
ROADS = ("lane-change", "serpentine")
CATALOGUE = {
    **{name: dict(fields) for name, _, fields in _WILD if name not in ("long", "unknown", "untrained")},
    **{road: {"road": road} for road in ROADS},
    **{f"{road}-mismatch": {"road": road, "mismatch": MISMATCH} for road in ROADS},
    "lane-change, one drive to learn from, mismatch": {"drivers": 1, "mismatch": MISMATCH},
    "lane-change, mass believed 10 % too large": {"mismatch": {"mass": 1.1}},
}  # fmt: skip
#: Kinds of drawn drives: right vehicle, lower friction, wrong vehicle, biased sensors, lower friction and biased sensors.
KINDS = ("right", "friction", "vehicle", "bias", "friction and bias")


def drawn(seed):
    """Return kind and fields of a random drive with random training drives."""
    rng = np.random.default_rng([seed, 7])

    def between(low, high):
        return float(np.round(rng.uniform(low, high), 4))

    low, high = np.array(list(RANGES.values())).T
    factors = np.round(low + (high - low) * rng.random(len(low)), 6).tolist()
    kind, road = KINDS[seed % len(KINDS)], ROADS[int(rng.integers(2))]
    fields = {
        "road": road, "seed": seed, "drivers": int(rng.integers(3, 16)),
        "speed": between(12.0, 23.0 if road == "lane-change" else 19.0),
        "driver": Driver(**dict(zip(RANGES, factors, strict=True)), **FIXED),
    }  # fmt: skip
    if "friction" in kind:
        friction = between(0.3, 0.9)
        fields |= {"tyre": "saturating", "friction": friction, "training_friction": 0.9}
        fields["mismatch"] = {"friction": 0.9 / friction}
    if kind == "vehicle":
        fields["mismatch"] = {
            "mass": between(0.8, 1.3), "cornering_front": between(0.7, 1.2), "cornering_rear": between(0.8, 1.2),
        }  # fmt: skip
    if "bias" in kind:
        fields["bias"] = (between(-0.02, 0.02), between(-0.3, 0.3))
    return kind, fields


def errors_of(fields, names=NAMES):
    """Return the recommended backend of a drive, and the mean error (degrees) of each estimator."""
    model = generate(**fields)
    errors = {}
    for name in names:
        backend = find_backend(name)
        request = Request(options=backend.checked_options({}))
        errors[name] = model.verify(backend.run(model.blinded(), request).point).objective
    return recommended(model).name, errors
