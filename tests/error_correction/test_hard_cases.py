"""Detours, dead ends, chains of choices; tests count labels, so the machine's load has no effect."""

import math
from dataclasses import replace

import numpy as np
import pytest
from brute_force import shortest_length
from hard_cases import ball, chain, clusters, wall, wild
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.instances.error_correction.generator import random_small, uniform_slab
from crosstrack.models import ErrorCorrectionRouting
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.error_correction.airspace import airspace
from crosstrack.solvers.error_correction.grid import build, reach
from crosstrack.solvers.error_correction.steps import distances_to, remaining
from crosstrack.solvers.error_correction.way_kernels import lengths_of_walks
from crosstrack.solvers.resource_routing import network as arcs_of
from crosstrack.solvers.resource_routing.labelling import ResourceLabelling

PRINTED = ["two-stage", "pulse", "dynamic-programming"]
EXACT = ["label-setting", *PRINTED]

#: Wild instances on which brute force, which knows no dominance, takes more than 0.1 s.
LONG = (56, 80, 137, 152)
QUICK = [seed for seed in range(180) if seed not in LONG]


def answered(model, name="label-setting", cutoff=None):
    """Return the answer of a backend, whose route is verified and proven."""
    backend = find_backend(name, model)
    request = Request(cutoff=cutoff, options=backend.checked_options({}))
    answer = backend.run(model, request)
    if answer.point is not None:
        found = model.verify(answer.point)
        assert found.ok and found.objective == answer.primal_bound
        assert answer.dual_bound <= answer.primal_bound
    return answer


def laid_out(model):
    space = airspace(model)
    return space, build(space, np.ones(len(model.points), np.bool_))


@pytest.mark.parametrize(
    ("theta", "kind"), [(48, None), (60, "horizontal")], ids=["too far", "nothing left"]
)
def test_a_dead_end_takes_few_labels(theta, kind):
    """Every point is reached from A, and none of them leads to B."""
    model = ball(10_000, theta, kind)
    answer = answered(model)
    assert answer.termination == "infeasible"
    assert answer.statistics["labels made"] <= 6 * len(model.points)


def test_a_crowd_that_leads_on_takes_few_labels():
    answer = answered(ball(3000, 60))
    assert answer.termination == "optimal"
    assert answer.primal_bound == pytest.approx(1e5, rel=1e-5)
    assert answer.statistics["labels made"] <= 10 * 3000


@pytest.mark.parametrize("shape", ["one", "two", "pocket", "closed"])
def test_a_detour_takes_few_labels(shape):
    """Of the same length as by another search; without the bound, ten times as many labels."""
    model = wall(2000, shape)
    answer, other = answered(model), answered(model.lower(), "resource-labelling")
    assert answer.termination == other.termination
    assert (answer.termination == "infeasible") == (shape == "closed")
    if answer.point is not None:
        assert answer.primal_bound == pytest.approx(other.primal_bound, rel=1e-12)
        line = math.dist(model.points[model.start], model.points[model.end])
        assert answer.primal_bound > 1.2 * line
    assert answer.statistics["labels made"] <= 30 * len(model.points)


def test_an_end_out_of_reach_is_seen_from_there():
    model = replace(uniform_slab(20_000, (25, 15, 20, 25, 30), seed=3), theta=1e-3)
    answer = answered(model)
    assert answer.termination == "infeasible"
    assert answer.statistics["labels made"] <= 5 * len(model.points)


@pytest.mark.parametrize("k", [8, 24, 40])
@pytest.mark.parametrize("jitter", [0.0, 0.03])
def test_a_chain_of_choices_is_not_multiplied(k, jitter):
    model = chain(k, jitter=jitter)
    answer = answered(model)
    assert answer.termination == "optimal"
    assert answer.statistics["rounds"] > 1
    assert answer.statistics["labels made"] <= 300 * k
    walk = answered(replace(model, revisits=True)).primal_bound
    assert walk < answer.primal_bound or jitter == 0.0


