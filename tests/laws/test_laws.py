"""Laws that hold for whatever is declared, whatever its problem.

Instances of every kind are small ones with something done to them: numbers scaled by up to a million,
made equal, set to nothing, taken away or twice. 30 cases in ``make test``, always the same; 10,000
in ``make slow``, always others.
"""

from __future__ import annotations

import functools
import json
import math
import random

import pytest
import strange
from hypothesis import HealthCheck, given, settings, strategies as st
from laws.rescaled import RESCALED, TIGHTER, in_other_units, tightened

import crosstrack as ct
from crosstrack.errors import CrosstrackError, InvalidData
from crosstrack.models import Model
from crosstrack.solvers import Feature, Solution, Termination, find_backend
from crosstrack.solvers.contract.selection import fitting

#: How a run may end: with a verified plan, a proof, or a limit that is named.
PLANS = {Termination.OPTIMAL, Termination.LOCALLY_OPTIMAL, Termination.FEASIBLE}
PROOFS = {Termination.INFEASIBLE, Termination.UNBOUNDED}
SECONDS = 1.0

EXAMPLES = [json.loads(instance) for instance, _ in strange.examples()]
KINDS = sorted({one["model"] for one in EXAMPLES})

few = settings(
    max_examples=30, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck)
)
many = settings(max_examples=10_000, deadline=None, suppress_health_check=list(HealthCheck))
numbers = st.integers(0, 2**63)


def reworked(tree, draw):
    """Return a part of an instance with its numbers changed in a way that keeps its shape."""
    if isinstance(tree, dict):
        return {key: reworked(value, draw) for key, value in tree.items()}
    if isinstance(tree, list):
        if tree and all(isinstance(one, int | float) for one in tree) and draw.random() < 0.3:
            way = draw.randrange(4)
            if way == 0:
                return [draw.choice(tree)] * len(tree)  # ties
            if way == 1:
                factor = 10.0 ** draw.randint(-6, 6)
                return [one * factor if isinstance(one, float) else one for one in tree]
            if way == 2:
                return [one if draw.random() < 0.5 else type(one)(0) for one in tree]
            return draw.sample(tree, len(tree))
        return [reworked(one, draw) for one in tree]
    if isinstance(tree, float) and draw.random() < 0.1:
        return tree * draw.choice([0.0, -1.0, 1e-6, 1e6, 0.5, 1.0 + 1e-9])
    return tree


def drawn(number):
    """Return a drawn instance; None if the data are invalid and raise an error that names the fault."""
    draw = random.Random(number)
    whole = draw.choice(EXAMPLES)
    data = whole["data"]
    data = strange.mutated(data, draw) if draw.random() < 0.2 else reworked(data, draw)
    text = strange.written({**whole, "data": data})
    try:
        return Model.from_json(text)
    except InvalidData:
        return None


def known(model):
    """Return whether solving the model stays within the memory and time of a test."""
    return sum(len(str(value)) for value in model.to_dict()["data"].values()) < 20_000


def check_the_end(number):
    """A plan, a proof, or a limit; never anything else, and never another exception."""
    model = drawn(number)
    if model is None or not known(model):
        return
    try:
        answer = ct.solve(model, time_limit=SECONDS)
    except CrosstrackError:
        return  # refused by name
    told = (number, model.kind, str(answer))
    if answer.termination is Termination.FAILED:
        # A solver may lose its way; that something of ours raised is a fault.
        assert answer.message and "Error" not in answer.message, told
    if answer.termination in PLANS:
        assert answer.verification.ok, told
        assert ct.verify(model, answer.plan).ok, told
        assert math.isfinite(answer.primal_bound), told
    else:
        assert answer.plan is None, told
        if answer.termination not in PROOFS:
            assert answer.limit is not None or answer.message, told
    data = json.loads(json.dumps(answer.to_dict(), allow_nan=False))
    again = Solution.from_dict(data, model)
    assert again.to_dict() == answer.to_dict(), told


@few
@given(numbers)
def test_every_drawn_instance_ends_in_a_plan_a_proof_or_a_limit(number):
    check_the_end(number)


@pytest.mark.parametrize(
    "number",
    [
        # Stored functions without columns, or with empty numbers, raised CasADi's errors.
        *(3865768805273116289, 9109827563315132698, 3550833817486121647, 3246571410964499594),
        # A count of a search that found nothing was no number, and so no JSON.
        2486587774967099918,
        # A phase without integrals, whose integrand was 0 by 0, among phases with some.
        683,
    ],
)
def test_earlier_counterexamples_to_the_laws_stay_fixed(number):
    check_the_end(number)


@pytest.mark.slow
@pytest.mark.timeout(6 * 3600)
@many
@given(numbers)
def test_ten_thousand_end_in_a_plan_a_proof_or_a_limit(number):
    check_the_end(number)


@few
@given(numbers)
def test_instances_are_exact_in_json(number):
    model = drawn(number)
    if model is not None:
        text = model.to_json()
        again = Model.from_json(text)
        assert again.digest == model.digest
        assert again.to_json() == text


def example(kind):
    """Return an undamaged example of a kind."""
    return Model.from_dict(next(one for one in EXAMPLES if one["model"] == kind))


def test_every_backend_has_a_seed_or_is_deterministic():
    for state in ct.backends():
        backend = find_backend(state.name, problem=state.problem)
        assert backend.deterministic or Feature.SEED in backend.features, backend.name


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_plan(kind):
    """Of every native backend that draws and ends by itself: twice from one seed."""
    model = example(kind)
    names = [
        name
        for name in fitting(model)
        if (one := find_backend(name, model)).problem and Feature.SEED in one.features
    ]
    for name in names[:4]:
        first, second = (ct.solve(model, name, seed=5, time_limit=20) for _ in range(2))
        if first.limit is None and second.limit is None:
            assert first.plan_data == second.plan_data, name
            assert first.primal_bound == second.primal_bound, name


