"""Estimation by quadratic programs, full and moving horizon, compared with filter and smoother."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings, strategies as st
from sideslip.drives import CAR, kinematic

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models.sideslip import Recording, Vehicle
from crosstrack.models.sideslip.dynamics import advance, measured, parameters
from crosstrack.models.sideslip.full_information import misfit
from crosstrack.solvers import find_backend
from crosstrack.solvers.contract.backend import Answer, Limit, Request, Termination
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.sideslip.moving_horizon import _root

#: All backends of quadratic programs.
EVERY = (
    *("clarabel", "highs", "piqp", "proxqp", "daqp", "quadprog", "osqp", "scs", "qpsolvers"),
    *("casadi", "cvxpy"),
)
SLIDING = Vehicle(**CAR, friction=0.5, tyre="saturating")


def ran(name, model, **options):
    """Return the answer of a backend in this process."""
    backend = find_backend(name, model)
    request = Request(tolerance=1e-9, options=backend.checked_options(options))
    return backend.run(model.blinded(), request)


def wild(seed=0, n=40, vehicle=None):
    """Return a drive with varying speed, steering and time steps, and samples at rest."""
    draw = np.random.default_rng(seed)
    times = np.cumsum(draw.choice([0.01, 0.05, 0.1, 0.9], n))
    speed = np.clip(np.cumsum(draw.normal(0, 4, n)) + 15, 0, 60)
    drive = Recording(
        times, speed, draw.normal(0, 0.05, n), draw.normal(0, 0.3, n), draw.normal(0, 4, n)
    )
    model = kinematic(n, vehicle=vehicle or Vehicle(**CAR))
    return replace(model, recording=drive, truth=None)


@pytest.mark.parametrize("model", [kinematic(25, noise=(0.002, 0.05)), wild(5, 25)], ids=str)
@pytest.mark.parametrize("horizon", [1, 6, 1000])
def test_a_horizon_gives_the_kalman_filter(model, horizon):
    found = ran("moving-horizon", model, horizon=horizon)
    filtered = ran("kalman-filter", model)
    assert found.termination is Termination.FEASIBLE
    assert found.statistics["programs"] == len(model.recording)
    assert not found.statistics["programs without a solution"]
    np.testing.assert_allclose(found.point.sideslip, filtered.point.sideslip, atol=1e-8)
    np.testing.assert_allclose(found.point.deviation, filtered.point.deviation, atol=1e-12)


@pytest.mark.parametrize("model", [kinematic(80, noise=(0.002, 0.05)), wild(1), wild(7)], ids=str)
def test_full_information_gives_smoother_and_filter(model):
    whole = ran("moving-horizon", model, horizon=0)
    smoothed, filtered = ran("rts-smoother", model), ran("kalman-filter", model)
    assert whole.statistics["programs"] == 1
    np.testing.assert_allclose(whole.point.sideslip, smoothed.point.sideslip, atol=1e-8)
    np.testing.assert_allclose(whole.point.deviation, smoothed.point.deviation, atol=1e-8)
    assert whole.point.sideslip[-1] == pytest.approx(filtered.point.sideslip[-1], abs=1e-8)


@given(st.integers(0, 10**6), *[st.floats(-3, 3)] * 4)
@settings(max_examples=10, deadline=None)
def test_whatever_the_noises(seed, one, two, yaw, lateral):
    # The ratio of any two noises differs from the usual one by a factor of up to a million.
    noises = {"yaw_rate_noise": 2e-3 * 10.0**yaw, "acceleration_noise": 0.05 * 10.0**lateral}
    disturbance = [2e-3 * 10.0**one, 1e-2 * 10.0**two]
    model = replace(wild(seed, 10), disturbance=disturbance, **noises)
    whole, smoothed = ran("moving-horizon", model, horizon=0), ran("rts-smoother", model)
    # Angles beyond ±90° are clipped.
    apart = np.abs(whole.point.sideslip - smoothed.point.sideslip)
    assert np.isfinite(whole.point.deviation).all()
    # If a program cannot be solved to 1e-9, the filter's angle is used.
    if not whole.statistics["programs without a solution"]:
        assert apart.max() <= 1e-6 * (1 + np.abs(smoothed.point.sideslip).max())


@pytest.mark.parametrize("name", EVERY)
def test_every_solver_of_quadratic_programs_agrees(name):
    if find_backend(name).missing():
        pytest.skip(f"{name} is not installed")
    model = wild(3, 25)
    smoothed = ran("rts-smoother", model).point
    # quadprog needs a positive definite Hessian, as in the condensed form.
    forms = ["condensed"] if name == "quadprog" else ["full-information", "condensed"]
    for form in forms:
        solution = ct.solve(model, name, formulation=form, tolerance=1e-8, time_limit=60)
        assert solution.termination == "feasible", solution.message
        assert solution.dual_bound is None  # the optimum gives no bound on the objective
        np.testing.assert_allclose(solution.plan.sideslip, smoothed.sideslip, atol=1e-8)
        rows = ct.verify(model, solution, formulation=form)
        assert rows.ok


def test_estimators_are_compared_by_their_distance():
    model = kinematic(60, noise=(0.002, 0.05))
    names = ["rts-smoother", "clarabel", "moving-horizon"]
    options = {"moving-horizon": {"horizon": 0}}
    answers = [ct.solve(model, name, backend_options=options.get(name, {})) for name in names]
    verdict = judge("circle", answers, model)
    assert verdict.outcome == "AGREED"
    assert "agreement, not optimality" in verdict.evidence
    plans = [solution.plan for solution in verdict.solutions]
    assert max(model.distance(plans[0], other) for other in plans[1:]) < 1e-6


def errors(model, states):
    """Return the relative errors of states for saturating tyres, with the nonlinear model."""
    drive, p = model.recording, parameters(model.vehicle)
    found = [(states[0] - model.initial) / model.initial_deviation]
    for k, (beta, omega) in enumerate(states):
        value, _, _ = measured(beta, omega, drive.speed[k], drive.steering[k], p)
        if drive.speed[k] >= 1.0:
            found.append(
                [
                    (drive.yaw_rate[k] - omega) / model.yaw_rate_noise,
                    (drive.lateral_acceleration[k] - value) / model.acceleration_noise,
                ]
            )
        if k + 1 < len(states):
            dt = drive.times[k + 1] - drive.times[k]
            ahead = advance(
                beta, omega, dt, drive.speed[k], drive.speed[k + 1] - drive.speed[k],
                drive.steering[k], drive.steering[k + 1] - drive.steering[k], p,
            )  # fmt: skip
            found.append((states[k + 1] - ahead[:2]) / (model.disturbance * np.sqrt(dt)))
    return np.concatenate(found)


def test_tyres_that_saturate_against_nonlinear_least_squares():
    """Lateral accelerations are near the limit of 4.9 m/s², so the forces are strongly nonlinear."""
    model = kinematic(20, speed=22.0, noise=(0.002, 0.05), vehicle=SLIDING)
    drive = model.recording
    assert np.abs(drive.lateral_acceleration).max() > 3.5
    found = ran("moving-horizon", model, horizon=0)
    assert not found.statistics["horizons not settled"]
    start = np.stack([found.point.sideslip, drive.yaw_rate], axis=1).ravel()
    best = scipy.optimize.least_squares(
        lambda x: errors(model, x.reshape(-1, 2)), start, xtol=1e-12, ftol=1e-12
    )
    angles = best.x.reshape(-1, 2)[:, 0]
    assert np.abs(found.point.sideslip - angles).max() < 2e-3 * np.abs(angles).max()
    # A filter with a single linearisation is farther away.
    filtered = ran("rts-smoother", model).point.sideslip
    assert np.abs(found.point.sideslip - angles).max() <= np.abs(filtered - angles).max()


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_tyres_that_saturate_on_wild_drives(seed):
    model = wild(seed, 15, SLIDING)
    found = ran("moving-horizon", model, horizon=5)
    assert np.isfinite(found.point.sideslip).all()
    assert (found.point.deviation >= 0).all()
    assert model.verify(found.point).ok


def test_what_is_not_settled_is_said():
    model = kinematic(30, speed=24.0, vehicle=SLIDING)
    found = ran("moving-horizon", model, horizon=0, rounds=1)
    assert found.statistics["horizons not settled"] == 1
    assert "changed still" in found.message


def test_covariances_that_rounding_made_singular():
    good = np.array([[4.0, 2.0], [2.0, 5.0]])
    np.testing.assert_allclose(_root(good, np.array([1e-3, 1e-3])), np.linalg.cholesky(good))
    for bad in (
        [[1e4, 1e4], [1e4, 1e4 - 1e-8]],
        [[0.0, 0.0], [0.0, 1.0]],
        [[-1e-20, 0], [0, -1e-20]],
    ):
        root = _root(np.array(bad), np.array([1e-9, 1e-6]))
        assert (np.diag(root) >= [1e-9, 1e-6]).all()
        np.testing.assert_allclose(root @ root.T, bad, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("horizon", [0, 3])
def test_a_program_without_a_solution_leaves_the_filter(horizon, monkeypatch):
    solver = type(find_backend("clarabel"))
    monkeypatch.setattr(solver, "run", lambda *given: Answer(Termination.FAILED))
    model = kinematic(12)
    found, filtered = ran("moving-horizon", model, horizon=horizon), ran("kalman-filter", model)
    count = found.statistics["programs"]
    assert count == (12 if horizon else 1)
    assert f"{count} of {count} programs had no solution" in found.message
    np.testing.assert_array_equal(found.point.sideslip, filtered.point.sideslip)


def test_a_run_that_is_stopped_keeps_the_filter():
    model = kinematic(200)
    backend = find_backend("moving-horizon", model)
    request = Request(options=backend.checked_options({}))

    count = 0
    inner = request.within

    def within(*arguments, **options):
        nonlocal count
        count += 1
        if count == 5:
            request.control.stop(Limit.TIME)
        return inner(*arguments, **options)

    object.__setattr__(request, "within", within)
    found = backend.run(model.blinded(), request)
    assert count == 5
    assert found.limit is Limit.TIME
    assert "Kalman filter's" in found.message
    filtered = ran("kalman-filter", model).point
    np.testing.assert_allclose(found.point.sideslip, filtered.sideslip, atol=1e-8)


def test_options_that_are_refused():
    model = kinematic(20)
    with pytest.raises(
        UnsupportedOption, match=r"must name a backend of quadratic programs.*'ipopt'"
    ):
        ran("moving-horizon", model, solver="ipopt")
    with pytest.raises(ct.errors.UnknownName, match="nobody"):
        ran("moving-horizon", model, solver="nobody")
    with pytest.raises(UnsupportedOption, match="horizon"):
        ran("moving-horizon", model, horizon=-1)
    for form in ("full-information", "condensed"):
        with pytest.raises(
            UnsupportedFormulation, match="moving-horizon takes tyres that saturate"
        ):
            kinematic(20, vehicle=SLIDING).formulate(form)


def test_rows_say_which_sample():
    program = wild(2, 25).formulate().program
    moving = int(wild(2, 25).recording.moving.sum())
    sizes = {block.name: block.size for block in program.rows}
    assert sizes == {"first state": 2, "step": 48, "measurement": 2 * moving}
    assert program.row_name(2) == "step sample 0, component 0"


def test_errors_of_an_encoded_plan_satisfy_every_row():
    """Measurements with a wrong sign would double the misfit, and with it the deviations."""
    model = wild(3, 25)
    full, condensed = model.formulate("full-information"), model.formulate("condensed")
    plan = ran("rts-smoother", model).point
    program, point = full.program, full.encode(plan)
    np.testing.assert_allclose(program.matrix @ point, program.row_lower, rtol=1e-12, atol=1e-9)
    assert np.abs(program.row_lower).max() > 1  # the constants matter
    states = condensed.encode(plan)
    assert condensed.program.objective(states) == pytest.approx(program.objective(point))
    np.testing.assert_allclose(condensed.decode(states).deviation, full.decode(point).deviation)


def test_misfit_by_a_plain_loop():
    draw = np.random.default_rng(2)
    times = np.cumsum(draw.uniform(0.01, 0.6, 50))
    squares, degrees = draw.uniform(0, 9, 50), draw.choice([0.0, 2.0], 50)
    near = np.abs(times[:, None] - times) <= 0.5
    means = [squares[row].sum() / max(degrees[row].sum(), 1.0) for row in near]
    np.testing.assert_allclose(misfit(times, squares, degrees), np.sqrt(np.maximum(means, 1.0)))


def test_deviations_of_a_wrong_vehicle_grow():
    right = kinematic(200, noise=(0.002, 0.05))
    heavy = replace(right, vehicle=Vehicle(**{**CAR, "mass": 2500.0, "cornering_front": 40_000.0}))
    for name in ("clarabel", "moving-horizon"):
        options = {"horizon": 0} if name == "moving-horizon" else None
        one, two = (
            ct.solve(model, name, backend_options=options).plan.deviation
            for model in (replace(right, vehicle=Vehicle(**CAR)), heavy)
        )
        assert np.median(two) > np.median(one)
