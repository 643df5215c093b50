"""a-star: equality with enumeration and a plain search, valid bounds, and limits."""

from dataclasses import replace

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, random_tour, tours
from guided_path.searched import settled, shortest, solve
from hypothesis import given, settings

from crosstrack.models import GuidedPathTour
from crosstrack.solvers.contract.backend import Control, Limit, Request, Termination
from crosstrack.solvers.guided_path import a_star
from crosstrack.solvers.guided_path.insertion import InsertIndex

# -- against enumeration -------------------------------------------------------------------------


@pytest.mark.parametrize("seeds", np.split(np.arange(300), 6), ids=lambda some: f"{some[0]}")
def test_equals_enumeration(seeds):
    for seed in seeds.tolist():
        model = random_tour(seed)
        settled(model, best(model))


@pytest.mark.slow
def test_equals_enumeration_often():
    for seed in range(1000, 4000):
        model = random_tour(seed, most=7)
        settled(model, best(model))


@settings(max_examples=60, deadline=None)
@given(tours(5))
def test_equals_enumeration_on_generated_tours(model):
    value = best(model)
    answer = solve(model)
    assert answer.termination is Termination.OPTIMAL
    # Coordinates of 1e9 leave a precision of 1e-7.
    scale = max(value, float(np.abs(model.coordinates).max()))
    assert abs(answer.primal_bound - value) <= 1e-9 * value + 1e-14 * scale
    assert answer.dual_bound <= value + 1e-14 * scale


@pytest.mark.parametrize("seed", range(24))
def test_equals_a_plain_search(seed):
    rng = np.random.default_rng(seed)
    model = random_tour(seed, 14, relation=rng.choice(["chains", "dag", "both"]))
    settled(model, shortest(model))


@pytest.mark.parametrize("seed", range(4))
def test_equals_a_plain_search_on_chains(seed):
    model = chains_tour(4, 4, seed)
    settled(model, shortest(model))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 200))
def test_equals_a_plain_search_often(seed):
    test_equals_a_plain_search(seed)
    test_equals_a_plain_search_on_chains(seed)


# -- cases wilder than the paper's -----------------------------------------------------------------


def test_one_chain_has_one_order():
    rng = np.random.default_rng(1)
    model = GuidedPathTour(rng.normal(size=301) * 1e6, chains=[rng.permutation(300) + 1])
    stops = model.coordinates[[0, *model.chains[0], 0]]
    answer = settled(model, float(np.abs(np.diff(stops)).sum()))
    assert answer.statistics["states"] == 0, "the beam proves it"


def test_customers_without_a_relation():
    model = chains_tour(100, 1, 2, far=-50)
    settled(model, 2.0 * float(np.ptp(model.coordinates)))


@pytest.mark.parametrize("far", [0.0, -7.0, 1e9])
def test_customers_at_the_start_cost_nothing(far):
    model = GuidedPathTour([far] * 9, chains=[[3, 1, 2], [5, 4]], precedence=[[3, 8], [8, 4]])
    assert solve(model).primal_bound == 0.0
    assert solve(model).termination is Termination.OPTIMAL


@pytest.mark.parametrize(
    ("scale", "far"),
    [(1.0, 1e9), (1.0, -1e9), (1e-300, 0.0), (1e290, 0.0), (1 / 3, 0.0), (0.1, 0.3), (-1.0, 100.0)],
)
def test_the_same_in_other_units_and_elsewhere(scale, far):
    model = chains_tour(6, 4, 3)
    value = solve(model).primal_bound
    moved = replace(model, coordinates=model.coordinates * scale + far)
    answer = settled(moved, abs(scale) * value)
    rounding = 1e-9 * abs(scale) * value + 1e-6 * (abs(far) > 1e6)
    assert abs(answer.primal_bound - abs(scale) * value) <= rounding


def test_ratios_of_a_million():
    rng = np.random.default_rng(5)
    places = np.concatenate((rng.random(6) * 1e-3, rng.random(6) * 1e3, [0.0]))
    model = GuidedPathTour(places, chains=rng.permutation(np.arange(1, 13)).reshape(3, 4))
    settled(model, shortest(model))


@pytest.fixture
def cramped(monkeypatch):
    """Use the narrowest beam only, small capacity, few buckets and short chunks."""
    for name, value in {"FEW": 2, "CHUNK": 7, "BUCKETS": 3, "NARROW": 1, "WIDEST": 1}.items():
        monkeypatch.setattr(a_star, name, value)


