"""Corridors and limits near the critical tightness: each is solved or proved infeasible."""

from dataclasses import replace

import numpy as np
import pytest
from minimum_snap.tightness import WIDER, critical, drawn, family

import crosstrack as ct
from crosstrack.models.minimum_snap import MinimumDerivative
from crosstrack.solvers import Guarantee
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.contract.selection import guaranteed
from crosstrack.solvers.run.fallback import go_on


def check(case, backend="auto"):
    answer = ct.solve(case.model, backend)
    assert answer.termination == ("optimal" if case.feasible else "infeasible"), (case.name, answer)
    if case.feasible:
        assert answer.gap <= 1.1e-6 and answer.verification.ok


def test_tight_corridors_are_solved_or_refuted():
    for case in drawn(6, most=8):
        check(case, "interior-point")


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 3000, 100))
def test_tight_corridors_are_solved_or_refuted_always(first):
    for case in drawn(12, first):
        check(case)


#: Whose first barrier lay below the multipliers that the bounds need.
@pytest.mark.parametrize(("seed", "share"), [(12, 1e-3), (18, -0.1), (18, 1e-4)])
def test_a_stall_at_the_start_is_overcome(seed, share):
    model = family(seed)
    low, high = critical(model)
    assert low <= high <= low * (1 + 1e-4)
    answer = ct.solve(model((high if share > 0 else low) * (1 + share)), "interior-point")
    assert answer.termination == ("optimal" if share > 0 else "infeasible"), answer


def test_an_objective_far_below_the_first_guess():
    family_of = family(69)
    _, high = critical(family_of)
    answer = ct.solve(family_of(high * (1 + WIDER[1])), "interior-point")
    assert answer.termination == "optimal", answer


@pytest.mark.parametrize("backend", ["clarabel", "piqp", "highs", "proxqp", "osqp", "scs"])
def test_waypoints_alone_with_durations_far_apart(backend):
    for seed in range(3):
        generator = np.random.default_rng(seed)
        count = int(generator.integers(5, 40))
        times = np.cumsum(np.exp(generator.uniform(np.log(0.05), np.log(20), count)))
        points = np.cumsum(generator.normal(size=(count + 1, 2)), axis=0)
        model = MinimumDerivative(points, np.concatenate([[0.0], times]), order=4)
        answer = ct.solve(model, backend, isolate=False)
        # The terms of the objective may be 1e7 times what they sum to: rounding in the bound.
        assert answer.termination == "optimal" or answer.gap <= 1e-5, answer
        assert answer.formulation == "hermite"
        assert answer.primal_bound == pytest.approx(ct.solve(model).primal_bound, rel=2e-6)


# -- fallback of auto --------------------------------------------------------------------------------


def test_auto_continues_after_a_failure():
    model = family(3)(4.0)
    job = Job(model=model).resolved()
    found = ct.solve(model)
    ran = []

    def run(one):
        ran.append(one.backend.name)
        return ct.solve(one.model, one.backend, time_limit=one.time_limit, isolate=False)

    failed = replace(found, termination="failed", plan=None, primal_bound=None, dual_bound=None)
    answer = go_on(job, failed, run)
    assert answer.termination == "optimal"
    assert ran == [
        next(b.name for b in guaranteed(model, Guarantee.EXACT) if b.name != "interior-point")
    ]
    assert answer.primal_bound == pytest.approx(found.primal_bound, rel=2e-6)
    assert answer.statistics["backends tried"].startswith("interior-point: failed, ")


@pytest.mark.parametrize(
    "ended",
    [{}, {"termination": "infeasible"}, {"termination": "feasible", "limit": "time"}],
)
def test_auto_does_not_go_on_after_a_proof_or_a_limit(ended):
    model = family(3)(4.0)
    found = replace(ct.solve(model), **ended)
    assert go_on(Job(model=model).resolved(), found, lambda job: pytest.fail("ran again")) is found


def test_a_verified_plan_outranks_a_claim_of_infeasibility():
    model = family(3)(4.0)
    found = replace(ct.solve(model), termination="feasible", dual_bound=None)
    claim = replace(
        found, termination="infeasible", plan=None, verification=None, primal_bound=None
    )
    answer = go_on(Job(model=model).resolved(), found, lambda job: claim)
    assert answer.termination == "feasible" and answer.plan is found.plan
