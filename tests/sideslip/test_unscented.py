"""The unscented filter: equal to textbook filters, consistent, and right in spins."""

import dataclasses
import math
from functools import cache

import numpy as np
import pytest
from pictures import artists, legend, panels
from sideslip import two_track
from sideslip.drives import estimate, kinematic
from sideslip.filters import GRIPPING, VEHICLE, drawn
from sideslip.spins import driven, marked, steered

import crosstrack as ct
from crosstrack import jit
from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import generate
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, SideslipEstimate, Vehicle
from crosstrack.models.sideslip.checks import linear_contradiction
from crosstrack.models.sideslip.dynamics import measured
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.contract.selection import recommended
from crosstrack.solvers.sideslip import unscented, unscented_kernels as kernels
from crosstrack.solvers.sideslip.passes import measurements, noise_variances
from crosstrack.solvers.sideslip.unscented import setting_of

SIZE = kernels.SIZE
#: The spin of the problem's page: true friction 0.35, assumed 0.95.
SPIN = {
    "road": "serpentine", "speed": 18.0, "samples": 268, "tyre": "saturating", "friction": 0.35,
    "training_friction": 0.95, "mismatch": {"friction": 0.95 / 0.35},
}  # fmt: skip


def run(model, name="unscented-filter"):
    return find_backend(name).run(model.blinded(), Request())


def path(model, setting=None, kernel=kernels.unscented_path):
    """Return states, roots and innovations of the filter."""
    drive, n = model.recording, len(model.recording)
    states, roots, innovations = np.empty((n, SIZE)), np.empty((n, SIZE, SIZE)), np.empty((n, 2))
    data = np.where(drive.moving[:, None], measurements(drive), np.nan)
    lost = kernel(
        drive.times, drive.speed, drive.steering, data, *(setting or setting_of(model)), 1e4,
        states, roots, innovations, np.empty(n, bool), np.zeros(1, np.int8),
    )  # fmt: skip
    return states, roots, innovations, lost


@cache
def spin(drivers=0):
    return generate(**SPIN, drivers=drivers)


@cache
def held_out():
    """Return spins on which no constant was chosen."""
    return [*driven(301, 3), *steered(302, 3), *steered(303, 2, wrong=True)]


# -- the same filter elsewhere -------------------------------------------------------------------


def transition(x, dt, u, du, delta, ddelta, setting):
    """Return a state after `dt`; the kernels' vehicle, and the drift written out."""
    p, loads, _, drift, _ = setting
    own, result = np.empty(len(p)), np.array(x, float)
    kernels.adapt.py_func(p, loads, result, own)
    kernels.move.py_func(result, dt, u, du, delta, ddelta, own)
    result[2:] = drift[:, 0] + np.exp(-dt / drift[:, 2]) * (result[2:] - drift[:, 0])
    return result


def sensors(x, u, delta, setting):
    own = np.empty(len(setting[0]))
    kernels.adapt.py_func(setting[0], setting[1], np.array(x, float), own)
    return np.array([x[1] + x[4], measured.py_func(x[0], x[1], u, delta, own)[0] + x[5]])


def process_noise(dt, setting):
    _, _, noise, drift, _ = setting
    return np.diag([*(noise[:2] * dt), *(drift[:, 1] ** 2 * (1 - np.exp(-2 * dt / drift[:, 2])))])


