"""Gaussian process, ``surrogate-search``, ``cobyqa`` and the variants of ``cma-es``."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from black_box.published import PUBLISHED
from black_box.searches import LACKING, Counted, box, search
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import PythonFunction
from crosstrack.solvers import Control, Limit, Request
from crosstrack.solvers.black_box.gaussian_process import GaussianProcess
from crosstrack.solvers.black_box.objective import Objective

RNG = np.random.default_rng(5)


def valley(x):
    """Return an ill-conditioned, rotated quadratic with its minimum 0 at (0.3, …, 0.3)."""
    d = x.shape[-1]
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(d, d)))[0]
    return ((x - 0.3) @ turn) ** 2 @ 100.0 ** np.linspace(0, 1, d)


def many(function):
    return PythonFunction(function, vectorized=True)


def data(n=40, d=3):
    x = RNG.uniform(-1, 1, (n, d))
    return x, np.sin(3 * x[:, 0]) + 2 * x[:, 1] ** 2


def test_the_gradient_of_the_posterior_density_is_that_of_differences():
    x, y = data()
    process = GaussianProcess(3)
    loss = process._loss(x, y)
    for theta in (process.theta, RNG.normal(size=6) - [0, 0, 0, 0, 0, 5]):
        assert_allclose(
            loss(theta)[1], approx_fprime(theta, lambda t: loss(t)[0], 1e-6), rtol=1e-3, atol=1e-3
        )


def test_the_gradient_of_the_lower_bound_is_that_of_differences():
    x, y = data()
    process = GaussianProcess(3)
    process.fit(x, y, 30)
    for kappa in (0.0, 1.5):
        at = RNG.uniform(-1, 1, 3)
        value, gradient = process.lower(at, kappa)
        mean, deviation = process.predict(at[None])
        assert value == pytest.approx(mean[0] - kappa * deviation[0])
        assert_allclose(
            gradient, approx_fprime(at, lambda z, k=kappa: process.lower(z, k)[0], 1e-6), atol=1e-3
        )


def test_the_process_interpolates_and_predicts_within_its_deviations():
    x, y = data(60)
    process = GaussianProcess(3)
    process.fit(x, y, 50)
    assert_allclose(process.predict(x)[0], y, atol=1e-3)
    others, values = data(200)
    mean, deviation = process.predict(others)
    assert_allclose(mean, values, atol=0.05)
    assert (np.abs(mean - values) < 4 * deviation + 1e-3).mean() > 0.95


def test_a_quadratic_function_is_learned_exactly():
    x = RNG.uniform(-1, 1, (40, 4))
    process = GaussianProcess(4)
    process.fit(x, valley(x), 60)
    others = RNG.uniform(-3, 3, (50, 4))  # also outside of the points
    assert_allclose(process.predict(others)[0], valley(others), rtol=1e-2, atol=0.1)


def test_equal_points_with_different_values_have_a_posterior():
    x = np.repeat(RNG.uniform(-1, 1, (5, 2)), 8, axis=0)
    process = GaussianProcess(2)
    process.fit(x, RNG.normal(size=40), 20)
    mean, deviation = process.predict(x)
    assert np.isfinite(mean).all() and (deviation > 0).all()


@pytest.mark.parametrize(
    "name",
    [
        "cobyqa",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("surrogate-search", "portfolio")),
    ],
)
def test_few_evaluations_follow_a_valley(name):
    model = box(many(valley), *[(-2, 1)] * 5, budget=150)
    assert search(name, model, seed=1)[0].primal_bound <= 0.01
    random = search("random-search", model, seed=1)[0].primal_bound
    assert random > 1.0


def test_a_batch_is_one_request():
    sizes = []

    def function(x):
        sizes.append(len(x))
        return valley(x)

    control = Control()
    model = box(many(function), *[(-2, 1)] * 3, budget=86)
    control.oracle = Counted(model)
    answer, _ = search("surrogate-search", model, control=control, batch=8)
    points = np.array(control.oracle.points)
    assert len(np.unique(points, axis=0)) == 86  # no point twice within a batch or later
    assert max(sizes) == 8 and answer.primal_bound <= 0.5
    assert len(sizes) < 30


@pytest.mark.parametrize(
    ("name", "options", "first"),
    [("differential-evolution", {"immediate": True}, 8), ("surrogate-search", {}, 4)],
)
def test_no_worker_waits_for_the_slowest_point(name, options, first):
    """The last point of what would be a batch lasts until five others have ended; the plan is the same."""
    plans = []
    for slow in (2 * first, 3 * first):
        changed, started, ended = threading.Condition(), [0], [0]

        def function(x, slow=slow, changed=changed, started=started, ended=ended):
            with changed:
                started[0] += 1
                if started[0] == slow:
                    bar = ended[0] + 5
                    assert changed.wait_for(lambda: ended[0] >= bar, timeout=60)
                ended[0] += 1
                changed.notify_all()
            return float(valley(x))

        with ThreadPoolExecutor(4) as workers:
            model = box(PythonFunction(function, workers=workers), (-2, 1), (-2, 1), budget=40)
            answer, oracle = search(name, model, seed=1, **options)
        assert answer.statistics["evaluations"] == 40 == len(oracle.points)
        plans.append((answer.point, oracle.points))
    assert plans[0] == plans[1]


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        *(("cobyqa", 1e-6), ("cobyqa", 1e6), ("portfolio", 1e-6)),
        pytest.param("surrogate-search", 1e-6, marks=pytest.mark.slow),
        pytest.param("surrogate-search", 1e6, marks=pytest.mark.slow),
        pytest.param("portfolio", 1e6, marks=pytest.mark.slow),
    ],
)
def test_hundred_evaluations_find_a_plan_in_a_thin_region(name, scale):
    """The feasible region of g06 is 1e-5 of the box, and both constraints are active in the optimum."""
    function, bounds, count, optimum = PUBLISHED["g06"]
    model = box(
        many(lambda x: function(x) * [1, scale, scale]), *bounds, inequalities=count, budget=100
    )
    answer, oracle = search(name, model, seed=3)
    assert model.verify(answer.point).ok and len(oracle.points) <= 100
    assert optimum - 1e-3 <= answer.primal_bound <= optimum + 50


def test_annealing_continues_after_the_evaluations_of_the_process():
    model = box("rastrigin", *[(-4, 5)] * 2, budget=80)
    _, first = search("surrogate-search", model, evaluations=30)
    _, second = search("surrogate-search", model, surrogate=30, evaluations=80)
    assert first.points[:30] == second.points[:30]
    _, third = search("surrogate-search", model, surrogate=50, evaluations=50)
    assert second.points[:30] == third.points[:30] and second.points[32:50] != third.points[32:]
    assert len(second.points) == 80


def test_whole_numbers_and_categories_are_searched():
    colours = {"type": "category", "values": ["red", "green", "blue"]}

    def function(x):
        return (x[0] - 7) ** 2 + (x[1] - 0.25) ** 2 + 3 * (x[2] != 1)

    model = box(
        function, (0, 20), (-1, 1), (0, 2), variables=["integer", "real", colours], budget=60
    )
    answer, _ = search("surrogate-search", model, seed=2)
    assert answer.point.x[0] == 7 and answer.point.x[2] == 1 and answer.primal_bound < 0.01


def test_a_time_limit_ends_a_surrogate_search():
    model = box(many(valley), *[(-2, 1)] * 4, budget=500)
    control = Control()
    control.arm(0.5)
    begin = time.perf_counter()
    answer, _ = search("surrogate-search", model, control=control)
    assert answer.limit in (Limit.TIME, Limit.EVALUATIONS)
    assert time.perf_counter() - begin < 20


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 10, 20])
def test_the_overhead_per_evaluation_is_below_a_tenth_of_a_second(d):
    begin = time.process_time()
    search("surrogate-search", box(many(valley), *[(-2, 1)] * d, budget=500))
    assert time.process_time() - begin < 0.1 * 500


@pytest.mark.skipif("cma-es" in LACKING, reason="needs crosstrack[blackbox]")
def test_a_model_saves_evaluations_of_the_evolution_strategy():
    model = box(many(valley), *[(-2, 1)] * 6, budget=240)
    plain, with_model = (
        search("cma-es", model, 0, surrogate=own)[0].primal_bound for own in (False, True)
    )
    assert with_model < 1e-3 * plain


def test_cobyqa_starts_again_or_ends():
    model = box(many(valley), *[(-2, 1)] * 2, budget=200)
    answer, oracle = search("cobyqa", model, restarts=False)
    assert answer.limit is None and len(oracle.points) < 200 and answer.primal_bound < 1e-10
    assert "ended" in answer.statistics
    assert len(search("cobyqa", model)[1].points) == 200


@pytest.mark.parametrize("evaluations", [60, pytest.param(200, marks=pytest.mark.slow), 1000])
def test_the_portfolio_leaves_no_worker_idle_with_several_workers(evaluations):
    """Searches that request single points are left out."""
    with ThreadPoolExecutor(4) as workers:
        function = PythonFunction(valley, workers=workers)
        model = BlackBoxMinimisation(function, [[-2, 1]] * 3, budget=evaluations)
        answer = ct.solve(model, seed=1)
    counts = answer.statistics
    assert "cobyqa" not in counts and "dual-annealing" not in counts
    assert counts["evaluations"] == evaluations and answer.primal_bound < 0.5


@pytest.mark.parametrize("name", ["portfolio", "cobyqa", "surrogate-search"])
def test_no_point_is_evaluated_twice_by_local_models(name):
    model = box({"name": "rosenbrock", "shift": [0.3, -0.4]}, (-2, 2), (-2, 2), budget=60)
    _, oracle = search(name, model, seed=1)
    first = [tuple(x) for x in oracle.points[:25]]
    assert first[0] == (0.0, 0.0) and len(set(first)) == 25


def test_earlier_points_have_the_values_of_the_present_search():
    """A stage with an augmented Lagrangian must not leave its values to one with feasibility rules."""
    model = box(lambda x: [x[0], 0.5 - x[0]], (0, 1), inequalities=1, budget=60)
    control = Control(oracle=Counted(model))
    objective = Objective(model.blinded(), Request(seed=1, control=control))
    sample = np.linspace(0, 1, 5)[:, None]
    objective.constraints.begin(objective.table(objective.point(sample)))
    objective(sample)
    objective.constraints.multipliers = None
    points, table = objective.earlier()
    values = objective.constraints.merit(points, table)
    np.testing.assert_array_equal(points, np.vstack([sample, sample]))
    np.testing.assert_array_equal(values[points[:, 0] >= 0.5], points[points[:, 0] >= 0.5, 0])
    assert (values[points[:, 0] < 0.5] > 1e100).all()
