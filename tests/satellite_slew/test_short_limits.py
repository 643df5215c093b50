"""A flight of a steering law is the plan of a slew whose program has no time."""

from __future__ import annotations

from dataclasses import replace

import pytest

import crosstrack as ct
from crosstrack.models import SatelliteSlew
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.run import dispatch, fallback


@pytest.fixture(scope="module")
def flight():
    return ct.solve(SatelliteSlew.about("yaw", 20.0), "slew-pseudo-inverse")


def solved(monkeypatch, flight, objective, **options):
    """Return the solution of a slew whose program ends with that objective, and the backends that ran."""
    ran = []

    def run_job(job, *arguments):
        ran.append(job.backend.name)
        if job.backend.name == "slew-pseudo-inverse":
            return flight
        if objective is None:
            return replace(
                flight, backend="ipopt", termination="no_solution", plan=None, limit="time",
                primal_bound=None, verification=None,
            )  # fmt: skip
        return replace(flight, backend="ipopt", primal_bound=objective)

    monkeypatch.setattr(dispatch, "run_job", run_job)
    return ct.solve(SatelliteSlew.about("yaw", 20.0), **options), ran


@pytest.mark.parametrize(("share", "backend"), [(None, "slew-pseudo-inverse"), (0.9, "ipopt")])
def test_the_better_plan_is_returned(monkeypatch, flight, share, backend):
    objective = None if share is None else share * flight.primal_bound
    solution, ran = solved(monkeypatch, flight, objective, time_limit=30)
    assert ran == ["slew-pseudo-inverse", "ipopt"]
    assert solution.backend == backend and solution.plan is not None
    assert solution.options["time_limit"] == 30


@pytest.mark.parametrize("options", [{}, {"backend": "ipopt", "time_limit": 30}])
def test_no_heuristic_precedes_a_named_backend_or_a_run_without_a_limit(
    monkeypatch, flight, options
):
    _, ran = solved(monkeypatch, flight, None, **options)
    assert ran == ["ipopt"]


def test_an_option_that_the_heuristic_does_not_support_rules_it_out():
    model = SatelliteSlew.about("yaw", 20.0)
    job = Job(model=model, time_limit=30, warm_start=object()).resolved()
    assert fallback.begin(job, lambda one: pytest.fail("ran")) is None
