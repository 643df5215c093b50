"""Black boxes as models: refused data, counted evaluations, verification, and hidden data."""

import contextlib
import copy
import dataclasses
import gc
import itertools
import json
import math
import sys
from decimal import Decimal
from fractions import Fraction

import cloudpickle
import numpy as np
import pytest
from black_box.searches import box, search

import crosstrack as ct
from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.models import BlackBoxMinimisation, Model
from crosstrack.models.black_box import BlackBoxPoint, PythonFunction
from crosstrack.models.black_box.functions import BlackBoxFunction
from crosstrack.solvers import (
    Answer,
    Backend,
    Control,
    Feature,
    Guarantee,
    Request,
    Termination,
)

cloudpickle.register_pickle_by_value(sys.modules[__name__])

UNIT = ((0, 1), (0, 1))


@pytest.mark.parametrize(
    ("fields", "message", "field"),
    [
        ({"bounds": [[0, 1], [2, 1]]}, r"bounds\[1\] must be .*not reversed.*got \[2.0, 1.0\]", "bounds"),
        ({"bounds": [[0, 1], [math.nan, 1]]}, r"bounds\[1, 0\] must be finite, got nan", "bounds"),
        ({"bounds": [[0, 1], [0, math.inf]]}, r"bounds\[1, 1\] must be finite, got inf", "bounds"),
        ({"bounds": [[-1e308, 1e308], [0, 1]]}, r"bounds\[0\] .*difference that is a number", "bounds"),
        ({"bounds": np.zeros((0, 2))}, "bounds must have 1 … 10000 rows, got 0", "bounds"),
        ({"bounds": [[0, 1]] * 10_001}, "bounds must have 1 … 10000 rows, got 10001", "bounds"),
        ({"bounds": [0, 1]}, r"bounds must have shape \(d, 2\), got \(2,\)", "bounds"),
        ({"budget": 0}, "budget must be >= 1, got 0", "budget"),
        ({"budget": 2.5}, "budget must be a whole number, got 2.5", "budget"),
        ({"samples": 0}, "samples must be >= 1, got 0", "samples"),
        ({"function": "boot"}, "one of rastrigin, .*booth.*got 'boot'", "name"),
        ({"function": {"name": "sphere", "shift": [1]}}, "shift must have 2 entries .* got 1", "function"),
        ({"function": {"name": "sphere", "stretch": 0}}, "stretch must be > 0, got 0", "stretch"),
        ({"function": {"name": "sphere", "deviation": -1}}, "deviation must be >= 0", "deviation"),
        ({"function": {"name": "sphere", "size": 1}}, "size", "size"),
        ({"function": 3}, "name of a function, its data, or callable, got 3", "function"),
        ({"function": "easom", "bounds": [[0, 1]]}, "'easom' has 2 variables, got bounds of 1", "function"),
        ({"function": "rosenbrock", "bounds": [[0, 1]]}, "at least 2 variables", "function"),
    ],
)  # fmt: skip
def test_bad_data_is_refused_with_field_and_value(fields, message, field):
    asked = {"function": "sphere", "bounds": UNIT, **fields}
    with pytest.raises(InvalidData, match=message) as caught:
        BlackBoxMinimisation(**asked)
    assert caught.value.field == field


def test_names_that_nobody_knows_bring_the_nearest():
    with pytest.raises(InvalidData, match="unknown type 'name' of function; did you mean 'named'"):
        box({"type": "name", "name": "sphere"}, *UNIT)
    with pytest.raises(
        InvalidData, match="unknown type 'python' of function; allowed: named, waypoints"
    ):
        box({"type": "python"}, *UNIT)
    with pytest.raises(InvalidData, match="unknown type 3 of function"):
        box({"type": 3}, *UNIT)
    with pytest.raises(InvalidData, match="function must be callable, got 3"):
        PythonFunction(3)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        ("a", "must return a number, got 'a' at"),
        ("1.5", "must return a number, got '1.5' at"),
        (b"1", "must return a number"),
        (1j, "must return a number, got 1j at"),
        (None, "must return a number, got None at"),
        ([1.0, 2.0], "must return a number"),
        ([[1], [2, 3]], "must return a number"),
        ([], "must return a number"),
        ({}, "must return a number, got {} at"),
    ],
)
def test_a_function_must_return_a_number(returned, message):
    model = box(lambda x: returned, *UNIT)
    with pytest.raises(InvalidData, match=message) as caught:
        model.verify(BlackBoxPoint((0.25, 0)))
    assert "[0.25, 0.0]" in str(caught.value) and caught.value.field == "function"
    many = box(PythonFunction(lambda x: returned, vectorized=True), *UNIT)
    with pytest.raises(InvalidData, match="must return 3 numbers, got"):
        many.oracle()(np.zeros((3, 2)))


