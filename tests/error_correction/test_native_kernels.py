"""The compiled searches: their plain-Python meaning, stops, ties, many critical points."""

import json
import math
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from brute_force import shortest_length

import crosstrack as ct
from crosstrack.instances.error_correction.generator import random_small, uniform_slab
from crosstrack.models import ErrorCorrectionRouting
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.contract.backend import Limit
from crosstrack.solvers.error_correction.airspace import airspace
from crosstrack.solvers.error_correction.grid import build, near
from crosstrack.solvers.error_correction.reachability import reachable, refusals
from crosstrack.solvers.error_correction.steps import distances_to, remaining
from crosstrack.solvers.resource_routing.elementary import Found, elementary

PRINTED = ["two-stage", "pulse", "dynamic-programming"]
EXACT = ["label-setting", *PRINTED]

#: Shortest walk visits point 1 twice, so that searches for simple routes run too.
TINY = {
    "points": [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [2.2, 0, 0]],
    "kinds": ["A", "horizontal", "vertical", "B"],
    "alpha1": 1.6, "alpha2": 1.6, "beta1": 1.6, "beta2": 1.6, "theta": 1.75, "delta": 1.0,
}  # fmt: skip

SAME = """
import json, sys
import crosstrack as ct
from crosstrack import jit
jit._left = float(sys.argv[1])
from crosstrack.instances.error_correction.generator import random_small
answers = []
for seed in range(16):
    model = random_small(3 + seed % 6, seed, revisits=seed % 2 == 0)
    for name in {names}[: 5 if seed % 2 else 1]:
        answer = ct.solve(model, name, isolate=False)
        answers.append([answer.termination, answer.plan and answer.plan.route, answer.primal_bound, dict(answer.statistics)])
for answer in answers:
    for key in [k for k in answer[3] if k.endswith("_seconds")]:
        del answer[3][key]
assert ("numba" in sys.modules) == (jit._left <= 0)
json.dump(answers, sys.stdout)
"""


def test_compiled_and_interpreted_are_the_same():
    """Every label, every route and every length is the same, bit for bit."""
    script = SAME.format(names=[*EXACT, "labelling"])
    outputs = [
        subprocess.run(
            [sys.executable, "-c", script, budget],
            capture_output=True, text=True, timeout=240, check=True,
        ).stdout
        for budget in ("0", "inf")
    ]  # fmt: skip
    compiled, interpreted = map(json.loads, outputs)
    assert compiled == interpreted
    assert len(compiled) == 8 * 5 + 8


def test_same_instance_same_plan():
    model = ct.load("error-correction/4")
    for name in [*EXACT, "labelling"]:
        first, second = ct.solve(model, name, seed=1), ct.solve(model, name, seed=2)
        assert first.plan == second.plan
        assert first.statistics["labels made"] == second.statistics["labels made"]


def test_labelling_takes_the_first_factor_with_a_route():
    model = ct.load("error-correction/9")
    found = ct.solve(model, "labelling")
    factor = found.statistics["threshold factor"]
    for value, expected in ((factor - 0.05, None), (factor, found.plan), (1.0, None)):
        single = ct.solve(model, "labelling", backend_options={"threshold_factor": value})
        assert single.plan == expected


@pytest.mark.parametrize("name", [*EXACT, "labelling"])
def test_a_stopped_search_proves_nothing(name):
    model = ct.load("error-correction/9")
    backend = find_backend(name, model)
    request = Request(options=backend.checked_options({}))
    request.control.stop(Limit.INTERRUPTED)
    answer = backend.run(model, request)
    assert answer.limit is Limit.INTERRUPTED
    assert answer.termination in ("no_solution", "feasible")
    best = ct.solve(model).primal_bound
    if name in EXACT:
        line = math.dist(model.points[model.start], model.points[model.end])
        assert line * (1 - 1e-12) <= answer.dual_bound <= best


@pytest.mark.parametrize("name", [*EXACT, "labelling"])
def test_a_time_limit_is_kept_on_long_searches(name):
    """Twelve thousand points with an unreachable B, which needs a long search without a test for it."""
    model = replace(uniform_slab(12_000, (10, 10, 10, 10, 10), seed=3), theta=1e-6)
    begin = time.perf_counter()
    answer = ct.solve(model, name, time_limit=0.2)
    assert time.perf_counter() - begin < 8
    assert answer.limit == "time" or answer.termination in ("infeasible", "no_solution")


