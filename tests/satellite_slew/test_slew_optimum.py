"""The best slew by nonlinear programming, and the catalogue."""

import itertools

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.instances import entries
from crosstrack.models import Model, SatelliteSlew
from crosstrack.models.satellite_slew.tracking import track

ENTRIES = [e for e in entries() if e.name.startswith("satellite-slew/")]


def test_a_coarse_optimum_is_verified_by_the_slews_own_check():
    coarse = {"intervals": 5, "degree": 4}
    best = ct.solve(SatelliteSlew(), "ipopt", tolerance=2e-2, formulation_options=coarse, seed=0)
    assert best.termination == "locally_optimal"
    assert "body rates integrated anew" in {check.name for check in best.verification.checks}
    assert best.primal_bound == pytest.approx(8.652909, rel=2e-2)


@pytest.mark.slow
def test_the_optimum_is_better_than_every_law_and_verified():
    model = SatelliteSlew.about("pitch", 45.0)
    best = ct.solve(model, "ipopt", tolerance=1e-3)
    assert best.termination == "locally_optimal"
    assert best.verification.ok
    assert best.primal_bound == pytest.approx(8.0770, rel=1e-3)
    steered = ct.solve(model, "slew-pseudo-inverse")
    assert steered.primal_bound > best.primal_bound


@pytest.mark.slow
@pytest.mark.parametrize(("name", "end"), [("paper", 7.8358), ("paper-components", 7.8258)])
def test_the_papers_slew(name, end):
    best = ct.solve(ct.load(f"satellite-slew/{name}"), tolerance=1e-5)
    assert best.backend == "ipopt"
    assert best.verification.ok
    wanted = ct.instances.entry(f"satellite-slew/{name}").published["objective"]
    assert best.primal_bound == pytest.approx(wanted, rel=1e-5)
    assert best.plan.end == pytest.approx(end, abs=1e-3)


@pytest.mark.slow
def test_a_reserve_pays():
    best = ct.solve(SatelliteSlew(), tolerance=1e-5)
    # A tenth in reserve costs 2.2 % of time, and pays: disturbances from anywhere are tracked
    # within the paper's figures, which at the limits they are not.
    model = ct.load("satellite-slew/margin-10")
    reserved = ct.solve(model, tolerance=1e-5)
    assert reserved.plan.end / best.plan.end == pytest.approx(1.022, abs=1e-3)
    for torque in itertools.product((-0.1, 0.1), repeat=3):
        found = track(model, reserved, disturbance=torque)
        assert found.max_quaternion_error < 4e-4
        assert found.max_rate_error < 1e-3
    assert track(SatelliteSlew(), best, disturbance=(-0.1, 0, 0)).max_rate_error > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "angle", "best"),
    [
        ("roll", 90.0, 14.0630), ("roll", 120.0, 16.9525), ("roll", 180.0, 21.9915),
        ("pitch", 90.0, 13.6362), ("pitch", 120.0, 16.7505), ("pitch", 180.0, 21.8084),
        ("yaw", 90.0, 13.1145), ("yaw", 120.0, 16.2411), ("yaw", 180.0, 21.4726),
    ],
)  # fmt: skip
def test_great_turns_are_verified_by_default(axis, angle, best):
    found = ct.solve(SatelliteSlew.about(axis, angle))
    assert found.termination == "locally_optimal"
    assert found.verification.ok
    # Another optimum may be met, but none that is worse by more than local optima differ.
    assert found.primal_bound < 1.02 * best


@pytest.mark.slow
def test_a_flight_with_small_errors_need_not_keep_the_limits():
    model = SatelliteSlew(margin=0.1)
    plan = ct.solve(model, formulation="gauss", tolerance=1e-4).plan
    found = track(model, plan, disturbance=(0, 0, 0), inertia_error=0.02)
    assert found.max_quaternion_error < 4e-4
    assert not found.saturated.any()
    assert found.breach.name == "singularity measure"
    # A plan that keeps farther away costs half a percent.
    wary = ct.solve(
        SatelliteSlew(margin=0.1, singularity_limit=0.4), formulation="gauss", tolerance=1e-4
    )
    assert track(model, wary, disturbance=(0, 0, 0), inertia_error=0.02).ok


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_instances_build_and_travel(entry):
    model = entry.build()
    assert isinstance(model, SatelliteSlew)
    assert model.name == entry.name
    assert Model.from_json(model.to_json()).digest == model.digest
    assert model.lower().name == entry.name
    assert entry.note and entry.title


def test_the_infeasible_instance_is_infeasible():
    model = ct.load("satellite-slew/infeasible")
    # Without total momentum, I ẇ = T_c bounds how fast the rate grows, up and down again.
    push = np.linalg.norm(model.torque_limit / np.diag(model.inertia))
    assert not model.total_momentum.any()
    assert 2 * np.sqrt(model.turn[1] / push) > model.time_range[1]
