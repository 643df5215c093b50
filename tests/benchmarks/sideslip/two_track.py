"""Errors of the estimators on the two-track simulator with Magic Formula tyres, and on a recorded race-track drive.

``python tests/benchmarks/sideslip/two_track.py`` writes tables of ``docs/measured/sideslip.json``. Values are means over the
seeds of the sensor noise. The UKF of filterpy is measured if it is installed. Names of functions as arguments, such as ``wheels``,
write only their tables.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402
from sideslip import stanford, two_track  # noqa: E402
from sideslip.drives import CAR as PARAMETERS  # noqa: E402

from crosstrack.models import SideslipEstimation  # noqa: E402
from crosstrack.models.sideslip import Recording, Vehicle, estimate_speed  # noqa: E402
from crosstrack.models.sideslip.dynamics import (  # noqa: E402
    advance,
    axle_force,
    magic_force,
    measured,
    parameters,
)
from crosstrack.solvers import Request, find_backend  # noqa: E402
from crosstrack.solvers.sideslip import regression  # noqa: E402

SEEDS = 3
#: Drives with a known angle, by another seed.
TRAINING = ("lane-change", "serpentine", "step-steer", "steady-circle")
FRICTION = 0.95
LINEAR = Vehicle(**PARAMETERS, friction=FRICTION)
BRUSH = replace(LINEAR, tyre="saturating")
MAGIC = replace(LINEAR, tyre="magic-formula")
#: Loss of a tyre's stiffness per relative load, by the second derivative of the simulator's law, and geometry of the car.
LOSS = 0.44 * (2.0 * two_track.CAR.height / two_track.CAR.track) ** 2
LOADED = replace(MAGIC, load_loss=LOSS)
LAWS = {"linear": LINEAR, "brush": BRUSH, "Magic Formula": MAGIC, "and load transfer": LOADED}


def recording(found: two_track.Drive, known: bool = False) -> Recording:
    angle = np.clip(found.truth, -1.5, 1.5) if known else None
    return Recording(**found.recording(), sideslip=angle)


def problem(name: str, seed: int, vehicle: Vehicle, training: bool = False) -> SideslipEstimation:
    """Return the estimation of a scenario; training drives are of the same car on a dry road."""
    known = [recording(two_track.drive(one, seed + 100), True) for one in TRAINING]
    found = two_track.drive(name, seed)
    return SideslipEstimation(
        vehicle, recording(found), training=known if training else [], truth=found.truth
    )


def answer(model: SideslipEstimation, name: str) -> tuple[float, float]:
    """Return the mean error (degrees) and the coverage of a backend."""
    backend = find_backend(name)
    plan = backend.run(model.blinded(), Request(options=backend.checked_options({}))).point
    return model.verify(plan).objective, model.coverage(plan)


def filterpy_ukf(model: SideslipEstimation, along: np.ndarray | None = None) -> tuple[float, float]:
    """Return error and coverage of filterpy's UKF with the same vehicle and noises, and angle and yaw rate as states.

    With forward accelerations `along` (m/s²) the loads of the axles, and with them stiffness and friction, change.
    """
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    drive, usual = model.recording, parameters(model.vehicle)
    p = usual.copy()
    step: list[float] = [0.0] * 4
    points = MerweScaledSigmaPoints(2, alpha=1.0, beta=2.0, kappa=1.0)
    kalman = UnscentedKalmanFilter(
        2, 2, drive.period,
        fx=lambda x, dt: np.array(advance(x[0], x[1], dt, *step, p)[:2]),
        hx=lambda x: np.array([x[1], measured(x[0], x[1], step[0], step[2], p)[0]]),
        points=points,
    )  # fmt: skip
    kalman.x, kalman.P = model.initial.copy(), np.diag(model.initial_deviation**2)
    kalman.R = np.diag([model.yaw_rate_noise**2, model.acceleration_noise**2])
    angles, deviations = np.empty((2, len(drive)))
    for k in range(len(drive)):
        if along is not None:
            p[4:8] = usual[4:8] * load_factors(float(along[k]))
        if k:
            dt = float(drive.times[k] - drive.times[k - 1])
            step[:] = (
                *(drive.speed[k - 1], drive.speed[k] - drive.speed[k - 1]),
                *(drive.steering[k - 1], drive.steering[k] - drive.steering[k - 1]),
            )
            kalman.Q = np.diag(model.disturbance**2 * dt)
            kalman.predict(dt=dt)
        step[:] = drive.speed[k], 0.0, drive.steering[k], 0.0
        if drive.moving[k]:
            kalman.update(np.array([drive.yaw_rate[k], drive.lateral_acceleration[k]]))
        angles[k], deviations[k] = kalman.x[0], np.sqrt(kalman.P[0, 0])
    off, on = np.abs(angles - model.truth), drive.moving
    return float(np.degrees(off[on].mean())), float((off <= 2 * deviations)[on].mean())


def load_factors(along: float) -> list[float]:
    """Return the factors on both stiffnesses and both frictions of the axles at a forward acceleration (m/s²)."""
    car = two_track.CAR
    lift = along * car.height / two_track.GRAVITY
    front, rear = -lift / car.rear, lift / car.front
    x = 1.0 / car.stiffest
    # Derivative of the stiffness of the simulator's tyres with respect to the relative load, at the static load.
    slope = (1.0 - x * x) / (1.0 + x * x)
    return [1.0 + slope * front, 1.0 + slope * rear, 1.0 + front, 1.0 + rear]


def load_transfer() -> None:
    """Write the errors of a filter that neglects the longitudinal load transfer, and of one that knows it exactly."""
    rows = []
    for name in two_track.SCENARIOS:
        errors = []
        for seed in range(SEEDS):
            along = two_track.drive(name, seed).longitudinal_acceleration
            model = problem(name, seed, LOADED)
            errors.append([filterpy_ukf(model)[0], filterpy_ukf(model, along)[0]])
        before, after = np.mean(errors, axis=0)
        rows.append([name, float(before), float(after), float(after / before)])
    said = (
        "Mean error in degrees of a UKF of filterpy with Magic Formula tyres and lateral load transfer; the height of the centre "
        "of mass and the dependence of stiffness and friction on the load are those of the simulator."
    )
    columns = {"neglected": ".3f", "longitudinal load transfer": ".3f", "ratio": ".2f"}
    store("load-transfer", "scenario", columns, rows, said, "filterpy")


def wheels() -> None:
    """Write the errors of the speed from the wheels, and of the filter that uses it instead of the measured speed."""
    rows = []
    for name in two_track.SCENARIOS:
        cells = []
        for seed in range(SEEDS):
            drive = two_track.drive(name, seed)
            failed = drive.wheel_speeds.copy()
            failed[len(failed) // 3 :, 3] = 0.0
            speeds = [
                (rims.mean(axis=1), estimate_speed(rims, drive.steering, drive.yaw_rate))
                for rims in (drive.wheel_speeds, failed)
            ]
            off = np.abs(np.array(speeds) - drive.true["vx"]).max(axis=2)
            model = problem(name, seed, LOADED)
            other = replace(model, recording=replace(model.recording, speed=speeds[0][1]))
            angles = [answer(entry, "kalman-filter")[0] for entry in (model, other)]
            cells.append([*off.ravel(), *angles])
        rows.append([name, *np.mean(cells, axis=0).tolist()])
    said = (
        "Largest error of the speed in m/s, with four wheels and if the rear right one shows 0 after a third of the drive, and mean "
        "error of the angle of kalman-filter in degrees with Magic Formula tyres and lateral load transfer. Means over "
        f"{SEEDS} seeds of noise."
    )
    names = "mean of the wheels", "estimate_speed", "mean, one fails", "estimate_speed, one fails"
    columns = dict.fromkeys((*names, "angle, measured speed", "angle, estimate_speed"), ".3f")
    store("wheel-speeds", "scenario", columns, rows, said)


def store(
    table: str, head: str, columns: dict[str, str], rows: Iterable[Any], said: str, *more: str
) -> None:
    kept = list(rows)
    write("sideslip", table, __file__, {head: "", **columns}, kept, ("numpy", "scipy", *more), said)
    print(*map(list, kept), sep="\n", flush=True)


def scenarios() -> None:
    """Write error and coverage of all estimators in all scenarios."""
    old = regression._BETTER

    def grnn(model: SideslipEstimation, better: float) -> tuple[float, float]:
        regression._BETTER = better
        try:
            return answer(model, "kalman-grnn")
        finally:
            regression._BETTER = old

    plain = {"kalman-filter": "kalman-filter", "rts-smoother": "rts-smoother"}
    columns: dict[str, Callable[[str, int], tuple[float, float]]] = {}
    for label, name in plain.items():
        columns[f"{label}, linear"] = lambda at, seed, name=name: answer(
            problem(at, seed, LINEAR), name
        )
        columns[f"{label}, Magic Formula"] = lambda at, seed, name=name: answer(
            problem(at, seed, LOADED), name
        )
    columns["unscented-filter"] = lambda at, seed: answer(
        problem(at, seed, LINEAR), "unscented-filter"
    )
    if find_spec("filterpy") is not None:
        columns["filterpy UKF, brush"] = lambda at, seed: filterpy_ukf(problem(at, seed, BRUSH))
    columns["kalman-grnn before"] = lambda at, seed: grnn(problem(at, seed, LINEAR, True), 0.0)
    columns["kalman-grnn"] = lambda at, seed: grnn(problem(at, seed, LINEAR, True), old)
    for name in ("grnn", "linear-regression"):
        columns[name] = lambda at, seed, name=name: answer(problem(at, seed, LINEAR, True), name)
    rows = []
    for at in two_track.SCENARIOS:
        cells = []
        for measure in columns.values():
            found = np.mean([measure(at, seed) for seed in range(SEEDS)], axis=0)
            cells.append(f"{found[0]:.3f} ({100 * found[1]:.0f})")
        rows.append([at, *cells])
    said = (
        "Mean error in degrees, and in brackets the share of samples within two claimed deviations in per cent. The vehicle "
        f"is that of the simulator with {SEEDS} seeds of noise; training drives are {', '.join(TRAINING)} on a dry road."
    )
    packages = ("filterpy",) if find_spec("filterpy") is not None else ()
    store("two-track", "scenario", dict.fromkeys(columns, ""), rows, said, *packages)


def laws() -> None:
    """Write the errors of the Kalman filter with several laws on cars whose tyres depend on the load or not."""
    cars = {
        "stiffness falls with the load": two_track.CAR,
        "stiffness in proportion to the load": replace(two_track.CAR, stiffest=1e6, load_loss=0.0),
    }
    rows = []
    real = two_track.SCENARIOS
    try:
        for label, car in cars.items():
            for friction in (0.95, 1.1):
                # Both laws of the estimator keep the friction 0.95. The spin is left out: its error is that of friction.
                two_track.SCENARIOS = {
                    name: replace(
                        one,
                        car=replace(car, mass=one.car.mass, inertia=one.car.inertia),
                        friction=lambda t, one=one, by=friction / 0.95: tuple(
                            by * value for value in one.friction(t)
                        ),
                    )
                    for name, one in real.items()
                    if name != "spin"
                }
                two_track._motion.cache_clear()
                errors = np.array(
                    [
                        [answer(problem_of(name, law), "kalman-filter")[0] for law in LAWS.values()]
                        for name in two_track.SCENARIOS
                        if np.abs(two_track.drive(name).truth).max() < 1.0  # other spins
                    ]
                )
                ratios = errors[:, 1:] / errors[:, :1]
                worse = (ratios > 1.0).sum(axis=0).tolist()
                means = np.exp(np.log(ratios).mean(axis=0)).tolist()
                cells = [
                    f"{mean:.2f} ({count} of {len(errors)})"
                    for mean, count in zip(means, worse, strict=True)
                ]
                rows.append([f"{label}, friction {friction:g}", *cells])
    finally:
        two_track.SCENARIOS = real
        two_track._motion.cache_clear()
    said = (
        "Error of kalman-filter relative to linear tyres, geometric mean over scenarios without a spin, and in brackets the number of "
        "scenarios with a larger error. The laws have the stiffness at rest and the friction 0.95."
    )
    store("tyre-laws", "true tyres", dict.fromkeys(list(LAWS)[1:], ""), rows, said)


def problem_of(name: str, vehicle: Vehicle) -> SideslipEstimation:
    found = two_track.drive(name)
    return SideslipEstimation(vehicle, recording(found), truth=found.truth)


def secants() -> None:
    """Write the ratio of force and slip angle of the rear axle relative to its stiffness at rest."""
    car, stiffness = two_track.CAR, PARAMETERS["cornering_rear"]
    load = 2.0 * car.static_loads()[1]
    most = FRICTION * load
    rows = []
    for side in (1.0, 2.0, 4.0, 6.0):
        force = load * side / two_track.GRAVITY
        shift = (1.0 - car.roll_share) * car.mass * side * car.height / car.track
        left = 1.0 - LOSS * (side / two_track.GRAVITY) ** 2

        def pair(slip: float, shift: float = shift) -> float:
            return sum(
                two_track.magic_formula(slip, load / 2 + sign * shift, FRICTION, car, 1, load / 2)
                for sign in (-1, 1)
            )

        def ratio(law: Callable[[float], float], force: float = force) -> float:
            return float(force / brentq(lambda slip: law(slip) - force, 1e-9, 0.25) / stiffness)

        rows.append(
            [
                side,
                ratio(pair),
                ratio(lambda slip: axle_force(slip, stiffness, most)[0]),
                ratio(lambda slip: magic_force(slip, stiffness, most, 1.35, -0.5)[0]),
                ratio(lambda slip, c=left: magic_force(slip, c * stiffness, c * most, 1.35, -0.5)[0]),
            ]
        )  # fmt: skip
    said = "Ratio of force and slip angle of the rear axle, relative to its stiffness at rest; linear tyres have 1."
    names = ("two tyres of the simulator", "brush", "Magic Formula", "and load transfer")
    columns = {"a_y in m/s²": ".0f", **dict.fromkeys(names, ".3f")}
    write("sideslip", "secants", __file__, columns, rows, ("numpy", "scipy"), said)
    print(*rows, sep="\n", flush=True)


def race_track() -> None:
    """Write error and coverage on the recorded drive: cross-validation in its first 60 %, and the test on the rest."""
    drive = stanford.whole()
    end = int(stanford.SHARE * len(drive))
    known, rest = stanford.cut(drive, 0, end), stanford.cut(drive, end, len(drive))
    names = ("kalman-filter", "rts-smoother", "linear-regression", "grnn", "kalman-grnn")
    cases: dict[str, list[SideslipEstimation]] = {}
    for label, vehicle in (
        ("rough guess", stanford.GUESS),
        ("car of the catalogue", stanford.OTHER),
    ):
        folds = stanford.folds(known, 6)
        cases[f"cross-validation, {label}"] = [stanford.model(*fold, vehicle) for fold in folds]
        cases[f"test, {label}"] = [stanford.model(rest, [known], vehicle)]
    old = regression._BETTER
    rows = []
    for label, models in cases.items():
        cells = []
        for name, better in (*((name, old) for name in names), ("kalman-grnn", 0.0)):
            regression._BETTER = better
            found = np.mean([answer(model, name) for model in models], axis=0)
            cells.append(f"{found[0]:.3f} ({100 * found[1]:.0f})")
        regression._BETTER = old
        rows.append([label, *cells])
    said = (
        "Mean error in degrees, and in brackets the share within two claimed deviations in per cent. Cross-validation has six "
        "parts of the first 60 % of the file; the test is the rest of it."
    )
    columns = dict.fromkeys((*names, "kalman-grnn without tyre curve"), "")
    store("race-track", "drive and assumed vehicle", columns, rows, said)


if __name__ == "__main__":
    parts = secants, laws, race_track, scenarios, wheels, load_transfer
    if not stanford.FILE.exists():
        parts = tuple(part for part in parts if part is not race_track)
    if find_spec("filterpy") is None:
        parts = tuple(part for part in parts if part is not load_transfer)
    for part in parts:
        if not sys.argv[1:] or part.__name__ in sys.argv[1:]:
            part()