@pytest.mark.parametrize(
    "returned", [1.5, np.float32(1.5), np.array([[1.5]]), [1.5], Fraction(3, 2), Decimal("1.5")]
)
def test_whatever_is_one_number_is_taken(returned):
    assert box(lambda x: returned, *UNIT).verify(BlackBoxPoint((0, 0))).objective == 1.5


def test_a_function_that_changes_its_argument_changes_nothing_else():
    def greedy(x):
        x[:] = 9.0
        return 0.0

    answer, oracle = search("random-search", box(greedy, *UNIT, budget=5))
    assert max(answer.point.x) < 1 and max(oracle.points[0]) < 1
    many = box(PythonFunction(lambda x: x.fill(9.0) or np.zeros(len(x)), vectorized=True), *UNIT)
    points = np.zeros((3, 2))
    many.oracle()(points)
    assert (points == 0).all()


# -- files, copies, digests ------------------------------------------------------------------------------


def test_json_gives_the_same_model():
    model = box(
        {"name": "ackley", "shift": [0.1, -1e9], "stretch": 1e-3, "deviation": 0.5},
        *((-1e9, 1e9), (1e-9, 1e-9)), budget=17, samples=3, name="far",
    )  # fmt: skip
    again = Model.from_json(model.to_json())
    assert again == model and again.digest == model.digest and again.name == "far"
    point = np.array([[3.25, 1e-9]])
    assert again.function.values(point) == model.function.values(point)
    assert json.loads(model.to_json())["data"]["function"]["type"] == "named"
    plan = BlackBoxPoint((0.1, 1e-9))
    assert model.plan_from_data(json.loads(json.dumps(model.plan_to_data(plan)))) == plan


def test_a_function_of_python_cannot_be_written_but_its_solution_can():
    model = box(lambda x: x @ x, *UNIT, budget=20)
    with pytest.raises(InvalidData, match="Python's, which no file can hold"):
        model.to_json()
    found = ct.solve(model, "random-search")
    assert json.loads(found.to_json())["plan"] == {"x": list(found.plan.x)}


def test_the_digest_tells_functions_apart_and_copies_not():
    def function(x):
        return float(x @ x)

    models = [
        box(function, *UNIT),
        box(function, *UNIT),  # another box: nobody can tell what the function closes over
        box(lambda x: 0.0, *UNIT),
        box("sphere", *UNIT),
        box({"name": "sphere", "shift": [0, 0]}, *UNIT),
        box({"name": "sphere", "deviation": 1.0}, *UNIT),
        box("sphere", *UNIT, budget=7),
        box("sphere", *UNIT, samples=7),
        box("sphere", (0, 1), (0, 2)),
    ]
    assert len({model.digest for model in models}) == len(models)
    for model in models:
        copies = (
            copy.copy(model), copy.deepcopy(model), cloudpickle.loads(cloudpickle.dumps(model)),
            dataclasses.replace(model), model.renamed("other"), model.blinded(),
            cloudpickle.loads(cloudpickle.dumps(model.blinded())),
        )  # fmt: skip
        assert {one.digest for one in copies} == {model.digest}


# -- hidden ------------------------------------------------------------------------------------------------


class Spy(Backend):
    """Looks for the function, and for its shift, wherever its process can reach."""

    name = "spy"
    accepts = BlackBoxMinimisation
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INCUMBENTS})

    def run(self, problem, request):
        request.control.ask(np.array([[0.5, 0.5]]))  # the function has run, elsewhere
        found = []
        with contextlib.suppress(HiddenData):
            found.append(f"read {problem.function}")
        for thing in gc.get_objects():
            # 0.8125² is no number that anybody else would have.
            kind = type(thing)  # some libraries warn of deprecation where __class__ is asked
            shifted = issubclass(kind, np.ndarray) and 0.66015625 in thing.ravel()[:9].tolist()
            if issubclass(kind, BlackBoxFunction) or shifted:
                found.append(f"met {kind.__name__}")
        return Answer(
            Termination.FEASIBLE,
            point=BlackBoxPoint((0.5, 0.5)),
            message="; ".join(found) or "blind",
        )


