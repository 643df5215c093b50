"""Searches by ask and tell."""

import gc
import math
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from black_box.searches import EVERY, box, search

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import BlackBoxMinimisation, Model
from crosstrack.solvers import Control, find_backend
from crosstrack.solvers.black_box.quiet import quiet

SQUARE = ((-1, 2), (-1, 2))
EMPTY = BlackBoxMinimisation(None, SQUARE, budget=40)
WAVY = {"name": "rastrigin", "shift": [0.4, -0.2]}


def wavy(x):
    return box(WAVY, *SQUARE).function.values(x)


def conduct(asking, function=wavy, generator=None):
    """Tell values until the end, in parts and any order if there is a generator."""
    points = []
    while not asking.done:
        xs = asking.ask()
        assert len(xs)
        if generator is not None:
            xs = generator.permutation(xs)[: generator.integers(1, len(xs) + 1)]
        asking.tell(xs, function(xs))
        points += xs.tolist()
    return points


@pytest.mark.parametrize("name", EVERY)
def test_ask_and_tell_gives_the_plan_of_a_run(name):
    model = box(WAVY, *SQUARE, budget=40)
    answer, oracle = search(name, model, seed=3)
    for generator in (None, np.random.default_rng(1)):
        with ct.prepare(
            EMPTY, name, **({} if name in ("direct", "shgo") else {"seed": 3})
        ) as asking:
            points = conduct(asking, generator=generator)
            assert len(asking.ask()) == 0
        assert sorted(points) == sorted(oracle.points)
        assert asking.best == answer.point and asking.value == answer.primal_bound
        assert "limit: evaluations" in asking.message
        assert model.verify(asking.best).objective == asking.value


@pytest.mark.parametrize("name", EVERY)
def test_ask_and_tell_gives_the_plan_of_a_run_with_constraints(name):
    def function(x):
        return [float(((x - 0.3) ** 2).sum()), 0.4 - x[0]]

    fields = {"inequalities": 1, "budget": 22}
    with ct.prepare(BlackBoxMinimisation(None, SQUARE, **fields), name, seed=1) as asking:
        conduct(asking, lambda xs: [function(x) for x in xs])
    answer = ct.solve(box(function, *SQUARE, **fields), name, seed=1)
    assert asking.best == answer.plan and asking.value == answer.primal_bound


def test_a_generation_is_asked_for_at_once():
    with ct.prepare(EMPTY, "random-search", seed=1) as asking:
        assert asking.ask().shape == (40, 2) and asking.best is None and asking.value == math.inf
        xs = asking.ask()
        asking.tell(xs[5], wavy(xs[5:6]))
        np.testing.assert_array_equal(asking.ask(), np.delete(xs, 5, axis=0))
        assert not asking.done


def test_options_of_a_search_by_ask_and_tell():
    with ct.prepare(EMPTY, "random-search", seed=1, evaluations=9) as asking:
        assert len(conduct(asking)) == 9
    with ct.prepare(EMPTY, "differential-evolution", seed=1, target=20.0) as asking:
        points = conduct(asking)
        assert len(points) < 40 and asking.value <= 20 and "limit: target" in asking.message
    with ct.prepare(EMPTY, "random-search", warm_start={"x": [0.4, -0.2]}) as asking:
        np.testing.assert_array_equal(asking.ask(), [[0.4, -0.2]])
        conduct(asking)
        assert asking.best.x == (0.4, -0.2) and asking.value == 0.0
    own = {"population": 4}
    with ct.prepare(EMPTY, "differential-evolution", backend_options=own) as asking:
        assert len(asking.ask()) == 5
    with ct.prepare(EMPTY, limits=ct.Limits(seed=2)) as asking:
        assert len(conduct(asking)) == 40


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"time_limit": 3}, UnsupportedOption, "does not support time_limit=3; supported: seed, evaluations"),
        ({"tolerance": 1e-3}, UnsupportedOption, "does not support tolerance"),
        ({"seed": -1}, UnsupportedOption, "seed must be a whole number >= 0, got -1"),
        ({"seeds": 1}, TypeError, "unexpected keyword argument 'seeds'; did you mean 'seed'"),
        ({"backend": "cmaes"}, UnknownName, "cma-es"),
        ({"backend": "highs"}, UnsupportedFormulation, "cannot solve model 'black-box'"),
        ({"backend_options": {"size": 1}}, UnsupportedOption, "size"),
        ({"warm_start": {"x": [1]}}, InvalidData, "warm_start must be a point of the 2 variables"),
        ({"warm_start": {"x": [1, 3]}}, InvalidData, r"within their bounds, got \[1.0, 3.0\]"),
        ({"warm_start": {"y": [1]}}, InvalidData, "unknown key 'y'"),
    ],
)  # fmt: skip
def test_rejects_unsuitable_options(options, error, message):
    with pytest.raises(error, match=message):
        ct.prepare(EMPTY, **{"backend": "random-search", **options})


def test_a_search_that_does_not_support_the_model_is_refused():
    many = BlackBoxMinimisation(None, [[0, 1]] * 11)
    with pytest.raises(UnsupportedFormulation, match="'shgo': it takes at most 10 variables"):
        ct.prepare(many, "shgo")