def test_states_and_covariances_equal_a_textbook_filter():
    model = spin()
    setting, drive = setting_of(model), model.recording
    states, roots, innovations, _ = path(model)
    x, spread = setting[4][:, 0], np.diag(setting[4][:, 1] ** 2)
    for k in range(len(drive)):
        if k:
            points = x + np.sqrt(SIZE) * np.vstack(
                [np.linalg.cholesky(spread).T, -np.linalg.cholesky(spread).T]
            )
            dt = drive.times[k] - drive.times[k - 1]
            du, dd = np.diff(drive.speed)[k - 1], np.diff(drive.steering)[k - 1]
            points = np.array(
                [
                    transition(y, dt, drive.speed[k - 1], du, drive.steering[k - 1], dd, setting)
                    for y in points
                ]
            )
            x = points.mean(axis=0)
            spread = (points - x).T @ (points - x) / (2 * SIZE) + process_noise(dt, setting)
        points = x + np.sqrt(SIZE) * np.vstack(
            [np.linalg.cholesky(spread).T, -np.linalg.cholesky(spread).T]
        )
        seen = np.array([sensors(y, drive.speed[k], drive.steering[k], setting) for y in points])
        mean = seen.mean(axis=0)
        s = (seen - mean).T @ (seen - mean) / (2 * SIZE) + np.diag(setting[2][2:])
        gain = (points - x).T @ (seen - mean) / (2 * SIZE) @ np.linalg.inv(s)
        error = measurements(drive)[k] - mean
        x, spread = x + gain @ error, spread - gain @ s @ gain.T
        assert innovations[k] == pytest.approx([error @ np.linalg.solve(s, error), 2], rel=1e-6)
        assert states[k] == pytest.approx(x, rel=1e-8, abs=1e-9)
        assert roots[k] @ roots[k].T == pytest.approx(spread, rel=1e-6, abs=1e-10)
        assert (roots[k] == np.tril(roots[k])).all() and (np.diag(roots[k]) > 0).all()


def test_angles_equal_those_of_filterpy():
    kalman = pytest.importorskip("filterpy.kalman", reason="FilterPy is not installed")
    model = next(steered(304, 1)).model
    setting, drive = setting_of(model), model.recording
    points = kalman.MerweScaledSigmaPoints(SIZE, alpha=1.0, beta=0.0, kappa=0.0)
    other = kalman.UnscentedKalmanFilter(
        SIZE, 2, 1.0, lambda x, u, delta: sensors(x, u, delta, setting),
        lambda x, dt, *more: transition(x, dt, *more, setting), points,
    )  # fmt: skip
    other.x, other.P = setting[4][:, 0].copy(), np.diag(setting[4][:, 1] ** 2)
    other.R = np.diag(setting[2][2:])
    angles = []
    for k in range(len(drive)):
        if k:
            i, dt = k - 1, drive.times[k] - drive.times[k - 1]
            other.Q = process_noise(dt, setting)
            other.predict(
                dt, u=drive.speed[i], du=drive.speed[k] - drive.speed[i], delta=drive.steering[i],
                ddelta=drive.steering[k] - drive.steering[i],
                fx=lambda x, dt, u, du, delta, ddelta: transition(x, dt, u, du, delta, ddelta, setting),
            )  # fmt: skip
        else:
            other.sigmas_f = points.sigma_points(other.x, other.P)
        other.update(measurements(drive)[k], u=drive.speed[k], delta=drive.steering[k])
        angles.append(other.x[0])
    difference = np.abs(run(model).point.sideslip - angles).max()
    assert difference < 1e-6, difference


def test_the_compiled_filter_equals_the_interpreted_one(monkeypatch):
    model = spin()
    compiled = path(model)
    monkeypatch.setattr(kernels, "unscented_step", kernels.unscented_step.py_func)
    for one, other in zip(
        compiled, path(model, kernel=kernels.unscented_path.py_func), strict=True
    ):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12)


# -- consistency ---------------------------------------------------------------------------------