@pytest.mark.parametrize("revisits", [False, True])
def test_coinciding_points_and_thresholds_met_exactly(revisits):
    """Zero-length arcs make ties, and 0.1 * 3 must not exceed 0.3."""
    model = ErrorCorrectionRouting(
        points=[[0, 0, 0], [3, 0, 0], [3, 0, 0], [3, 0, 0], [6, 0, 0], [6, 0, 0], [9, 0, 0]],
        kinds=["A", "horizontal", "vertical", "horizontal", "vertical", "horizontal", "B"],
        alpha1=0.3, alpha2=0.3, beta1=0.3, beta2=0.3, theta=0.3, delta=0.1, revisits=revisits,
    )  # fmt: skip
    assert shortest_length(model) == 9
    for name in EXACT[:1] if revisits else EXACT:
        answer = ct.solve(model, name)
        assert answer.primal_bound == 9, name
        assert not answer.verification.within_tolerance


def test_nothing_grows_without_a_rate():
    model = ErrorCorrectionRouting(
        [[0, 0, 0], [5, 5, 5], [9, 0, 0]], ["A", "horizontal", "B"], 0, 0, 0, 0, 0, delta=0.0
    )
    for name in EXACT:
        answer = ct.solve(model, name)
        assert answer.plan.route == (0, 2)
        assert answer.primal_bound == 9


def test_a_and_b_may_coincide():
    model = ErrorCorrectionRouting([[1, 1, 1], [1, 1, 1]], ["B", "A"], 0, 0, 0, 0, 0, delta=1.0)
    for name in [*EXACT, "highs"]:
        answer = ct.solve(model, name)
        assert answer.termination == "optimal", (name, answer)
        assert answer.primal_bound == 0
        assert answer.plan.route == (1, 0)


def test_a_cutoff_below_the_optimum_is_no_proof_of_infeasibility():
    model = ct.load("error-correction/1")
    best = ct.solve(model)
    for name in EXACT:
        backend = find_backend(name, model)
        answer = backend.run(model, Request(cutoff=best.primal_bound * 0.99))
        assert answer.termination == "no_solution"
        assert answer.dual_bound == best.primal_bound * 0.99
        answer = backend.run(model, Request(cutoff=best.primal_bound))
        assert answer.termination == "optimal"


def exact_reach(model):
    """The least surviving error at each point, by a search over all exact states."""
    limits = {
        "vertical": (model.alpha2, model.alpha1),
        "horizontal": (model.beta2, model.beta1),
        "B": (model.theta,) * 2,
    }
    least = {}
    states = [(model.start, 0.0, 0.0)]
    seen = set(states)
    while states:
        i, h, v = states.pop()
        for j, kind in enumerate(model.kinds):
            if j in (i, model.start) or i == model.end:
                continue
            d = math.dist(model.points[i], model.points[j])
            hj, vj = h + model.horizontal_rate * d, v + model.vertical_rate * d
            slack = [1e-9 * max(1, x) for x in limits[kind]]
            if hj > limits[kind][0] + slack[0] or vj > limits[kind][1] + slack[1]:
                continue
            hj, vj = (0.0 if kind == "horizontal" else hj), (0.0 if kind == "vertical" else vj)
            least[j] = min(least.get(j, math.inf), 0.0 if kind == "B" else hj + vj)
            if (j, hj, vj) not in seen:
                seen.add((j, hj, vj))
                states.append((j, hj, vj))
    return least


def test_reach_equals_a_search_over_exact_states():
    for seed in range(120):
        model = random_small(3 + seed % 7, seed)
        truth = exact_reach(model)
        found = reachable(model)
        for point in range(len(model.points)):
            if point == model.start:
                continue
            assert found[point] == pytest.approx(truth.get(point, math.inf), abs=1e-12), (
                seed,
                point,
            )
        for refusal in refusals(model, found):
            assert refusal.tail == model.start or refusal.tail in truth
            assert refusal.head not in truth
            assert refusal.excess > 0