@pytest.mark.parametrize(
    ("xs", "values", "message", "field"),
    [
        ([[0.5, 0.5]], [1.0], r"xs\[0\] must be a point from ask\(\) without a value, got \[0.5, 0.5\]", "xs"),
        ([[0.5, 0.5, 0.5]], [1.0], r"xs must have shape \(k, 2\), got \(1, 3\)", "xs"),
        ([[[0.5, 0.5]]], [1.0], r"xs must have shape \(k, 2\), got \(1, 1, 2\)", "xs"),
        (None, [1.0], r"values must have shape \(4, 1\), got \(1,\)", "values"),
        (None, [[1.0, 2.0, 3.0, 4.0]], r"values must have shape \(4, 1\), got \(1, 4\)", "values"),
        (None, 1.0, r"values must have shape \(4, 1\), got \(\)", "values"),
        (None, ["1"] * 4, "values must be an array of numbers, got", "values"),
        (None, [None] * 4, "values must be an array of numbers, got", "values"),
        ([[1, 2], [3]], [1.0], "xs must be an array of numbers, got", "xs"),
    ],
)  # fmt: skip
def test_rejects_unsuitable_values_and_keeps_the_state(xs, values, message, field):
    with ct.prepare(EMPTY, "random-search", evaluations=4) as asking:
        points = asking.ask()
        with pytest.raises(InvalidData, match=message) as caught:
            asking.tell(points if xs is None else xs, values)
        assert caught.value.field == field
        with pytest.raises(InvalidData, match=r"xs\[2\] must be a point from ask"):
            asking.tell(points[[0, 1, 1]], [1.0, 2.0, 3.0])
        np.testing.assert_array_equal(asking.ask(), points)
        asking.tell(points, [math.nan, 3.0, math.inf, 2.0])
        assert asking.done and asking.best.x == tuple(points[3]) and asking.value == 2.0
        assert "no value at 2 of 4 points" in asking.message
        with pytest.raises(InvalidData, match=r"xs\[0\] must be a point from ask"):
            asking.tell(points, np.ones(4))


def test_points_may_come_back_as_lists_and_with_negative_zeros():
    with ct.prepare(BlackBoxMinimisation(None, [[-1, 1]], budget=3), "direct") as asking:
        assert asking.ask().tolist() == [[0.0]]
        asking.tell([[-0.0]], [[1.0]])
        asking.tell(asking.ask()[0].tolist(), 5)
        asking.tell(asking.ask(), (7,))
        assert asking.done and asking.best.x == (0.0,)


def test_equal_points_of_a_request_have_a_value_each():
    """A rounded generation may contain a point several times."""
    model = BlackBoxMinimisation(None, [[0, 1]], variables=["integer"], budget=40)
    with ct.prepare(model, "random-search", seed=1) as asking:
        xs = asking.ask()
        assert len(xs) == 40 and len(np.unique(xs)) == 2
        asking.tell(xs[:39], np.arange(39.0))
        assert len(asking.ask()) == 1
        with pytest.raises(InvalidData, match=r"xs\[1\] must be a point"):
            asking.tell(xs[[39, 39]], [1.0, 2.0])
        asking.tell(xs[39], -1.0)
        assert asking.done and asking.value == -1.0


def test_a_closed_search_keeps_its_best_point():
    asking = ct.prepare(EMPTY, "differential-evolution", seed=1)
    xs = asking.ask()
    asking.tell(xs, wavy(xs))
    best = asking.best
    asking.close()
    asking.close()
    assert asking.done and best is not None and asking.best == best
    assert asking.ask().shape == (0, 2)
    with pytest.raises(InvalidData, match="must be a point from ask"):
        asking.tell(xs, wavy(xs))


def test_threads_of_forgotten_searches_end():
    before = threading.active_count()
    for name in ("random-search", "dual-annealing", "direct"):
        asking = ct.prepare(EMPTY, name)
        asking.tell(asking.ask()[:1], [1.0])
    del asking
    gc.collect()
    end = time.perf_counter() + 10
    while threading.active_count() > before and time.perf_counter() < end:
        time.sleep(0.01)
    assert threading.active_count() == before


def test_an_error_of_a_search_is_raised_with_its_name(monkeypatch):
    def broken(self, objective):
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(type(find_backend("random-search")), "search", broken)
    with ct.prepare(EMPTY, "random-search") as asking:
        for call in (asking.ask, lambda: asking.done, lambda: asking.best):
            with pytest.raises(
                ct.CrosstrackError, match="'random-search' failed: ZeroDivisionError"
            ):
                call()


def test_a_model_without_a_function_is_for_ask_and_tell_only():
    text = "function is None: such a model serves ask and tell"
    for call in (
        lambda: ct.solve(EMPTY, "random-search"),
        lambda: ct.solve(EMPTY, "random-search", isolate=True),
        lambda: EMPTY.verify(EMPTY.as_plan({"x": [0, 0]})),
    ):
        with pytest.raises(InvalidData, match=text) as caught:
            call()
        assert caught.value.field == "function"
    again = Model.from_json(EMPTY.to_json())
    assert again == EMPTY and again.digest == EMPTY.digest
    assert EMPTY.digest != box("sphere", *SQUARE, budget=70).digest


def test_warnings_are_suppressed_during_a_search_and_restored(recwarn):
    filters = list(warnings.filters)
    with ThreadPoolExecutor(1) as first, ThreadPoolExecutor(1) as second:
        runs = quiet(), quiet()
        first.submit(runs[0].__enter__).result()
        second.submit(runs[1].__enter__).result()
        first.submit(runs[0].__exit__, None, None, None).result()  # runs overlap
        assert warnings.filters != filters
        second.submit(runs[1].__exit__, None, None, None).result()
    assert list(warnings.filters) == filters

    def warned(x):
        warnings.warn("of the function", stacklevel=1)
        return float(np.array(1.0) / 0.0)

    with pytest.warns((UserWarning, RuntimeWarning)) as caught:
        search("dual-annealing", box(warned, *SQUARE, budget=9), control=Control(), seed=1)
    assert {"of the function", "divide by zero encountered in divide"} <= {
        str(one.message) for one in caught
    }
