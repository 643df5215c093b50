"""The eigenaxis profile, the steering laws and their flights."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from slews import BETA, close

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models import SatelliteSlew
from crosstrack.models.satellite_slew.gyros import (
    gimbal_jacobian,
)
from crosstrack.models.satellite_slew.profile import EigenaxisProfile
from crosstrack.models.satellite_slew.quaternions import (
    rotation_about,
)
from crosstrack.solvers.contract.backend import Limit, Request
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.satellite_slew import eigenaxis
from crosstrack.solvers.satellite_slew.closed_loop import ClosedLoop
from crosstrack.solvers.satellite_slew.steering import (
    GeneralisedInverse,
    PseudoInverse,
    RobustInverse,
    null_projection,
)

LAWS = ("slew-pseudo-inverse", "slew-singularity-robust", "slew-generalised")


@pytest.mark.parametrize(("peak", "push"), [(0.1, 0.05), (1.0, 0.05), (0.02, 0.1)])
def test_profile_is_a_trapezoid_or_a_triangle(peak, push):
    final = rotation_about([1, 2, 2], 1.2)
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    profile = EigenaxisProfile(np.array([1.0, 0.0, 0.0, 0.0]), axis, 1.2, peak, push)
    assert profile.reached <= peak * (1 + 1e-12)
    times = np.linspace(0, profile.duration, 20_001)
    angle, speed, push_at = profile.turned(times)
    assert angle[0] == 0 and angle[-1] == pytest.approx(1.2)
    assert speed.max() <= profile.reached * (1 + 1e-12)
    assert set(np.round(push_at, 9)) <= {-push, 0.0, push}
    close(np.gradient(angle, times)[1:-1], speed[1:-1], 2e-4)
    attitude, rates, _ = profile.course(profile.duration + 1.0)
    close(attitude, final)
    close(rates, np.zeros(3))
    standing = EigenaxisProfile(final, axis, 0.0, peak, push)
    assert standing.duration == 0.0
    assert standing.breaks.tolist() == [0.0]


def test_steering_laws():
    rng = np.random.default_rng(6)
    delta, wanted = rng.uniform(-1, 1, 4), rng.normal(size=3)
    jacobian = gimbal_jacobian(delta, BETA)
    exact = PseudoInverse().rates(0.0, jacobian, wanted)
    close(exact, np.linalg.pinv(jacobian) @ wanted, 1e-9)
    singular = gimbal_jacobian([-np.pi / 2, 0, np.pi / 2, 0], BETA)
    locked = np.array([1.0, 0.0, 0.0])  # no gimbal gives torque about roll there
    close(singular.T @ locked, np.zeros(4), 1e-12)
    robust = RobustInverse(0.01, 10.0)
    assert np.abs(robust.rates(0.0, singular, locked)).max() < 1e-9
    general = GeneralisedInverse(0.01, 10.0, 0.1, np.pi / 2)
    assert np.abs(general.rates(1.0, singular, locked)).max() > 1e-2
    for law in (robust, general):
        assert np.abs(law.rates(0.3, singular, wanted)).max() < 1e3
        close(law.rates(0.0, gimbal_jacobian(np.zeros(4), BETA), wanted),
              PseudoInverse().rates(0.0, gimbal_jacobian(np.zeros(4), BETA), wanted), 1e-5)  # fmt: skip
    moved = null_projection(jacobian, rng.normal(size=4))
    assert np.abs(moved).max() > 1e-3
    close(jacobian @ moved, np.zeros(3), 1e-9)


@pytest.mark.parametrize(
    "law", [LAWS[0], *(pytest.param(law, marks=pytest.mark.slow) for law in LAWS[1:])]
)
def test_each_law_flies_the_papers_slew_when_it_may_choose_the_pace(law, steered):
    found = steered if law == LAWS[0] else ct.solve(SatelliteSlew(), law)
    assert found.termination == "feasible"
    assert found.verification.ok
    assert 11.8 < found.plan.end < 13.5
    # Dearer than the optimum by far, and away from singularities.
    assert found.primal_bound > 8.652909 * 1.3
    assert found.statistics["least singularity measure"] >= 0.2


@pytest.mark.parametrize("law", [LAWS[0], pytest.param(LAWS[1], marks=pytest.mark.slow), LAWS[2]])
def test_at_full_rate_the_gyros_get_singular_and_the_plan_is_rejected(law):
    model = SatelliteSlew(time_range=(1.0, 20.0))
    found = ct.solve(model, law, backend_options={"peak_rate": 1.0})
    assert found.termination == "rejected"
    assert found.plan is None
    assert "singularity measure" in {check.name for check in found.verification.violated}
    assert found.statistics["least singularity measure"] < 0.02


def test_gimbals_are_brought_home_and_elsewhere():
    there = [0.3, -0.3, 0.3, -0.3]
    model = SatelliteSlew.about([1, 1, 1], 30.0, final_gimbals=there)
    pace = {"peak_rate": 0.4, "acceleration": 0.3}
    found = ct.solve(model, LAWS[0], backend_options=pace)
    assert found.verification.ok
    close(found.plan["delta"](found.plan.end), there, 1e-6)
    free = ct.solve(replace(model, final_gimbals=None), LAWS[0], backend_options=pace)
    assert free.plan.end < found.plan.end


def test_gyros_that_hold_momentum_from_the_start():
    model = SatelliteSlew.about(
        "yaw", 20.0, initial_gimbals=[0.1, 0.0, 0.1, 0.0], final_gimbals=None
    )
    assert np.linalg.norm(model.total_momentum) > 1.0
    found = ct.solve(model, "slew-generalised")
    assert found.verification.ok


def test_least_time_and_standing_still():
    slow = SatelliteSlew.about("yaw", 10.0, time_range=(12.0, 20.0))
    found = ct.solve(slow, "slew-pseudo-inverse")
    assert found.verification.ok
    assert found.plan.end == pytest.approx(12.0)
    still = ct.solve(SatelliteSlew.about("yaw", 0.0), "slew-pseudo-inverse")
    assert still.verification.ok
    assert still.primal_bound == pytest.approx(1.0)


def test_too_little_torque_for_the_time_is_rejected():
    found = ct.solve(ct.load("satellite-slew/infeasible"), "slew-pseudo-inverse")
    assert found.termination == "rejected"
    assert "has not settled within the time range" in found.message


def test_options_are_checked_and_a_search_stops():
    with pytest.raises(UnsupportedOption, match="peak_rate"):
        ct.solve(SatelliteSlew(), LAWS[0], backend_options={"peak_rate": 2.0})
    with pytest.raises(UnsupportedOption, match="damping"):
        ct.solve(SatelliteSlew(), LAWS[0], backend_options={"damping": 1.0})
    before, begin = threading.active_count(), time.perf_counter()
    found = ct.solve(SatelliteSlew(), LAWS[1], time_limit=0.2, isolate=False)
    assert found.limit == "time"
    assert found.termination in ("no_solution", "feasible")
    assert time.perf_counter() - begin < 60
    assert threading.active_count() < before + 10


def test_a_stopped_search_returns_its_best_flight():
    control, law = Control(), find_backend(LAWS[0])
    request = Request(options=law.checked_options({}), control=control)
    flown = ClosedLoop.fly

    def fly(loop, latest, step, **options):
        flight = flown(loop, latest, step, **options)
        if flight.measure >= 0.2 and max(flight.load, flight.rate) <= 1.0:
            control.stop(Limit.TIME)
        return flight

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ClosedLoop, "fly", fly)
        patch.setattr(eigenaxis, "EXTRA", 1000.0)  # for a busy machine
        answer = law.run(SatelliteSlew(), request)
    assert answer.termination == "feasible" and answer.limit == "time"
    assert answer.statistics["flights"] < 28
    assert SatelliteSlew().verify(answer.point).ok
    answer = law.run(SatelliteSlew(), request)
    assert answer.termination == "no_solution" and answer.point is None and answer.limit == "time"


def test_the_flight_of_the_plan_polls_the_stop_flag(monkeypatch):
    control, law = Control(), find_backend(LAWS[0])
    request = Request(options=law.checked_options({"peak_rate": 0.5}), control=control)
    sample, samples = ClosedLoop._sample, []

    def stopping(loop, *arguments):
        samples.append(arguments)
        if len(samples) == 200:  # the search has ended: it takes about 60 steps of 0.2 s
            control.stop(Limit.TIME)
        return sample(loop, *arguments)

    monkeypatch.setattr(ClosedLoop, "_sample", stopping)
    monkeypatch.setattr(eigenaxis, "EXTRA", 0.0)
    answer = law.run(SatelliteSlew(), request)
    assert answer.termination == "no_solution" and answer.limit == "time"
    assert answer.message == "the flight of the plan was stopped"
    assert len(samples) < 210