def test_diagnosis_names_points_without_extensions():
    infeasible = 0
    for seed in range(80):
        model = random_small(3 + seed % 7, seed)
        found = ct.diagnose(model)
        best = shortest_length(model)
        assert found.feasible is (best is not None)
        if best is None:
            infeasible += 1
            assert found.findings
            assert all(finding.where.startswith("point ") for finding in found.findings)
    assert infeasible > 20


def test_diagnosis_of_a_forbidden_revisit():
    found = ct.diagnose(ErrorCorrectionRouting(**TINY))
    assert found.feasible is False
    assert "point 1 more than once" in str(found)
    assert found.findings[0].data["walk"] == [0, 1, 2, 1, 3]
    assert ct.diagnose(ErrorCorrectionRouting(**TINY, revisits=True)).feasible is True


@pytest.mark.parametrize("count", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_deletion_filter_finds_an_irreducible_set(count):
    """Leaving out any one of the blocks it names makes the program feasible."""
    checked = 0
    for seed in range(40):
        model = random_small(5, seed)
        if shortest_length(model) is not None:
            continue
        found = ct.diagnose(model, "highs", formulation="paper")
        assert found.feasible is False
        program = replace(model.formulate("paper").program, name="")
        names = [finding.where for finding in found.findings]
        others = [block.name for block in program.rows if block.name not in names]
        assert ct.solve(program.without_rows(others), "highs").termination == "infeasible"
        for name in names:
            relaxed = program.without_rows([*others, name])
            assert ct.solve(relaxed, "highs").termination in ("optimal", "feasible", "unbounded")
        checked += 1
        if checked == count:
            break
    assert checked == count


@pytest.mark.parametrize("seed", range(6))
def test_the_grid_finds_near_points(seed):
    model = uniform_slab(300 + 50 * seed, (20, 10, 15, 20, 20), seed=seed)
    space = airspace(model)
    grid = build(space, np.ones(len(model.points), np.bool_))
    found, away = np.empty(len(grid.x), np.int64), np.empty(len(grid.x))
    draw = np.random.default_rng(seed)
    for slot in draw.integers(0, len(grid.x), 20):
        distance = np.linalg.norm(model.points - model.points[grid.ids[slot]], axis=1)
        for kind in (1, 2):
            for radius in (0.0, 3e3, 2e4, 1e6):
                count = near(grid, slot, kind, radius, found, away)
                near_points = set(grid.ids[found[:count]].tolist())
                expected = np.flatnonzero((distance <= radius) & (model.codes == kind))
                assert near_points == set(expected.tolist()) - {int(grid.ids[slot])}
                assert np.allclose(np.sort(away[:count]), np.sort(distance[sorted(near_points)]))


def test_bounds_on_the_remaining_length():
    model = ct.load("error-correction/8")
    space = airspace(model)
    grid = build(space, np.ones(len(model.points), np.bool_))
    flag = np.zeros(1, np.int8)
    ahead, behind = (remaining(space, grid, forward, 10**9, flag) for forward in (False, True))
    line = distances_to(grid, len(grid.x) - 1)
    assert (ahead >= line - 1e-6).all()
    assert ahead[-2] == pytest.approx(behind[-1])
    best = ct.solve(model)
    places = {point: slot for slot, point in enumerate(grid.ids.tolist())}
    for stop in model.walk(best.plan):
        slot = places[stop.point]
        assert behind[slot] <= stop.distance + 1e-6
        assert ahead[slot] <= best.primal_bound - stop.distance + 1e-6


def test_rounds_go_on_until_no_point_repeats():
    walks = [[0, 1, 2, 1, 9], [0, 3, 1, 3, 9], [0, 1, 4, 9]]
    asked = []

    def search(critical, bound):
        asked.append(critical.tolist())
        return Found(1, np.array(walks[len(asked) - 1]), 1.0, 1.0, 10, 5)

    found = elementary(search, revisits=False)
    assert asked == [[], [1], [1, 3]]
    assert (found.rounds, found.critical, found.made, found.settled) == (3, 2, 30, 15)
    assert (
        elementary(lambda *_: Found(1, np.array(walks[0]), 1.0, 1.0, 1, 1), revisits=True).rounds
        == 1
    )