@pytest.mark.parametrize("seed", range(6))
def test_room_and_chunks_make_no_difference(cramped, seed):
    """The table grows, buckets contain several bounds, and states are expanded again."""
    model = chains_tour(4, 4, seed)
    answer = settled(model, shortest(model))
    assert answer.statistics["beam width"] == 1
    floats = replace(model, coordinates=np.sin(model.coordinates) * 1e3)
    settled(floats, shortest(floats))


@pytest.mark.parametrize("seed", range(30))
def test_shares_make_no_difference(cramped, monkeypatch, seed):
    """The search restarts with the shares of the chains, for any relation and any coordinates."""
    monkeypatch.setattr(a_star, "EARLY", 1)
    model = random_tour(seed, 10, relation=["chains", "dag", "both"][seed % 3])
    settled(model, shortest(model))


def test_search_and_beam_agree(cramped, monkeypatch):
    models = [chains_tour(8, 5, seed) for seed in range(6)]
    searched = [solve(model) for model in models]
    monkeypatch.setattr(a_star, "WIDEST", 5000)
    monkeypatch.setattr(a_star, "NARROW", 5000)
    for model, answer in zip(models, searched, strict=True):
        proven = solve(model)
        assert proven.statistics["expanded"] == 0, "the beam left nothing out"
        assert answer.primal_bound == proven.primal_bound
        assert answer.termination is Termination.OPTIMAL
    assert max(answer.statistics["expanded"] for answer in searched) > 60


# -- limits ----------------------------------------------------------------------------------------


def test_few_states_leave_a_bound():
    for seed in range(6):
        model = chains_tour(6, 5, seed)
        value = solve(model).primal_bound
        for states in (1, 50):
            answer = solve(model, states=states)
            assert answer.dual_bound <= value <= answer.primal_bound
            assert answer.statistics["states"] <= max(states, 1)
            assert answer.dual_bound >= answer.statistics["bound at the start"] > 0.0


def test_wider_beams_use_what_time_is_left(monkeypatch):
    monkeypatch.setattr(a_star, "WIDEST", 100)
    model = chains_tour(12, 16, 1)
    answer = solve(model, states=100)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.MEMORY)
    assert answer.statistics["beam width"] == 100
    assert 0.0 < answer.statistics["bound at the start"] <= answer.dual_bound < answer.primal_bound


def test_a_stop_keeps_the_plan():
    control = Control()
    control.stop(Limit.INTERRUPTED)
    answer = solve(chains_tour(12, 8, 1), control=control)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.INTERRUPTED)
    assert answer.dual_bound == 0.0


def test_the_time_limit_is_respected():
    control = Control()
    control.arm(0.2)
    answer = solve(chains_tour(20, 20, 1), control=control, time_limit=0.2)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.TIME)


def test_ends_at_the_requested_gap():
    model = chains_tour(10, 8, 3)
    answer = solve(model, gap=0.5)
    assert answer.termination is Termination.OPTIMAL
    assert answer.dual_bound >= 0.5 * answer.primal_bound
    assert answer.statistics["expanded"] == 0


def test_a_start_is_kept():
    model = chains_tour(10, 8, 3)
    good = solve(model, states=1)
    control = Control()
    control.stop(Limit.INTERRUPTED)
    again = solve(model, control=control, warm_start=good.point)
    assert again.primal_bound == good.primal_bound
    assert again.point == good.point


def test_incumbents_get_better_and_runs_are_the_same():
    model = chains_tour(12, 6, 2)
    runs = []
    for _ in range(2):
        control = Control()
        answer = solve(model, control=control, states=3000)
        seen = []
        while not control.events.empty():
            seen.append(control.events.get()[1])
        assert seen == sorted(seen, reverse=True)
        assert seen[-1] == answer.primal_bound
        runs.append((seen, answer.point, answer.dual_bound, dict(answer.statistics)))
    assert runs[0] == runs[1]


def test_a_large_relation_is_no_worse_than_merged_chains():
    rng = np.random.default_rng(1)
    first, second = np.sort(rng.integers(1, 901, (2, 1800)), axis=0)
    pairs = np.column_stack([first, second])[first < second]
    model = GuidedPathTour(np.append(0, rng.integers(-(10**9), 10**9, 900)), precedence=pairs)
    merged = InsertIndex().run(model, Request(options={"passing": True}))
    answer = solve(model, states=1, time_limit=0.4)
    assert answer.primal_bound <= merged.primal_bound
    assert 0.0 < answer.dual_bound <= answer.primal_bound
