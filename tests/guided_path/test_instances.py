"""Instances of guided path tours: generators, the catalogue, supersequences."""

import hashlib
import heapq
import itertools

import numpy as np
import pytest
from guided_path.enumerated import best, random_tour
from hypothesis import given, settings, strategies as st

from crosstrack.errors import InvalidData
from crosstrack.instances import entries, entry
from crosstrack.instances.guided_path import (
    generate,
    generate_relation,
    supersequence_of,
    supersequence_tour,
)
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan

OURS = [one for one in entries() if one.name.startswith("guided-path/")]


# -- the generators and the catalogue ------------------------------------------------------------


def test_a_seed_yields_the_same_tour():
    one = generate(10, 5, 1)
    assert one.digest == generate(10, 5, 1).digest != generate(10, 5, 2).digest
    assert one.chains == tuple(tuple(range(5 * k + 1, 5 * k + 6)) for k in range(10))
    assert hashlib.sha256(one.coordinates.tobytes()).hexdigest()[:16] == "b2a4fa3ccdff2832"
    many = generate(50, 100, 3, -2, 2, name="many")
    values, counts = np.unique(many.coordinates[1:], return_counts=True)
    assert (many.name, many.size, many.coordinates[0]) == ("many", 5001, 0)
    assert values.tolist() == [-2, -1, 0, 1, 2]
    assert counts.min() > 900
    assert set(generate(3, 3, 1, 7, 7).coordinates[1:]) == {7}