@pytest.mark.parametrize("named", [True, False])
def test_a_backend_sees_values_and_nothing_of_the_function(named):
    shift = np.array([0.8125**2, 0.25])
    function = (
        {"name": "sphere", "shift": shift} if named else lambda x: float((x - shift) @ (x - shift))
    )
    model = box(function, *UNIT, budget=3)
    found = ct.solve(model, Spy())
    assert found.message == "blind"
    here = Spy().run(model.blinded(), Request(control=Control(oracle=model.oracle())))
    assert "met" in here.message, "where the function is, it can be met"
    assert found.primal_bound == (0.5 - shift[0]) ** 2 + 0.25**2
    view = model.blinded()
    with pytest.raises(HiddenData, match="function of model 'black-box' is hidden"):
        view.verify(BlackBoxPoint((0, 0)))
    assert view.describe() == "2 variables, 3 evaluations"
    with pytest.raises(UnsupportedOption, match="hides data from backends"):
        ct.solve(model, Spy(), isolate=False)
    assert ct.solve(model, "random-search", isolate=False).verified, "part of crosstrack"


# -- budget and points --------------------------------------------------------------------------------------


def test_the_answers_are_counted_and_kept_within_bounds():
    model = box("sphere", (-1, 1), (2, 2), budget=5)
    oracle = model.oracle()
    np.testing.assert_array_equal(oracle(np.array([[0, 2], [1, 2.0]])), [[4], [5]])
    for points, field, message in (
        ([[0, 2, 0.0]], "x", r"points must have shape \(m, 2\), got \(1, 3\)"),
        ([0.0, 2], "x", r"points must have shape \(m, 2\), got \(2,\)"),
        ([[0.0, 2]] * 4, "budget", "4 evaluations asked for, 3 of 5 left"),
        ([[0.0, 2], [1.5, 2]], "x", r"x\[0\] must lie in \[-1, 1\], got 1.5"),
        ([[0.0, 2 + 1e-15 * 2]], "x", r"x\[1\] must lie in \[2, 2\], got 2.00"),
        ([[math.nan, 2]], "x", r"x\[0\] must lie in \[-1, 1\], got nan"),
    ):
        with pytest.raises(InvalidData, match=message) as caught:
            oracle(np.array(points))
        assert caught.value.field == field
    assert len(oracle(np.array([[0, 2.0]] * 3))) == 3, "what is refused counts for nothing"
    assert oracle(np.empty((0, 2))).shape == (0, 1)
    with pytest.raises(InvalidData, match="1 evaluations asked for, 0 of 5 left"):
        oracle(np.array([[0, 2.0]]))
    assert len(model.oracle()(np.array([[0, 2.0]] * 5))) == 5, "each run has its own count"


class Greedy(Spy):
    """Asks for one point more than there is budget, or for one beyond the bounds."""

    name = "greedy"

    def __init__(self, beyond):
        self.beyond = beyond

    def run(self, problem, request):
        for _ in range(problem.budget):
            values = request.control.ask(np.array([[0.5, 0.5]]))
            request.control.incumbent(values[0, 0], BlackBoxPoint((0.5, 0.5)))
        request.control.ask(np.array([[0.5, 7.0 if self.beyond else 0.5]]))
        raise AssertionError("more was answered than there is")


@pytest.mark.parametrize(("beyond", "message"), [(False, "0 of 3 left"), (True, "1 evaluations")])
def test_a_strangers_backend_gets_no_more_than_the_budget(beyond, message):
    calls = []
    model = box(lambda x: float(len(calls.append(x) or calls)), *UNIT, budget=3)
    with pytest.raises(InvalidData, match=message):
        ct.solve(model, Greedy(beyond))
    assert len(calls) == 3
    (row,) = ct.compare([model], [Greedy(beyond)]).solutions
    # In a comparison it costs its own row, whose last point stands.
    assert row.termination in ("failed", "feasible") and message in row.message


# -- verification ------------------------------------------------------------------------------------------


