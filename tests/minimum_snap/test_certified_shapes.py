"""A QP solver's plan is optimal only if its shape is, as the objective hides it if durations differ."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack import jit
from crosstrack.models import MinimumSnap
from crosstrack.solvers import Answer, Termination
from crosstrack.solvers.certification import DISTANCE
from crosstrack.solvers.minimum_snap.direct import Banded

BACKENDS = ["piqp", "proxqp", "osqp", "clarabel", "highs", "quadprog", "scs", "daqp"]


def wild_path(seed, segments=40):
    """Return a path whose durations are log-uniform in [0.05, 20] s."""
    draw = np.random.default_rng(seed)
    durations = np.exp(draw.uniform(np.log(0.05), np.log(20.0), segments))
    waypoints = draw.uniform(-1.0, 1.0, (segments + 1, 2)).cumsum(axis=0)
    return MinimumSnap(waypoints, np.concatenate([[0.0], durations.cumsum()]))


def largest_distance(model, plan, other):
    """Return the largest distance at 201 times per segment, in the widest extent of the waypoints."""
    times = np.concatenate(
        [np.linspace(a, b, 201) for a, b in zip(model.times[:-1], model.times[1:], strict=True)]
    )
    extent = np.ptp(model.conditions[:, 0], axis=0).max()
    return np.abs(plan(times) - other(times)).max() / extent


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_optimal_path_has_the_certified_shape(backend):
    outcomes = set()
    for seed in range(3):
        model = wild_path(seed)
        certified = ct.solve(model, "banded").plan
        found = ct.solve(model, backend, formulation="hermite", time_limit=20)
        outcomes.add(str(found.termination))
        if found.plan is None:
            continue
        distance = largest_distance(model, found.plan, certified)
        assert found.termination != "optimal" or distance <= 1.1e-6
        if DISTANCE in found.statistics:
            assert found.statistics[DISTANCE] == pytest.approx(distance, rel=0.1, abs=1e-9)
            if found.statistics[DISTANCE] > 1e-6:
                assert found.termination == "feasible"
                assert "of the extent away from the optimum that banded certifies" in found.message
    assert "feasible" in outcomes


@pytest.mark.parametrize("formulation", ["hermite", "legendre"])
def test_a_path_with_even_durations_stays_optimal(formulation):
    draw = np.random.default_rng(5)
    model = MinimumSnap(draw.uniform(0.0, 10.0, (9, 3)), np.arange(9.0))
    for backend in ("piqp", "osqp", "clarabel"):
        found = ct.solve(model, backend, formulation=formulation)
        assert found.termination == "optimal", (backend, found.message)
        assert found.statistics[DISTANCE] <= 1e-6


def test_a_plan_that_banded_cannot_certify_is_only_feasible(monkeypatch):
    draw = np.random.default_rng(5)
    model = MinimumSnap(draw.uniform(0.0, 10.0, (9, 3)), np.arange(9.0))
    for reply in (
        Answer(Termination.FEASIBLE, point=ct.solve(model, "banded").plan, message="too coarse"),
        jit.OutOfTime(),
    ):

        def run(self, problem, request, reply=reply):
            if isinstance(reply, Exception):
                raise reply
            return reply

        monkeypatch.setattr(Banded, "run", run)
        found = ct.solve(model, "clarabel", formulation="hermite", isolate=False)
        assert found.termination == "feasible" and found.verified
        assert "banded cannot certify the plan" in found.message