def consistency(shrink, factor):
    """Return NEES of all states at some samples, and the share of angles within two deviations.

    The drives follow the filter's own model, with the initial state drawn from the prior, whose deviations are those of
    the backend times `shrink`. The filter assumes `factor` times the true noise.
    """
    base = SideslipEstimation(
        dataclasses.replace(GRIPPING, friction=0.6), kinematic(n=161).recording
    )
    setting = list(setting_of(base))
    setting[2], setting[3] = noise_variances(base), setting[3].copy()
    setting[3][:, 1] *= shrink
    setting[4] = setting[4] * [1.0, shrink]
    assumed = [*setting[:2], factor**2 * setting[2], *setting[3:]]
    rng = np.random.default_rng(8)
    period, n, found, covered = 0.05, 161, [], []
    for drive in range(40):
        times, speed = period * np.arange(n), np.full(n, 15.0 + 0.3 * drive)
        delta = rng.uniform(0.02, 0.08) * np.sin(rng.uniform(1, 4) * times)
        x = rng.normal(setting[4][:, 0], setting[4][:, 1])
        true, data = np.empty((n, SIZE)), np.empty((n, 2))
        for k in range(n):
            if k:
                change = delta[k] - delta[k - 1]
                x = transition(x, period, speed[k], 0.0, delta[k - 1], change, setting)
                x = x + rng.normal(size=SIZE) * np.sqrt(np.diag(process_noise(period, setting)))
            true[k], data[k] = x, sensors(x, speed[k], delta[k], setting)
        data += rng.normal(size=(n, 2)) * np.sqrt(setting[2][2:])
        recording = Recording(times, speed, delta, *data.T)
        states, roots, _, lost = path(dataclasses.replace(base, recording=recording), assumed)
        assert lost == 0
        errors = [np.linalg.solve(roots[k], states[k] - true[k]) for k in (20, 60, 100, 160)]
        found.append([error @ error for error in errors])
        size = np.sqrt(np.einsum("ij,ij->i", roots[:, 0], roots[:, 0]))
        covered.append(np.abs(states[:, 0] - true[:, 0]) <= 2 * size)
    return np.mean(found, axis=0), np.mean(covered)


def test_errors_of_all_states_agree_with_the_covariance():
    # The mean of 40 values of χ² with 8 degrees of freedom is 8 with the deviation √(16 / 40) = 0.63.
    squares, share = consistency(shrink=0.15, factor=1.0)
    assert np.abs(squares - 8).max() < 3 * math.sqrt(16 / 40)
    assert 0.93 <= share <= 0.97


def test_errors_from_the_prior_of_the_backend_are_within_the_claim():
    # The tyres are not linear over such a prior: the doubled noise keeps the claim large enough.
    squares, share = consistency(shrink=1.0, factor=unscented._NOISES)
    assert squares.max() < 8 and squares.min() > 3
    assert share >= 0.95


def test_a_missing_measurement_is_not_used():
    model = kinematic(noise=(0.002, 0.05))
    setting = setting_of(model)
    x, root = setting[4][:, 0], np.diag(setting[4][:, 1])
    common = (0.0, 20.0, 0.0, 0.01, 0.0)
    out = np.empty((3, SIZE)), np.empty((3, SIZE, SIZE))

    def step(k, z, noise):
        rest = (*setting[:2], noise, setting[3], np.zeros(2), out[0][k], out[1][k])
        return kernels.unscented_step(x, root, np.array(z), *common, *rest)

    vague = setting[2] * [1, 1, 1, 1e20]
    square, used = step(0, [0.03, np.nan], setting[2])
    assert used == 1 and step(1, [0.03, 5.0], vague)[0] == pytest.approx(square, rel=1e-6)
    assert out[0][0] == pytest.approx(out[0][1], abs=1e-9)
    assert out[1][0] == pytest.approx(out[1][1], abs=1e-9)
    assert step(2, [np.nan, np.nan], setting[2]) == (0.0, 0.0)
    assert out[0][2] == pytest.approx(x) and out[1][2] == pytest.approx(root, abs=1e-12)


# -- spins -----------------------------------------------------------------------------------------


def test_the_spin_of_the_page_is_followed_where_the_filter_on_the_vehicle_is_lost():
    model = spin()
    plan = run(model).point
    assert model.verify(plan).objective < 0.3 and model.coverage(plan) >= 0.95
    assert model.verify(run(model, "kalman-filter").point).objective > 10


def test_held_out_spins_are_followed_within_the_claim():
    plans = [(entry.model, run(entry.model).point) for entry in held_out()]
    errors = [model.verify(plan).objective for model, plan in plans]
    shares = [model.coverage(plan) for model, plan in plans]
    assert max(errors) < 3 and np.mean(errors) < 1
    assert np.mean(shares) >= 0.95 and min(shares) >= 0.9