#: Kinds whose comparison of all backends takes more than a few seconds.
LONG = {
    "attractor", "fleet-routing", "guided-path-tour", "messenger-tour", "minimum-derivative", "nonlinear-program",
    "optimal-control", "satellite-slew", "time-allocation", "unknown-grid", "minimum-snap", "sideslip",
    "black-box", "quadratic-program", "mixed-integer-program", "sequential-ordering", "error-correction", "grid-path",
    "fleet-mission",
}  # fmt: skip


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.slow] if k in LONG else []) for k in KINDS]
)
def test_no_bound_is_above_a_verified_plan(kind):
    """All backends that take a model by default, in their own processes: no contradiction."""
    model = example(kind)
    verdict = ct.compare(model, list(fitting(model)), time_limit=2.0)
    assert verdict.outcome != "CONTRADICTION", str(verdict)


#: Kinds whose solving takes more than a few seconds.
SLOW = {"satellite-slew"}


def test_rescaled_kinds_exist():
    """Kinds without a length or a time of their own have no units: programs, series, cells.

    The laws of units of optimal control are in tests/optimal_control/test_control_sizes.py, those of
    cars in tests/sideslip.
    """
    assert set(RESCALED) <= set(KINDS) and set(TIGHTER) <= set(KINDS)


@functools.cache
def solved(place, time_limit=None):
    """Return the answer for an undamaged example, which many laws compare with."""
    return ct.solve(Model.from_dict(EXAMPLES[place]), seed=0, time_limit=time_limit)


@pytest.mark.parametrize(
    "place",
    [
        pytest.param(k, id=one["model"], marks=[pytest.mark.slow] if one["model"] in SLOW else [])
        for k, one in enumerate(EXAMPLES)
        if one["model"] in RESCALED
    ],
)
@pytest.mark.parametrize(("length", "time"), [(2.0**10, 2.0**-3), (1e-3, 60.0)])
def test_other_units_scale_the_answer(place, length, time):
    whole = EXAMPLES[place]
    data, factor = in_other_units(whole["model"], whole, length, time)
    first, second = solved(place), ct.solve(Model.from_dict(data), seed=0)
    assert second.termination == first.termination, str(second)
    if first.primal_bound is None:
        assert second.primal_bound is None
    else:
        assert second.primal_bound == pytest.approx(first.primal_bound * factor, rel=1e-6)


def check_less_is_no_better(number):
    """What allows less has no better optimum, and no plan below the bound of what allows more."""
    draw = random.Random(number)
    place = draw.choice([k for k, one in enumerate(EXAMPLES) if one["model"] in TIGHTER])
    whole = EXAMPLES[place]
    less = tightened(whole["model"], whole, draw)
    if less is None:
        return
    try:
        tight = Model.from_dict(less)
    except InvalidData:
        return  # a circle of precedence, or a limit that what is given breaks by itself
    first, second = solved(place, SECONDS), ct.solve(tight, seed=0, time_limit=SECONDS)
    told = (number, whole["model"], str(first), str(second))
    if first.termination in PROOFS:
        assert second.plan is None, told
    if second.primal_bound is None:
        return
    slack = 2e-6 * max(1.0, abs(second.primal_bound), second.verification.scale)
    if first.dual_bound is not None:
        assert second.primal_bound >= first.dual_bound - slack, told
    if first.termination is Termination.OPTIMAL:
        assert second.primal_bound >= first.primal_bound - slack, told


@few
@given(numbers)
def test_a_tighter_instance_is_no_better(number):
    check_less_is_no_better(number)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@settings(many, max_examples=2000)
@given(numbers)
def test_two_thousand_tighter_instances_are_no_better(number):
    check_less_is_no_better(number)


@few
@given(numbers)
def test_a_further_constraint_never_improves_the_optimum(number):
    """Of small mixed-integer programs, by two exact solvers in turn."""
    from crosstrack.models import ProgramBuilder

    draw = random.Random(number)
    size = draw.randint(1, 6)
    builder = ProgramBuilder()
    cost = [draw.choice([-3.0, -1.0, 0.0, 0.5, 1e3, draw.uniform(-9, 9)]) for _ in range(size)]
    x = builder.columns(
        "x", size, upper=draw.choice([1.0, 3.0, 7.5]), cost=cost, integral=draw.random() < 0.7
    )
    for k in range(draw.randint(0, 3)):
        row = [draw.choice([0.0, 1.0, -1.0, draw.uniform(-5, 5)]) for _ in range(size)]
        builder.rows(f"row {k}", 1, (0, x, row), upper=draw.uniform(0, 6))
    loose = builder.build()
    row = [draw.uniform(-5, 5) for _ in range(size)]
    builder.rows("one more", 1, (0, x, row), upper=draw.uniform(-4, 4))
    tight = builder.build()
    name = ("highs", "scipy")[number % 2]
    first, second = (ct.solve(one, name, isolate=False) for one in (loose, tight))
    assert first.termination == Termination.OPTIMAL
    assert second.termination in (Termination.OPTIMAL, Termination.INFEASIBLE)
    if second.primal_bound is not None:
        assert second.primal_bound >= first.primal_bound - 1e-6 * max(1.0, abs(first.primal_bound))
        assert second.dual_bound <= second.primal_bound + 1e-9 * max(1.0, abs(second.primal_bound))