def test_noise_is_seen_by_searches_and_not_by_the_verification():
    model = box({"name": "constant", "deviation": 2.0}, *UNIT, budget=400)
    first, again = (model.oracle()(np.full((400, 2), 0.5))[:, 0] for _ in range(2))
    np.testing.assert_array_equal(
        first, again, "the same noise in each run, and in parts of it too"
    )
    oracle = model.oracle()
    parts = [oracle(np.full((n, 2), 0.5))[:, 0] for n in (1, 99, 300)]
    np.testing.assert_array_equal(np.concatenate(parts), first)
    assert abs(first.mean()) < 0.4 and 1.8 < first.std() < 2.2
    found = ct.solve(model, "random-search", seed=1)
    assert found.primal_bound == 0.0 and found.incumbents[-1].objective < -3.0
    assert found.verification.spread == 0.0
    other = dataclasses.replace(model, budget=401).oracle()(np.full((400, 2), 0.5))[:, 0]
    assert not np.array_equal(other, first), "it follows from the digest"


def test_a_noisy_function_of_python_is_verified_by_its_mean():
    for samples, mean, spread in (
        (1, 1.0, 0.0),
        (2, 2.0, 2.0),
        (100, 2.0, 0.2 * (100 / 99) ** 0.5),
    ):
        turns = itertools.cycle([1.0, 3.0])
        checked = box(lambda x, turns=turns: next(turns), *UNIT, samples=samples).verify(
            BlackBoxPoint((0, 0))
        )
        assert checked.objective == mean
        # Two standard errors: of 1 and 3 in turn, the deviation is √(n / (n - 1)).
        assert checked.spread == pytest.approx(spread if samples != 2 else 2.0)


@pytest.mark.parametrize(
    ("bounds", "x", "ok", "within"),
    [
        ((-1, 2), 2.0, True, False),
        ((-1, 2), 2.0 + 1e-7, True, True),
        ((-1, 2), 2.1, False, False),
        ((-1, 2), -1.1, False, False),
        ((1, 1), 1.0, True, False),
        ((1, 1), 1.0 + 1e-9, False, False),
        ((0, 0), 1e-300, False, False),
        ((0, 1e-9), 1.1e-9, False, False),
        ((0, 1e-9), 0.9e-9, True, False),
        ((-1e9, 1e9), 1e9 + 1.0, True, False),  # as rounding
        ((-1e9, 1e9), 1e9 + 10.0, True, True),
    ],
)
def test_bounds_are_checked_relative_to_their_range(bounds, x, ok, within):
    checked = box("constant", bounds).verify(BlackBoxPoint((x,)))
    assert checked.ok is ok and bool(checked.within_tolerance) is within


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_point_without_a_value_is_no_plan(value):
    checked = box(lambda x: value, *UNIT).verify(BlackBoxPoint((0, 0)))
    assert not checked.ok and checked.objective is None
    assert "value is a number" in checked.summary()
    half = itertools.cycle([1.0, value])
    assert not box(lambda x: next(half), *UNIT, samples=4).verify(BlackBoxPoint((0, 0))).ok


def test_what_overflows_is_no_value():
    model = box("sphere", (-1e200, 1e200), budget=30)
    answer, _ = search("random-search", model)
    assert answer.termination is Termination.NO_SOLUTION
    assert not model.verify(BlackBoxPoint((1e200,))).ok


def test_plans_that_are_none():
    model = box("sphere", *UNIT)
    for plan, message in (
        ({"x": [0]}, "x must have 2 entries, got 1"),
        ({"y": [0, 0]}, "unknown key 'y' in the data of a plan; .*allowed: front, x"),
        ({"x": [0, math.nan]}, r"x\[1\] must be finite"),
        ({"x": "ab"}, "x"),
    ):
        with pytest.raises(InvalidData, match=message):
            ct.verify(model, plan)
    with pytest.raises(UnsupportedOption, match="tolerance"):
        model.verify(BlackBoxPoint((0, 0)), tolerance=2)


def test_counting_is_exact_through_processes():
    """The function is called as often as the limit allows, and once more to verify."""
    calls = []
    model = box(lambda x: float(calls.append(1) or x @ x), *UNIT, budget=50)
    found = ct.solve(model, "random-search", seed=2)
    assert found.statistics["evaluations"] == 50 and len(calls) == 51
