"""Hundreds of random small instances: every exact backend equals brute force, every plan encodes.

The instances run in persistent workers, one per backend, so that a thousand runs take seconds.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from brute_force import shortest_length

import crosstrack as ct
from crosstrack.instances.error_correction.generator import random_small
from crosstrack.models import ErrorCorrectionRouting

#: The paper's algorithms, whose answer may lack a proof.
PRINTED = ["two-stage", "pulse", "dynamic-programming"]
NATIVE = ["label-setting", *PRINTED]


def twice(seed):
    """An instance around a walk that must return to a hub, with a few other points beside it.

    Every other one has twins of the hub, so that a route without revisits often exists as well,
    and is longer than the walk.
    """
    draw = np.random.default_rng(seed)
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [2.2, 0, 0]])
    points += draw.uniform(-0.02, 0.02, points.shape)
    kinds = ["A", "horizontal", "vertical", "B"]
    twins = int(draw.integers(1, 3)) * (seed // 2 % 2)
    points = np.vstack([points, points[1] + draw.uniform(-0.05, 0.05, (twins, 3))])
    kinds += ["horizontal"] * twins
    extra = int(draw.integers(0, 4))
    points = np.vstack([points, draw.uniform([0, -1, -1], [2.2, 1, 1], (extra, 3))])
    kinds += ["horizontal" if r < 0.5 else "vertical" for r in draw.random(extra)]
    order = draw.permutation(len(kinds))
    limits = np.array([1.6, 1.6, 1.6, 1.6, 1.75]) + draw.uniform(-0.02, 0.05, 5)
    return ErrorCorrectionRouting(
        points[order],
        [kinds[k] for k in order],
        *limits,
        delta=1.0,
        revisits=bool(seed % 2),
        name=f"twice-{seed}",
    )


#: Seeds for which brute force alone, which knows no dominance, takes more than half a second.
LONG = (7, 19, 30, 38, 74, 99, 110, 118, 146, 154)


@cache
def drawn(kind, step=1):
    """Return every `step`-th instance: without revisits, with revisits, or around a hub."""
    if kind == "twice":
        return [twice(seed) for seed in [s for s in range(160) if s not in LONG][::step]]
    first, revisits = {"simple": (0, False), "free": (1000, True)}[kind]
    return [
        random_small(3 + seed % 7, first + seed, revisits=revisits, name=f"{kind}-{seed}")
        for seed in range(0, 250, step)
    ]


#: Every tenth instance in the fast tests, all in the slow ones.
steps = pytest.mark.parametrize("step", [20, pytest.param(1, marks=pytest.mark.slow)])


@cache
def length_of(model):
    """Return the length of the shortest route by brute force, once per model."""
    return shortest_length(model)


def check(models, result):
    """Hold every answer against brute force."""
    for model, verdict in zip(models, result.verdicts, strict=True):
        best = length_of(model)
        printed = {solution.backend for solution in verdict.solutions} <= set(PRINTED)
        assert verdict.outcome in ("AGREED", "INCONCLUSIVE" if printed else "AGREED"), verdict
        for solution in verdict.solutions:
            where = (model.name, solution.backend, solution.formulation, solution.message)
            if solution.backend in PRINTED and "without a proof" in solution.message:
                assert solution.primal_bound is None or solution.primal_bound >= best * (1 - 1e-9)
                assert best is None or solution.dual_bound <= best, where
            elif best is None:
                assert solution.termination == "infeasible", where
            else:
                assert solution.termination == "optimal", where
                assert solution.primal_bound == pytest.approx(best, rel=1e-6), where
                assert solution.gap <= 2e-6, where


@steps
def test_the_draw_holds_both_kinds(step):
    for models in (drawn("simple", step), drawn("free", step)):
        infeasible = sum(length_of(model) is None for model in models)
        assert 0.2 < infeasible / len(models) < 0.8
    lost = longer = 0
    for model in drawn("twice", step):
        other = shortest_length(replace(model, revisits=not model.revisits))
        walk, route = length_of(model), other
        if not model.revisits:
            walk, route = route, walk
        lost += walk is not None and route is None
        longer += None not in (walk, route) and route > walk + 1e-9
    assert lost >= 20 / step, "too few instances lose their route with their revisits"
    assert longer >= 10 / step, "too few instances have a route that is longer than their walk"


@cache
def simple_answers(step, *backends):
    """The comparison of `backends` on the simple instances; several tests look at the same."""
    return ct.compare(drawn("simple", step), backends, time_limit=60)


@steps
@pytest.mark.parametrize("kind", ["simple", "free", "twice"])
def test_native_backends_equal_brute_force(kind, step):
    models = drawn(kind, step)
    if kind == "simple":
        result = simple_answers(step, *NATIVE)
    else:
        result = ct.compare(models, NATIVE[:1], time_limit=60)
    check(models, result)
    if kind == "twice":
        # The searches for simple routes have run.
        assert sum(one.statistics["rounds"] > 1 for one in result.solutions) >= 20 / step


@steps
def test_the_papers_algorithms_find_no_better_than_brute_force(step):
    """Around hubs that a walk visits twice; without a proof in some cases."""
    models = [model for model in drawn("twice") if not model.revisits][::step]
    result = ct.compare(models, PRINTED, time_limit=60)
    check(models, result)
    for name in PRINTED:
        answers = [one for one in result.solutions if one.backend == name]
        assert (
            20 / step
            < sum(one.termination in ("optimal", "infeasible") for one in answers)
            < len(answers)
        )


@pytest.mark.slow
def test_native_backends_equal_long_brute_force():
    models = [twice(seed) for seed in LONG]
    check(models, ct.compare(models, NATIVE[:1], time_limit=60))


@steps
@pytest.mark.parametrize("formulation", ["paper", "arc-flow"])
def test_programs_equal_brute_force(formulation, step):
    check(drawn("simple", step), simple_answers(step, f"highs:{formulation}"))


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["scip", "scipy", "ortools", "cvxpy"])
def test_other_solvers_equal_brute_force(backend):
    """All solvers receive the same programs; tests/programs/test_mip_backends.py tests their adapters."""
    models, names = drawn("simple"), [f"{backend}:paper", f"{backend}:arc-flow"]
    check(models, ct.compare(models, names, time_limit=60))


@steps
def test_every_plan_encodes_into_both_formulations(step):
    """A plan of any backend satisfies every row of both programs, and decodes to itself."""
    parts = [NATIVE, ["labelling"], ["highs:paper"], ["highs:arc-flow"]]
    results = [simple_answers(step, *names) for names in parts]
    plans = 0
    for row, model in enumerate(drawn("simple", step)):
        written = [model.formulate("paper"), model.formulate("arc-flow")]
        for solution in (s for result in results for s in result.verdicts[row].solutions):
            if solution.plan is None:
                continue
            plans += 1
            for formulation in written:
                point = formulation.encode(solution.plan)
                found = formulation.program.verify(point, tolerance=1e-9)
                assert found.ok, (model.name, solution.backend, str(found))
                assert found.objective == pytest.approx(solution.primal_bound, rel=1e-12)
                assert formulation.decode(point) == solution.plan
    assert plans > 600 / step


@steps
def test_revisits_never_cost(step):
    """The relaxation is a relaxation: allowing revisits never makes the shortest route longer."""
    for model in drawn("free", step):
        simple = shortest_length(replace(model, revisits=False))
        if simple is not None:
            assert length_of(model) <= simple + 1e-12
