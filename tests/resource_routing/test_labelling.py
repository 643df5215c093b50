"""The native search for routes with resources: exact, with and without revisits, and what it proves."""

import math

import numpy as np
import pytest
from resource_draws import least_length, random_branches, random_model, rng_of

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.instances.error_correction.generator import random_small
from crosstrack.models import Resource, ResourceRouting
from crosstrack.solvers import Control, Limit, Request
from crosstrack.solvers.resource_routing import network
from crosstrack.solvers.resource_routing.labelling import ResourceLabelling

NAME = "resource-labelling"


@pytest.mark.parametrize(("seeds", "few"), [(60, 1), pytest.param(90, 3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("draw", [random_model, random_branches])
@pytest.mark.parametrize("revisits", [False, True])
def test_labelling_finds_the_shortest_route(draw, revisits, seeds, few):
    """Models have ties, lengths of zero, dead ends, and resources that nothing limits."""
    routes = critical = 0
    for seed in range(seeds):
        model = draw(rng_of(seed), revisits=revisits)
        wanted = least_length(model)
        found = ct.solve(model, NAME)
        assert found.termination == ("optimal" if wanted < math.inf else "infeasible"), seed
        if wanted < math.inf:
            routes += 1
            assert found.primal_bound == found.dual_bound == wanted, seed
        critical += found.statistics["critical points"] > 0
    assert 0.48 * seeds < routes < seeds
    if draw is random_branches:
        assert (critical > few) is not revisits


# -- what a search proves ------------------------------------------------------------------------


def grid(size=12, seed=1):
    """A grid whose short arcs use much of the first resource, with wells that reset both."""
    draw = np.random.default_rng(seed)
    places = [(i, j) for i in range(size) for j in range(size)]
    arcs = [
        (size * i + j, size * (i + a) + j + b)
        for i, j in places
        for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))
        if 0 <= i + a < size and 0 <= j + b < size
    ]
    lengths = draw.integers(1, 20, len(arcs))
    uses = np.column_stack([21 - lengths, draw.integers(1, 20, len(arcs))])
    kinds = np.where(draw.random(size**2) < 0.1, "well", "stop")
    kinds[[0, -1]] = "stop"
    resources = [
        Resource(name, limits={"stop": 100, "well": 100}, resets={"well": 0}) for name in ("r", "s")
    ]
    return ResourceRouting(
        kinds.tolist(), resources, 0, size**2 - 1, arcs=arcs, lengths=lengths, uses=uses
    )


def test_a_plan_is_a_cutoff():
    model = grid()
    best = ct.solve(model, NAME)
    assert best.termination == "optimal"
    again = ct.solve(model, NAME, warm_start=best)
    assert again.primal_bound == again.dual_bound == best.primal_bound
    assert again.statistics["labels made"] < best.statistics["labels made"]
    # Below the optimum nothing is found, which proves the cutoff and no more.
    answer = ResourceLabelling().run(model, Request(cutoff=best.primal_bound - 1))
    assert answer.termination == "no_solution"
    assert answer.dual_bound == best.primal_bound - 1
    assert answer.point is None


def stopped(model):
    """Return the answer of a search that is stopped before it begins."""
    control = Control()
    control.stop(Limit.TIME)
    return ResourceLabelling().run(model, Request(control=control))


@pytest.mark.parametrize("listed", [False, True])
def test_an_interrupted_search_returns_a_valid_bound(listed):
    model = grid()
    if not listed:
        points = np.random.default_rng(1).uniform(0, 1, (300, 2))
        air = Resource("air", 1.0, limits={"stop": 0.3}, resets={"stop": 0})
        model = ResourceRouting(["stop"] * 300, [air], 0, 1, points=points)
    best = ct.solve(model, NAME)
    assert best.termination == "optimal"
    answer = stopped(model)
    assert answer.termination == "no_solution"
    assert answer.limit == Limit.TIME
    assert answer.point is None
    assert (listed or answer.dual_bound > 0) and answer.dual_bound <= best.primal_bound
    for seconds in (1e-6, 1e-4, 1e-3, 3e-3, 1e-2):
        found = ct.solve(model, NAME, time_limit=seconds)
        assert found.termination in ("no_solution", "feasible", "optimal")
        assert found.dual_bound is None or found.dual_bound <= best.primal_bound


@pytest.mark.parametrize("cutoff", [0.0, 1.0, 4.9, 5.0, 14.0, 15.0])
def test_a_cutoff_below_the_straight_line(cutoff):
    points = [[0, 0], [3, 4], [6, 0], [6, 8], [9, 12]]
    model = ResourceRouting(["stop"] * 5, [], 0, 4, points=points)
    answer = ResourceLabelling().run(model, Request(cutoff=cutoff))
    if cutoff < 15:
        assert (answer.termination, answer.dual_bound) == ("no_solution", cutoff)
    else:
        assert (answer.termination, answer.primal_bound) == ("optimal", 15.0)


def test_more_arcs_than_memory_holds_are_refused(monkeypatch):
    monkeypatch.setattr(network, "MOST_NUMBERS", 100)
    model = ResourceRouting(["stop"] * 30, [], 0, 29, points=np.zeros((30, 2)))
    with pytest.raises(UnsupportedFormulation, match="30 points leave more than 50 arcs"):
        ct.solve(model, NAME)


def test_the_error_correction_problem_is_a_case():
    """Both searches agree on it, and a limit on the corrections leads here by itself."""
    for seed in range(8):
        model = random_small(3 + seed % 6, seed, revisits=bool(seed % 2))
        one, other = ct.solve(model, "label-setting"), ct.solve(model, NAME)
        assert one.termination == other.termination
        if one.plan is not None:
            assert one.primal_bound == pytest.approx(other.primal_bound, rel=1e-12)
            limited = ct.solve(model.limited("corrections", one.plan.corrections))
            assert limited.backend == NAME
            assert limited.primal_bound == pytest.approx(one.primal_bound, rel=1e-12)


# -- strange data --------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1.0, 1e150, 1e300])
@pytest.mark.parametrize("listed", [False, True])
def test_lengths_of_any_size(scale, listed):
    points = np.array([[0, 0], [3, 4], [6, 0], [6, 8], [9, 12]]) * scale
    fuel = Resource("fuel", rate=1.0, limits={"stop": 11 * scale}, resets={"stop": 0})
    arcs = [(i, j) for i in range(5) for j in range(5) if i != j] if listed else None
    found = ct.solve(ResourceRouting(["stop"] * 5, [fuel], 0, 4, points=points, arcs=arcs), NAME)
    assert found.plan.route in ((0, 1, 4), (0, 3, 4))
    assert found.primal_bound == pytest.approx(15 * scale)


@pytest.mark.parametrize("revisits", [False, True])
def test_points_at_one_place(revisits):
    """Ways of length zero in circles, which use nothing or something."""
    kinds = ["stop"] * 6 + ["well"] * 6
    for gains in ({}, {"stop": 1, "well": 1}):
        air = Resource("air", 1.0, limits={"stop": 3, "well": 3}, gains=gains, resets={"well": 0})
        model = ResourceRouting(kinds, [air], 0, 5, points=np.zeros((12, 1)), revisits=revisits)
        found = ct.solve(model, NAME)
        assert found.plan.route == (0, 5)
        assert found.primal_bound == 0.0
    none = Resource("air", 1.0, limits={"stop": 0, "well": 0}, gains={"stop": 1, "well": 1})
    model = ResourceRouting(kinds, [none], 0, 5, points=np.zeros((12, 1)), revisits=revisits)
    assert ct.solve(model, NAME).termination == "infeasible"


def test_neither_resources_nor_arcs():
    model = ResourceRouting(["stop"] * 3, [], 0, 2, points=[[0], [1], [2]])
    assert ct.solve(model, NAME).plan.route == (0, 2)
    none = np.zeros((0, 2), int)
    model = ResourceRouting(["stop"] * 3, [], 0, 2, arcs=none, lengths=[])
    assert ct.solve(model, NAME).termination == "infeasible"


# -- many ways without revisits ------------------------------------------------------------------


def chain(links, *, back):
    """Each link is entered by one of two hubs and left by the other, after the well between them.

    Which hub comes first is a choice at every link: 2^links sets of visited hubs. A walk would enter
    and leave by one hub; with `back` there are ways to the link before as well.
    """
    draw = np.random.default_rng(links)
    kinds, arcs, before = ["depot"], [], [0]
    for link in range(links):
        one, other, well = range(3 * link + 1, 3 * link + 4)
        kinds += ["hub", "hub", "well"]
        for hub in (one, other):
            arcs += [(last, hub) for last in before] + [(hub, well), (well, hub)]
            arcs += [(hub, last) for last in before if back and last]
        before = [one, other]
    kinds.append("depot")
    arcs += [(last, 3 * links + 1) for last in before]
    air = Resource("air", rate=1.0, limits=dict.fromkeys(kinds, 3.2), resets={"well": 0})
    lengths = [
        (0.5 if "well" in (kinds[i], kinds[j]) else 1) + 0.3 * draw.random() for i, j in arcs
    ]
    return ResourceRouting(kinds, [air], 0, 3 * links + 1, arcs=arcs, lengths=lengths)


@pytest.mark.parametrize("back", [False, True])
def test_labels_ignore_unreachable_critical_points(back):
    assert ct.solve(chain(2, back=back), NAME).primal_bound == pytest.approx(
        least_length(chain(2, back=back))
    )
    found = ct.solve(chain(16, back=back), NAME)
    assert found.termination == "optimal"
    assert found.statistics["critical points"] > 3
    assert found.statistics["labels made"] < 10_000 < 2**16