@pytest.mark.parametrize("k", [6, 12])
def test_the_lengths_of_walks_cut_off_no_optimum(k):
    """The search of the general model has bounds that ignore the errors."""
    models = [
        chain(k),
        chain(k, twins=2, others=1),
        chain(k, single=(k // 2,)),
        clusters(3, k // 3),
    ]
    for model in models:
        answer, other = answered(model), answered(model.lower(), "resource-labelling")
        assert answer.termination == other.termination
        if answer.primal_bound is not None:
            assert answer.primal_bound == pytest.approx(other.primal_bound, rel=1e-12)
    assert answered(models[2]).termination == "infeasible"


@pytest.mark.slow
def test_a_solver_of_programs_agrees_on_chains():
    for model in (chain(3), chain(3, twins=2, others=1), clusters(2, 2)):
        best = ct.solve(model, "highs", isolate=False).primal_bound
        assert answered(model).primal_bound == pytest.approx(best, rel=1e-9)


def test_without_room_for_the_arcs_the_walk_is_the_bound(monkeypatch):
    model = chain(6)
    walk = answered(replace(model, revisits=True)).primal_bound
    monkeypatch.setattr(arcs_of, "MOST_NUMBERS", 10)
    answer = answered(model)
    assert answer.termination == "no_solution" and answer.limit is None
    assert answer.dual_bound == walk
    assert "visits points twice" in answer.message


def spare_aside():
    """Return a model whose spare hub lies aside, so that no simple route is within 2 % of the walk."""
    points = [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, -0.08, 0], [2.2, 0, 0]]
    kinds = ["A", "horizontal", "vertical", "horizontal", "B"]
    return ErrorCorrectionRouting(points, kinds, 1.6, 1.6, 1.6, 1.6, 1.79, delta=1.0)


def test_a_route_much_longer_than_the_walk_is_the_second_search():
    model = spare_aside()
    walk = answered(replace(model, revisits=True))
    answer = answered(model)
    assert len(set(walk.point.route)) < len(walk.point.route)
    assert answer.primal_bound == pytest.approx(shortest_length(model), rel=1e-12)
    assert answer.primal_bound > 1.02 * walk.primal_bound


def test_a_second_search_without_room_proves_nothing_beyond_the_first(monkeypatch):
    find, limits = ResourceLabelling.find, []

    def find_once(self, problem, cutoff, *rest):
        limits.append(cutoff)
        if len(limits) > 1:
            raise UnsupportedFormulation("no room")
        return find(self, problem, cutoff, *rest)

    monkeypatch.setattr(ResourceLabelling, "find", find_once)
    answer = answered(spare_aside())
    assert limits[1] == math.inf
    assert answer.termination == "no_solution" and answer.dual_bound == limits[0]


@pytest.mark.parametrize("single", [(23,), tuple(range(20, 24)), tuple(range(24))])
@pytest.mark.parametrize("wide", [2.1, 4.1])
def test_that_a_chain_has_no_simple_route_is_proven(single, wide):
    """Clusters with a single hub, which a walk visits twice; the others offer choices before."""
    model = chain(24, wide=wide, single=single)
    answer = answered(model)
    assert answer.termination in ("optimal", "infeasible")
    assert answer.statistics["labels made"] <= 50_000
    assert answered(replace(model, revisits=True)).termination == "optimal"


@pytest.mark.parametrize(
    "seeds",
    [
        QUICK,
        pytest.param(LONG, marks=pytest.mark.slow),
        *(
            pytest.param(range(first, first + 100), marks=pytest.mark.slow)
            for first in range(180, 2180, 100)
        ),
    ],
)
def test_wild_instances_equal_brute_force(seeds):
    several = unproven = 0
    for seed in seeds:
        model = wild(seed)
        best = shortest_length(model)
        for name in EXACT[:1] if model.revisits else EXACT:
            answer = answered(model, name)
            if name in PRINTED and answer.termination in ("feasible", "no_solution"):
                unproven += 1
                assert answer.primal_bound is None or answer.primal_bound >= best * (1 - 1e-12)
                assert best is None or answer.dual_bound <= best
            elif best is None:
                assert answer.termination == "infeasible", (seed, name)
            else:
                assert answer.termination == "optimal", (seed, name)
                assert answer.primal_bound == pytest.approx(best, rel=1e-9, abs=1e-12), (seed, name)
            several += answer.statistics["rounds"] > 1
    assert unproven < len(seeds)
    assert several > len(seeds) / 50, "too few instances need more than one round"


@pytest.mark.parametrize("name", EXACT)
def test_a_known_route_bounds_the_search(name):
    model = chain(5) if name == "label-setting" else ct.load("error-correction/4")
    free = answered(model, name)
    told = answered(model, name, free.primal_bound)
    assert told.primal_bound == free.primal_bound
    assert told.termination == "optimal"
    assert told.statistics["labels made"] <= free.statistics["labels made"]
    none = answered(model, name, 0.99 * free.primal_bound)
    assert none.termination == "no_solution" and none.dual_bound == 0.99 * free.primal_bound


def test_walks_to_the_end_equal_a_search_over_exact_states():
    """From any point, left without an error: the shortest walk to B, or none."""
    flag, checked = np.zeros(1, np.int8), 0
    for seed in range(40):
        model = random_small(3 + seed % 6, seed, revisits=True)
        space, grid = laid_out(model)
        _, lengths, _ = lengths_of_walks(space, grid, np.inf, flag)
        for slot, point in enumerate(grid.ids[:-1].tolist()):
            truth = from_state(model, point)
            checked += math.isfinite(truth)
            assert lengths[slot] == pytest.approx(truth, rel=1e-9), (seed, point)
    assert checked > 50


def from_state(model, point):
    """Return the length of the shortest walk to B from `point`, left without an error."""
    open_states, done = {(point, (0.0, 0.0)): 0.0}, set()
    while open_states:
        here, length = min(open_states.items(), key=lambda item: item[1])
        del open_states[here]
        if here[0] == model.end:
            return length
        done.add(here)
        for head in range(len(model.points)):
            if head in (here[0], model.start):
                continue
            leg = math.dist(model.points[here[0]], model.points[head])
            arrived = [
                error + rate * leg
                for error, rate in zip(
                    here[1], (model.horizontal_rate, model.vertical_rate), strict=True
                )
            ]
            if (np.array(arrived) > model.rounded_limits[model.codes[head]]).any():
                continue
            word = str(model.kinds[head])
            left = (
                0.0 if word == "horizontal" else arrived[0],
                0.0 if word == "vertical" else arrived[1],
            )
            if (head, left) not in done:
                state = (head, left)
                open_states[state] = min(open_states.get(state, math.inf), length + leg)
    return math.inf


@pytest.mark.parametrize("forward", [False, True])
def test_unsettled_lengths_are_bounded(forward):
    """However early the search ends: no bound above the way, and none that falls too fast."""
    model = wall(300, "two")
    space, grid = laid_out(model)
    flag = np.zeros(1, np.int8)
    full = remaining(space, grid, forward, 10**9, flag)
    line = distances_to(grid, len(grid.x) - (2 if forward else 1))
    points = model.points[grid.ids]
    legs = np.linalg.norm(points[:, None] - points, axis=2)
    last = line
    for arcs in (0, 300, 3000, 10**9):
        part = remaining(space, grid, forward, arcs, flag)
        assert (part <= full).all() and (part >= np.minimum(last, full) - 1e-9).all()
        known = np.isfinite(part)
        falls = part[known][:, None] - part[known]
        usable = legs[np.ix_(known, known)] <= 18e3
        assert (falls[usable] <= legs[np.ix_(known, known)][usable] + 1e-6).all()
        last = part


@pytest.mark.parametrize("count", [1500, pytest.param(2500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("shape", ["one", "two", "pocket"])
def test_remaining_lengths_equal_those_over_all_arcs(shape, count):
    """Cells that a former point covers are skipped, and no shorter path is lost."""
    model = replace(wall(count, shape), alpha1=9.0, beta1=13.0, theta=11.0)
    space, grid = laid_out(model)
    flag = np.zeros(1, np.int8)
    points, kinds = model.points[grid.ids], grid.kinds
    legs = np.linalg.norm(points[:, None] - points, axis=2)
    radii = np.array([0.0, *(reach(space, kind) for kind in (1, 2, 3))])
    allowed = legs <= radii[kinds]  # the limits are those of the head
    allowed[-1], allowed[:, -2] = False, False
    arcs = csr_array(np.where(allowed, legs, 0.0))
    for forward, root, network in ((True, -2, arcs), (False, -1, arcs.T)):
        known = dijkstra(network, indices=len(points) + root)
        np.testing.assert_allclose(remaining(space, grid, forward, 10**9, flag), known, rtol=1e-12)
        assert np.isfinite(known).sum() > 0.4 * count


def test_no_points_and_one_point():
    for inner in ([], [[1, 0, 0]], [[1, 0, 0]] * 3):
        model = ErrorCorrectionRouting(
            [[0, 0, 0], *inner, [2, 0, 0]],
            ["A", *["horizontal"] * len(inner), "B"],
            1.5, 1.5, 1.5, 1.5, 1.5, delta=1.0,
        )  # fmt: skip
        for name in EXACT:
            assert answered(model, name).termination == "infeasible"
        wide = replace(model, theta=2.0)
        assert {answered(wide, name).primal_bound for name in EXACT} == {2.0}