def test_a_random_relation_has_the_given_density():
    some = generate_relation(60, 0.25, 1, -5, 5)
    assert len(some.precedence) == pytest.approx(0.25 * 60 * 59 / 2, rel=0.2)
    assert (some.precedence[:, 0] < some.precedence[:, 1]).all()
    assert len(generate_relation(9, 1.0, 1).cover) == 1
    assert len(generate_relation(9, 0.0, 1).cover) == 9
    assert generate_relation(1, 0.5, 1).size == 2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: generate(0, 5, 1), "chains must be >= 1"),
        (lambda: generate(10, 2001, 1), "length must be <= 2000"),
        (lambda: generate(2, 0, 1), "length must be >= 1"),
        (lambda: generate(2, 2, -1), "seed must be >= 0"),
        (lambda: generate(2, 2, 1, 5, 4), "lowest must be <= highest, 4, got 5"),
        (lambda: generate(2, 2, 1, 0, 10**12), "highest must be <="),
        (lambda: generate(2, 2, 1, 0.5, 4), "lowest must be a whole number"),
        (lambda: generate_relation(0, 0.5, 1), "customers must be >= 1"),
        (lambda: generate_relation(4, 1.5, 1), "density must be <= 1"),
    ],
)
def test_the_generators_reject_bad_arguments(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


def test_catalogue_titles_match_their_models():
    models = {one.name.partition("/")[2]: one.build() for one in OURS}
    assert len({model.digest for model in models.values()}) == len(OURS) >= 25
    for k in range(1, 11):
        model, one = models[f"table-1-k{k}"], entry(f"guided-path/table-1-k{k}")
        assert [len(chain) for chain in model.chains] == [5] * k
        assert model.coordinates[0] == 0
        assert ((model.coordinates[1:] >= 1) & (model.coordinates[1:] <= 200)).all()
        assert (model.coordinates == np.round(model.coordinates)).all()
        assert one.provenance == "seeded"
        assert "prints no coordinates" in one.note
    assert {len(chain) for chain in models["hard-20x20"].chains} == {20}
    assert len(models["one-chain-300"].chains[0]) == 300
    assert len(models["singles-100"].cover) == 100
    for name in ("hard-20x20", "hard-10x30"):
        assert "Hard: do not expect a proof" in entry(f"guided-path/{name}").note
    for name in ("relation-12", "relation-30"):
        assert not models[name].chains
    assert (models["far"].coordinates[1:] >= 1e9).all()
    assert models["negative"].coordinates.min() < 0 < models["negative"].coordinates.max()


def shortest(model):
    """Return the least length of a tour of chains, by Dijkstra over the customers served per chain."""
    places, chains = model.coordinates.tolist(), list(model.cover)
    assert model.closure.sum() == sum(len(c) * (len(c) - 1) // 2 for c in chains)
    full = tuple(map(len, chains))
    queue, done = [(0.0, places[0], (0,) * len(chains))], set()
    while queue:
        length, at, counts = heapq.heappop(queue)
        if counts == full and at == places[0]:
            return length
        if (at, counts) in done:
            continue
        done.add((at, counts))
        heapq.heappush(queue, (length + abs(at - places[0]), places[0], counts))
        for k, (chain, count) in enumerate(zip(chains, counts, strict=True)):
            if count < len(chain):
                there = places[chain[count]]
                more = (*counts[:k], count + 1, *counts[k + 1 :])
                heapq.heappush(queue, (length + abs(there - at), there, more))
    return None


@pytest.mark.parametrize("name", ["example-5", "all-at-0", "one"])
def test_published_optima(name):
    one = entry(f"guided-path/{name}")
    assert shortest(one.build()) == one.published["optimum"]


def test_the_plain_search_of_these_tests_finds_the_best_order():
    for seed in range(40):
        model = random_tour(seed, most=5, relation="chains")
        assert shortest(model) == pytest.approx(best(model), rel=1e-12, abs=1e-12)


# -- supersequences ------------------------------------------------------------------------------


def supersequence_length(words):
    """Return the length of the shortest common supersequence, by layers of positions in the words."""
    layer, end = {(0,) * len(words)}, tuple(map(len, words))
    for length in itertools.count():
        if end in layer:
            return length
        layer = {
            tuple(p + (word[p : p + 1] == x) for p, word in zip(at, words, strict=True))
            for at in layer
            for x in "ab"
        }
    return None


def holds(word, part):
    letters = iter(word)
    return all(letter in letters for letter in part)


WORDS = st.lists(st.text("ab", max_size=4), min_size=1, max_size=3)


@settings(max_examples=25, deadline=None)
@given(words=WORDS)
def test_the_shortest_tour_is_the_shortest_supersequence(words):
    model = supersequence_tour(words)
    assert shortest(model) == 2 * supersequence_length(words) + 4


def test_the_supersequence_of_the_catalogue():
    one = entry("guided-path/supersequence")
    words = one.title.partition(" of ")[2].split(", ")
    assert supersequence_tour(words).digest == one.build().digest
    assert one.published["optimum"] == 2 * supersequence_length(words) + 4
    assert "such as bababab" in one.note
    assert len("bababab") == supersequence_length(words)
    assert all(holds("bababab", word) for word in words)


@settings(max_examples=60, deadline=None)
@given(words=WORDS, choice=st.randoms(use_true_random=False))
def test_any_tour_spells_a_supersequence_of_its_own_length(words, choice):
    model = supersequence_tour(words)
    left = [list(chain) for chain in model.chains]
    order = []
    while any(left):
        order.append(choice.choice([chain for chain in left if chain]).pop(0))
    plan = GuidedPathPlan(order)
    word = supersequence_of(model, plan)
    assert all(holds(word, part) for part in words)
    assert model.verify(plan).objective == 2 * len(word) + 4


def test_rejects_words_of_other_letters():
    model = supersequence_tour(["01", "10"], "01", name="bits")
    assert (model.name, shortest(model)) == ("bits", 10)
    found = supersequence_of(model, GuidedPathPlan([1, 2, 3, 6, 7, 4, 8, 5, 9, 10]), "01")
    assert found == "010"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: supersequence_tour([]), "words must be a list of some words"),
        (lambda: supersequence_tour("ab"), "words must be a list of some words, got 'ab'"),
        (
            lambda: supersequence_tour(["ab", "abc"]),
            r"words\[1\] must consist of the letters 'a' and 'b', got 'abc'",
        ),
        (lambda: supersequence_tour(["ab", 3]), r"words\[1\] must consist"),
        (lambda: supersequence_tour(["a"], "aa"), "letters must be two different ones"),
        (lambda: supersequence_tour(["a"], "abc"), "letters must be two different ones"),
        (
            lambda: supersequence_of(supersequence_tour(["a"]), GuidedPathPlan([2, 1, 3])),
            "plan must be valid, it breaks: precedence",
        ),
        (
            lambda: supersequence_of(GuidedPathTour([0, 4]), GuidedPathPlan([1])),
            "coordinates must be those of a supersequence.* got 4",
        ),
    ],
)
def test_rejects_tours_that_are_not_supersequences(call, message):
    with pytest.raises(InvalidData, match=message):
        call()