def test_a_spin_of_a_vehicle_with_four_wheels_is_followed():
    drive, car = two_track.drive("spin"), two_track.CAR
    sizes = car.mass, car.inertia, car.front, car.rear, *(2 * part for part in car.stiffness)
    for tyre in ("linear", "saturating"):
        vehicle = Vehicle(*sizes, friction=0.95, tyre=tyre)
        model = SideslipEstimation(vehicle, Recording(**drive.recording()), truth=drive.truth)
        answer = run(model)
        assert model.verify(answer.point).objective < 3 and model.coverage(answer.point) >= 0.9
        assert answer.point.grip_lost


# -- grip lost -------------------------------------------------------------------------------------


def test_the_time_at_which_grip_is_lost_is_found():
    for entry in held_out()[:6]:
        times, spans = entry.model.recording.times, run(entry.model).point.grip_lost
        shown, slides = marked(times, spans), entry.sliding
        assert shown[slides].mean() > 0.95
        # Samples at which the tyres are far from their peak are not marked.
        assert (shown & ~entry.slides(0.5)).sum() <= 0.02 * shown.sum()
        first = times[slides.argmax()]
        assert times[entry.slides(0.5).argmax()] - 0.1 <= spans[0][0] <= first + 0.15


@pytest.mark.parametrize("instance", ["lane-change", "serpentine", "limit", "stop-and-go", "ice"])
def test_grip_is_not_lost_on_a_calm_drive(instance):
    assert run(ct.load(f"sideslip/{instance}")).point.grip_lost == ()


SPIKES = {"lateral_acceleration": (5.0, 20.0, -50.0, 100.0), "yaw_rate": (0.3, -1.0, 3.0, 20.0)}


def spiked(model, field, size, first, count=1):
    """Return the model with `size` added to `count` samples of a measurement."""
    values = getattr(model.recording, field).copy()
    values[first : first + count] += size
    return dataclasses.replace(
        model, recording=dataclasses.replace(model.recording, **{field: values})
    )


@pytest.mark.parametrize(
    "instance",
    ["lane-change", "limit", "ice", *(pytest.param(one, marks=pytest.mark.slow) for one in ("serpentine", "stop-and-go"))],
)  # fmt: skip
def test_a_spike_is_treated_as_missing(instance):
    model = ct.load(f"sideslip/{instance}")
    moving = np.flatnonzero(model.recording.moving)
    for field, sizes in SPIKES.items():
        for k in moving[np.linspace(1, len(moving) - 1, 4).astype(int)]:
            for size in sizes:
                wrong = spiked(model, field, size, k)
                answer = run(wrong)
                assert answer.point.grip_lost == ()
                off = np.abs(answer.point.sideslip - model.truth)[model.recording.moving]
                assert np.degrees(off.max()) < 1.0, (field, k, size)
                if abs(size) >= (20.0 if field == "lateral_acceleration" else 1.0):
                    assert answer.statistics["spikes"] == 1
                    assert f"measurements at {model.recording.times[k]:.6g} s" in answer.message


def test_a_jump_is_followed_after_two_samples():
    model = ct.load("sideslip/lane-change")
    used = path(spiked(model, "yaw_rate", 1.0, 100, count=200))[2][:, 1]
    assert used[98:104].tolist() == [2, 2, 1, 1, 2, 2]


def test_grip_lost_is_part_of_the_plan():
    plan = run(spin()).point
    data = plan.to_data()
    assert data["grip_lost"] == [list(span) for span in plan.grip_lost]
    assert SideslipEstimate.from_data(data) == plan
    begin, end = plan.grip_lost[-1]
    assert "grip lost at" in str(plan) and f"{begin:.6g}-{end:.6g} s" in str(plan)
    old = {key: data[key] for key in ("sideslip", "deviation")}
    assert SideslipEstimate.from_data(old).grip_lost == ()
    assert estimate(np.zeros(12)).to_data().keys() == old.keys()


@pytest.mark.parametrize(
    "spans", [[(2.0, 1.0)], [(0.0, 3.0), (2.0, 4.0)], [(1.0, math.nan)], [(1.0,)], "x"]
)
def test_wrong_time_ranges_are_refused(spans):
    with pytest.raises(InvalidData, match="grip_lost"):
        SideslipEstimate(np.zeros(3), np.zeros(3), spans)


def test_grip_lost_is_drawn():
    model = spin()
    plan = run(model).point
    figure = ct.plot(model, plan)
    for name in ("sideslip angle", "error"):
        assert len(artists(panels(figure)[name], "grip lost")) == len(plan.grip_lost)
    assert "grip lost" in legend(figure)
    calm = ct.plot(model, dataclasses.replace(plan, grip_lost=()))
    assert "grip lost" not in legend(calm)


# -- the recommended estimator -----------------------------------------------------------------------


def test_auto_chooses_the_filter_only_if_the_tyres_leave_their_linear_range():
    assert recommended(spin()).name == "unscented-filter"
    assert recommended(spin(drivers=3)).name == "unscented-filter"
    assert recommended(generate(drivers=0)).name == "rts-smoother"
    assert recommended(generate(drivers=3)).name == "smoother-grnn"
    # Training drives show the same error of the vehicle: they are learned.
    wrong = {
        "road": "serpentine",
        "mismatch": {"mass": 1.3, "cornering_front": 0.7, "cornering_rear": 0.7},
    }
    assert recommended(generate(**wrong, drivers=0)).name == "unscented-filter"
    assert recommended(generate(**wrong, drivers=3)).name == "smoother-grnn"
    # A bias that the training drives lack, and one that they have.
    assert recommended(generate(bias=(0.01, 0.0), drivers=0)).name == "unscented-filter"
    assert recommended(generate(bias=(0.01, 0.0), drivers=3)).name == "unscented-filter"
    biased = generate(bias=(0.01, 0.0), drivers=3)
    known = [
        dataclasses.replace(drive, yaw_rate=drive.yaw_rate + 0.01) for drive in biased.training
    ]
    assert recommended(dataclasses.replace(biased, training=known)).name == "smoother-grnn"


def test_a_part_of_a_training_drive_is_learned_although_its_mean_error_is_larger():
    model = generate("serpentine", drivers=1)
    (drive,) = model.training
    count, times = len(drive) // 2, drive.times
    wave = 0.01 * np.sin(2.0 * math.pi * times / times[-1])  # 0 on average of the whole drive
    wrong = dataclasses.replace(drive, yaw_rate=drive.yaw_rate + wave)
    names = ("times", "speed", "steering", "yaw_rate", "lateral_acceleration")
    part = type(drive)(**{name: getattr(wrong, name)[:count] for name in names})
    model = dataclasses.replace(model, recording=part, truth=None)
    assert recommended(model).name == "unscented-filter"
    assert recommended(dataclasses.replace(model, training=(wrong,))).name == "smoother-grnn"


def test_the_contradiction_is_that_of_linear_tyres():
    calm, slow = kinematic(), kinematic(speed=4.0)
    assert linear_contradiction(slow.vehicle, slow.recording) == (0.0, 0.0)
    drive, car = calm.recording, calm.vehicle
    slip = (
        car.cornering_front * drive.steering
        + (car.rear * car.cornering_rear - car.front * car.cornering_front) * drive.yaw_rate / 20.0
        - car.mass * drive.lateral_acceleration
    ) / (car.cornering_front + car.cornering_rear)
    largest = max(
        abs(slip[k + 20] - slip[k] - calm.truth[k + 20] + calm.truth[k])
        for k in range(len(slip) - 20)
    )
    # The kinematics of the drive is exact up to the trapezoidal rule.
    assert linear_contradiction(car, drive)[0] == pytest.approx(math.degrees(largest), rel=1e-3)
    turned = dataclasses.replace(drive, yaw_rate=drive.yaw_rate + 0.01)
    assert (
        linear_contradiction(car, turned)[1]
        > math.degrees(0.01) / 2
        > linear_contradiction(car, drive)[1]
    )


# -- wild drives -------------------------------------------------------------------------------------


def wild():
    """Return recordings with dead sensors, jumps, rest, few samples and extreme periods."""
    calm = kinematic(n=60).recording
    zero, late = np.zeros(60), np.arange(60) >= 30
    return {
        "yaw rate dead": dataclasses.replace(calm, yaw_rate=zero),
        "acceleration dead": dataclasses.replace(calm, lateral_acceleration=zero),
        "steering dead": dataclasses.replace(calm, steering=zero),
        "jump": dataclasses.replace(calm, yaw_rate=calm.yaw_rate + 50.0 * late),
        "largest jump": dataclasses.replace(calm, lateral_acceleration=np.where(late, 1e3, -1e3)),
        "stops": dataclasses.replace(calm, speed=np.where(late, 0.0, 20.0)),
        "starts": dataclasses.replace(calm, speed=np.where(late, 20.0, 0.0)),
        "ten samples": kinematic(n=10).recording,
        "1 kHz": kinematic(n=60, period=1e-3).recording,
        "0.5 Hz": kinematic(n=60, period=2.0).recording,
        "fastest": dataclasses.replace(calm, speed=np.full(60, 1e3)),
        "full lock": dataclasses.replace(calm, steering=np.where(late, 1.57, -1.57)),
    }


@pytest.mark.parametrize("name", wild())
@pytest.mark.parametrize("tyre", ["linear", "saturating", "magic-formula"])
def test_wild_drives_have_a_finite_estimate_and_a_valid_covariance(name, tyre):
    model = SideslipEstimation(dataclasses.replace(VEHICLE, tyre=tyre), wild()[name])
    plan = run(model).point
    assert np.isfinite(plan.sideslip).all() and np.isfinite(plan.deviation).all()
    assert (np.abs(plan.sideslip) <= np.pi / 2).all() and (plan.deviation >= 0).all()
    assert model.verify(plan).ok
    states, roots, _, _ = path(model)
    assert np.isfinite(states).all() and np.isfinite(roots).all()
    assert (np.diagonal(roots, axis1=1, axis2=2) >= 0).all()
    for begin, end in plan.grip_lost:
        assert model.recording.times[0] <= begin <= end <= model.recording.times[-1]


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("field", ["mass", "yaw_inertia", "front", "cornering_rear", "friction"])
def test_wild_vehicles_have_a_finite_estimate(field, factor):
    car = dataclasses.replace(GRIPPING, **{field: factor * getattr(GRIPPING, field)})
    plan = run(drawn(3, car)).point
    assert np.isfinite(plan.sideslip).all() and np.isfinite(plan.deviation).all()


def test_equal_runs_are_equal_and_a_stopped_run_has_no_plan():
    first, second = (run(spin()).point for _ in range(2))
    assert first == second
    request = Request()
    request.control.flag[0] = 1
    assert unscented.UnscentedFilter().estimate(spin(), request) is None


@pytest.mark.parametrize("by_exception", [False, True])
def test_a_run_with_a_limit_that_is_stopped_has_the_angles_of_the_kalman_filter(
    monkeypatch, by_exception
):
    """Interpreted, a drive of 17 s takes 1.1 s of CPU, and had no estimate at a limit of 2 s on a busy machine."""

    def stopped(*arguments):
        if by_exception:
            raise jit.OutOfTime
        return -1

    monkeypatch.setattr(unscented, "unscented_path", stopped)
    problem = spin()
    assert unscented.UnscentedFilter().estimate(problem, Request()) is None
    answer = unscented.UnscentedFilter().run(problem, Request(time_limit=5.0))
    expected = find_backend("kalman-filter", problem).run(problem, Request()).point
    assert answer.termination == "feasible" and answer.point == expected
    assert "the angles are those of kalman-filter" in answer.message
    assert problem.verify(answer.point).ok
