"""What every search of black boxes must keep, ours and those of others, and what SciPy's are."""

import functools
import math
import time

import numpy as np
import pytest
import scipy.optimize
from black_box.searches import DRAWING, EVERY, LACKING, Counted, allowed, box, search
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import BackendMissing, InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models.black_box import PythonFunction, oracle as oracle_module
from crosstrack.solvers import Control, Feature, Limit, Request, Termination, find_backend
from crosstrack.solvers.black_box import portfolio
from crosstrack.solvers.black_box.random_search import RandomSearch

#: Many minima, the least of them off the middle.
WAVY = {"name": "rastrigin", "shift": [1.25, -0.75]}
SQUARE = ((-5.12, 5.12), (-5.12, 5.12))


def many(function):
    """Return a function of one point at a time, as one of many."""
    return PythonFunction(function, vectorized=True)


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("budget", [1, 2, 7, 50])
def test_the_budget_is_used_and_never_exceeded(name, budget):
    model = box(WAVY, *SQUARE, budget=budget)
    answer, oracle = search(name, model)
    assert len(oracle.points) == budget == answer.statistics["evaluations"]
    assert answer.limit is Limit.EVALUATIONS
    best = min(model.function.values(np.array(oracle.points)))
    assert answer.primal_bound == best == model.verify(answer.point).objective


@pytest.mark.parametrize("name", EVERY)
def test_fewer_evaluations_than_the_budget_may_be_granted_not_more(name):
    model = box(WAVY, *SQUARE, budget=40)
    for granted, used in ((13, 13), (1000, 40)):
        answer, oracle = search(name, model, evaluations=granted)
        assert len(oracle.points) == used
        assert answer.limit is Limit.EVALUATIONS


@pytest.mark.parametrize("name", DRAWING)
def test_searches_that_draw_go_on_when_they_have_converged(name):
    budget = allowed(name, 60, 2500)
    model = box("sphere", (-1, 2), (-3, 1), budget=budget)
    _, oracle = search(name, model, **({"surrogate": 40} if name == "surrogate-search" else {}))
    assert len(oracle.points) == budget


@pytest.mark.parametrize("name", EVERY)
def test_the_same_seed_gives_the_same_points(name):
    budget = 150 if name == "cobyqa" else allowed(name, 25, 300)  # until it draws a start
    model = box({"name": "ackley", "shift": [0.3] * 2}, *[(-4, 5)] * 2, budget=budget)
    (_, first), (_, again), (_, other) = (search(name, model, seed) for seed in (3, 3, 4))
    assert first.points == again.points
    assert (first.points == other.points) is (Feature.SEED not in find_backend(name).features)


@functools.cache
def best_in_box(name, lowest, width):
    """Return the best value of a search in a box, and its place in units of the box."""

    def function(x):
        # Rounded, so that not even the last digit is another one.
        unit = np.round((x / width - lowest), 4)
        return ((unit - 0.625) ** 2).sum(axis=1) + 0.1 * np.abs(np.sin(9 * unit)).sum(axis=1)

    high = (lowest + 1) * width
    model = box(many(function), *[(lowest * width, high)] * 2, budget=allowed(name, 25, 100))
    answer, _ = search(name, model)
    return answer.primal_bound, np.array(answer.point.x) / width - lowest


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize(
    ("lowest", "width"), [(0.0, 2.0**30), (-3.0, 2.0**-30), (2.0**20, 2.0**10)]
)
def test_the_place_and_the_size_of_the_box_change_nothing(name, lowest, width):
    """Also an optimum at the origin is found no sooner than another."""

    value, place = best_in_box(name, lowest, width)
    wanted, at = best_in_box(name, -0.625, 1.0)  # the optimum at the origin
    assert value == wanted
    np.testing.assert_allclose(place, at, atol=1e-4)


@pytest.mark.parametrize("name", EVERY)
def test_no_value_in_most_places(name):
    """A ring of values; the message says how many points had none."""

    def ring(x):
        far = np.hypot(*x.T)
        return np.where((far > 0.6) & (far < 0.9), x[:, 0], np.where(far > 1, -np.inf, np.nan))

    budget = allowed(name, 50, 100)
    model = box(many(ring), (-1, 1), (-1, 1), budget=budget)
    answer, oracle = search(name, model)
    assert answer.termination is Termination.FEASIBLE
    assert model.verify(answer.point).ok
    lacking = int((~np.isfinite(ring(np.array(oracle.points)))).sum())
    assert answer.statistics["points without a value"] == lacking
    assert f"no value at {lacking} of {budget} points" in answer.message


@pytest.mark.parametrize("name", EVERY)
def test_no_value_anywhere(name):
    answer, oracle = search(name, box(lambda x: math.nan, (0, 1), (0, 1), budget=60))
    assert answer.termination is Termination.NO_SOLUTION
    assert answer.point is None and answer.primal_bound is None
    assert len(oracle.points) == 60


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize(
    ("function", "bounds", "most"),
    [
        pytest.param("constant", [(0, 1)] * 3, 0.0, id="constant"),
        pytest.param("step", [(-3.4, 4.2)] * 2, 2.0, id="terraces"),
        pytest.param(lambda x: 1e200 * abs(x[0] - 0.3), [(0, 1)], 4e198, id="huge"),
        pytest.param(lambda x: 1e-200 * abs(x[0] - 0.3), [(0, 1)], 4e-202, id="tiny"),
        pytest.param(lambda x: -float(x[0] > 0.7), [(0, 1)], -1.0, id="a step down"),
        pytest.param(lambda x: 10.0 ** (600 * x[0] - 300), [(0, 1)] * 2, 1e-200, id="600 decades"),
        pytest.param(lambda x: 1.7e308 * np.sign(x[0] - 0.3), [(0, 1)] * 2, 0, id="both signs"),
        pytest.param("sphere", [(-0.4, 0.7)], 1e-3, id="one variable", marks=pytest.mark.slow),
        pytest.param(lambda x: x.sum(), [(0, 1)] * 2, 0.4, id="optimum in a corner"),
        pytest.param(
            lambda x: -x.sum(),
            [(0, 1)] * 2,
            -1.6,
            id="in the opposite corner",
            marks=pytest.mark.slow,
        ),
        pytest.param({"name": "sphere", "deviation": 0.1}, [(-2, 1)] * 2, 0.2, id="noisy"),
    ],
)
def test_strange_functions(name, function, bounds, most):
    # COBYQA needs more evaluations if the values have extreme sizes.
    budget = allowed(name, 30, 200)
    if name == "cobyqa":
        budget = 60 if 1e-100 < abs(most) < 1e100 else 200
    model = box(function, *bounds, budget=budget)
    answer, _ = search(name, model, seed=1)
    found = model.verify(answer.point)
    assert found.ok and found.objective <= most and not answer.message


@pytest.mark.parametrize("name", EVERY)
def test_variables_without_a_width_are_fixed(name):
    model = box("sum-squares", (2.5, 2.5), (-1, 1), (-7, -7), (-2, 1), budget=40)
    answer, oracle = search(name, model)
    points = np.array(oracle.points)
    assert (points[:, [0, 2]] == [2.5, -7]).all()
    assert len(np.unique(points[:, 1])) > 10
    assert answer.primal_bound >= 2.5**2 + 3 * 49
    alone = box("sum-squares", (2.5, 2.5), (-7, -7), budget=40)
    answer, oracle = search(name, alone)
    assert oracle.points == [[2.5, -7]] and answer.point.x == (2.5, -7) and answer.limit is None


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("budget", [1, 40])
def test_a_warm_start_is_never_lost(name, budget):
    """A needle that nobody finds."""
    needle = (0.3, -1.7)
    model = box(lambda x: -1e6 if tuple(x) == needle else x @ x, (0, 1), (-2, 2), budget=budget)
    answer, oracle = search(name, model, warm=needle)
    assert answer.point.x == needle and answer.primal_bound == -1e6
    assert len(oracle.points) == budget


@pytest.mark.parametrize("name", EVERY)
def test_a_target_ends_a_search_where_it_is_reached_however_points_are_asked_for(name, monkeypatch):
    """The evaluations up to the target depend on no clock."""
    model = box(WAVY, *SQUARE, budget=3000)
    found = []
    for slow in (False, True):
        # As for a function so slow that each question has one point, and for one that takes no time.
        monkeypatch.setattr(oracle_module, "_QUESTION", -1.0 if slow else 1e9)
        answer, oracle = search(name, model, target=20.0)
        values = model.function.values(np.array(oracle.points))
        assert answer.limit is Limit.TARGET
        assert answer.statistics["evaluations"] == int((values <= 20).argmax()) + 1
        assert answer.primal_bound == values[(values <= 20).argmax()]
        assert answer.primal_bound == model.verify(answer.point).objective
        found.append((answer.point, answer.statistics["evaluations"]))
    assert found[0] == found[1]


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("last", [1, 4])
def test_a_search_that_is_stopped_asks_nothing_more(name, last):
    """As at a time limit, the best point so far is returned."""
    model = box(WAVY, *SQUARE, budget=3000)
    control = Control()

    def stop(oracle):
        if oracle.questions == last:
            control.stop(Limit.TIME)

    control.oracle = Counted(model, stop)
    answer, oracle = search(name, model, control=control)
    assert oracle.questions == last
    assert answer.limit is Limit.TIME and answer.termination is Termination.FEASIBLE
    assert answer.primal_bound == min(model.function.values(np.array(oracle.points)))


@pytest.mark.parametrize("name", EVERY)
def test_what_the_function_raises_comes_through_every_search(name):
    def fragile(sound):
        calls = []

        def value(x):
            calls.append(1)
            if len(calls) > sound:
                raise ZeroDivisionError("too far right")
            return x @ x

        return box(value, (0, 1), (0, 1), budget=500)

    text = "function raised ZeroDivisionError: too far right, at"
    with pytest.raises(InvalidData, match=text):
        search(name, fragile(0))
    # Earlier answers are kept.
    answer, _ = search(name, fragile(4))
    assert text in answer.message
    x = np.array(answer.point.x)
    assert answer.primal_bound == x @ x  # as the function computes it


@pytest.mark.parametrize("name", EVERY)
def test_many_variables(name):
    model = box({"name": "sphere", "shift": [0.25] * 100}, *[(-1, 1)] * 100, budget=30)
    if name == "shgo":
        with pytest.raises(
            UnsupportedFormulation, match="at most 10 variables that are free, got 100"
        ):
            search(name, model)
        # Those that are fixed do not count.
        model = box("sphere", *[(-1, 1)] * 3, *[(0, 0)] * 97, budget=30)
    answer, oracle = search(name, model)
    assert len(oracle.points) == 30 and len(answer.point.x) == 100


@pytest.mark.parametrize("name", EVERY)
def test_more_variables_than_a_search_holds(name):
    model = box("sphere", *[(-1, 1)] * 10_000, budget=12)
    refusal = find_backend(name).refuses(model)
    limited = ("shgo", "direct", "cma-es", "cobyqa", "surrogate-search")
    assert bool(refusal) is (name in limited)
    if refusal:
        assert "got 10000" in refusal
        with pytest.raises(UnsupportedFormulation, match=f"backend '{name}': it takes at most"):
            search(name, model)
    else:
        assert len(search(name, model)[1].points) == 12


@pytest.mark.parametrize(
    ("name", "most"),
    [
        *(("differential-evolution", 1e-6), ("dual-annealing", 1e-6), ("direct", 1e-6)),
        *(("portfolio", 1e-6), ("cobyqa", 1e-6)),
        *(("shgo", 1e-6), ("cma-es", 1e-6), ("particle-swarm", 1e-3)),
    ],
)
def test_a_valley_and_a_wavy_field_are_solved(name, most):
    if name in LACKING:
        pytest.skip(f"{name} needs crosstrack[blackbox]")
    budget = {"shgo": 400, "cobyqa": 200}.get(name) or allowed(name, 500, 1500)
    valley = box({"name": "booth", "shift": [1.1, -2.3]}, (-10, 10), (-10, 10), budget=budget)
    assert search(name, valley)[0].primal_bound <= most
    wavy = box(WAVY, *SQUARE, budget=budget)
    assert search(name, wavy)[0].primal_bound <= 1.0  # at most the second of its minima


# -- what is SciPy's ----------------------------------------------------------------------------------


def asked_of_scipy(function, solve, count):
    """Return the first points that SciPy itself asks for, in [0, 1]²."""
    points = []

    def value(x):
        if len(points) == count:
            raise StopIteration
        points.append(list(map(float, x)))
        return function(np.asarray(x))

    with pytest.raises(StopIteration):
        solve(value, [(0, 1)] * 2)
    return points


@pytest.mark.parametrize(
    ("name", "own", "solve"),
    [
        pytest.param(
            "direct",
            {"biased": False},
            lambda f, b: scipy.optimize.direct(
                f, b, locally_biased=False, maxfun=10**4, vol_tol=0.0, len_tol=0.0
            ),
            id="direct",
        ),
        pytest.param(
            "shgo", {"points": 9}, lambda f, b: scipy.optimize.shgo(f, b, n=9, iters=99), id="shgo"
        ),
        pytest.param(
            "shgo",
            {"points": 16, "sampling": "sobol"},
            lambda f, b: scipy.optimize.shgo(f, b, n=16, iters=99, sampling_method="sobol"),
            id="shgo by a sequence",
        ),
        pytest.param(
            "dual-annealing",
            {},
            lambda f, b: scipy.optimize.dual_annealing(f, b, rng=np.random.default_rng(5)),
            id="dual annealing",
        ),
    ],
)
def test_a_search_asks_for_what_scipy_asks_for(name, own, solve):
    def function(x):
        return float(np.sin(7 * x[0]) + (x[1] - 0.3) ** 2)

    _, oracle = search(name, box(function, (0, 1), (0, 1), budget=150), seed=5, **own)
    assert oracle.points == asked_of_scipy(function, solve, 150)


def test_direct_says_why_it_has_ended_before_the_evaluations():
    model = box("sphere", (-1, 2), budget=20_000)
    answer, oracle = search("direct", model, biased=False)
    assert len(oracle.points) < 20_000 and answer.limit is None
    assert answer.statistics["ended"] == "Maximum number of levels has been reached."


def test_direct_takes_no_memory_for_evaluations_that_it_will_not_use():
    """A budget of 10⁹ alone would take SciPy tens of gigabytes and a minute."""
    model = box("sphere", (-1, 2), (-1, 2), budget=10**9)
    answer, oracle = search("direct", model, target=1e-3)
    assert answer.limit is Limit.TARGET and len(oracle.points) < 10_000


def test_the_populations_of_differential_evolution_fit_the_evaluations():
    model = box("sphere", *[(-1, 2)] * 10, budget=1000)
    _, oracle = search("differential-evolution", model, seed=2)
    points = np.array(oracle.points)
    # A twentieth of the evaluations, one in each slice of each variable.
    slices = np.floor((points[:50] + 1) / 3 * 50)
    assert (np.sort(slices, axis=0) == np.arange(50)[:, None]).all()
    assert not (
        np.sort(np.floor((points[:51] + 1) / 3 * 50), axis=0)[:50] == np.arange(50)[:, None]
    ).all()


def test_options_of_searches():
    model = box("sphere", *[(-1, 2)] * 6, budget=100)
    with pytest.raises(UnsupportedOption, match="at most 5 variables that are free, got 6"):
        search("shgo", model, sampling="halton")
    with pytest.raises(UnsupportedOption, match="one of 'simplicial', 'sobol', 'halton'"):
        search("shgo", model, sampling="corners")
    for name, own in (
        ("differential-evolution", {"population": 0}),
        ("dual-annealing", {"temperature": 1e6}),
        ("direct", {"epsilon": -1.0}),
        ("cma-es", {"sigma": 0.0}),
        ("particle-swarm", {"particles": 1}),
    ):
        with pytest.raises(UnsupportedOption, match="must lie in"):
            find_backend(name).checked_options(own)


def test_differential_evolution_polishes_what_has_converged():
    model = box("constant", (0, 1), (0, 1), budget=100)
    for polish, apart in ((True, True), (False, False)):
        _, oracle = search("differential-evolution", model, polish=polish)
        # Two generations, all alike, then a point and the steps of a derivative there.
        steps = np.array(oracle.points)[11:13] - oracle.points[10]
        assert bool(abs(steps).max() < 1e-6) is apart


def test_a_package_that_is_missing_is_named_with_what_brings_it(monkeypatch):
    for name in ("cma-es", "particle-swarm"):
        backend = find_backend(name)
        monkeypatch.setattr(type(backend), "requires", ("nosuchpackage",))
        with pytest.raises(
            BackendMissing, match=r"needs nosuchpackage: pip install 'crosstrack\[blackbox\]'"
        ):
            backend.require()


# -- through the dispatcher -----------------------------------------------------------------------------


def test_searches_give_the_same_in_a_process_of_their_own():
    model = box(WAVY, *SQUARE, budget=120, name="wavy")
    some = {"random-search", "direct", "iafsa", "cma-es"}  # the rest loads for longer
    for name in sorted(some - LACKING):
        found = ct.solve(model, name, seed=7)
        assert found.statistics["evaluations"] == 120 and found.verification.ok
        # The dispatched run in its own process gives the same result as the search here.
        answer, _ = search(name, model, seed=7)
        assert found.primal_bound == answer.primal_bound and found.plan == answer.point


def test_a_time_limit_a_target_and_a_warm_start_through_the_dispatcher():
    endless = box(WAVY, *SQUARE, budget=10**9)
    found = ct.solve(endless, "random-search", seed=1, time_limit=0.3)
    assert found.limit is Limit.TIME and found.verification.ok
    aimed = ct.solve(endless, "differential-evolution", seed=1, target=found.primal_bound + 1.0)
    assert aimed.limit is Limit.TARGET and aimed.primal_bound <= found.primal_bound + 1.0
    kept = ct.solve(endless, "direct", warm_start=found, evaluations=5)
    assert kept.limit is Limit.EVALUATIONS and kept.primal_bound <= found.primal_bound
    with pytest.raises(InvalidData, match="warm_start is no plan of the model"):
        ct.solve(endless, "direct", warm_start={"x": [9, 9]})


# -- the portfolio ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("budget", "names"), [
    (60, ("cobyqa", "surrogate-search")),
    (200, ("cobyqa", "cma-es", "surrogate-search")),
    (600, ("cobyqa", "dual-annealing", "cma-es")),
])  # fmt: skip
def test_the_portfolio_divides_the_evaluations(budget, names):
    answer, function = search("portfolio", box(WAVY, *SQUARE, budget=budget))
    counts = [answer.statistics[name] for name in names if name not in LACKING]
    assert min(counts) > 0
    assert 1 + sum(counts) == budget == len(function.points)  # and the centre


@pytest.mark.parametrize("d", [1, 2, 7, 40, 300, 2000])
@pytest.mark.parametrize("evaluations", [1, 10, 500, 501, 3000, 10**6])
def test_the_shares_of_the_stages_increase_to_all_evaluations(d, evaluations):
    shares = [share for _, share, _ in portfolio.stages(d, evaluations)]
    assert shares == sorted(shares) and shares[0] > 0 and shares[-1] == 1.0
    # The last search has no limits and no libraries but SciPy.
    last = portfolio.stages(d, evaluations)[-1][0]()
    assert not last.most and last.requires == ("scipy",)


@settings(max_examples=5, deadline=None)
@given(
    d=st.integers(1, 4),
    budget=st.integers(3, 60),
    seed=st.integers(0, 100),
    name=st.sampled_from(["sphere", "rastrigin", "ackley", "step", "sum-squares"]),
    shift=st.floats(-2, 2),
)
def test_the_portfolio_is_never_worse_than_its_first_stage(d, budget, seed, name, shift):
    """The first stage asks for the same points alone, and later stages lose none of them."""
    model = box({"name": name, "shift": [shift] * d}, *[(-3.0, 4.0)] * d, budget=budget)
    answer, oracle = search("portfolio", model, seed)
    kind, share, options = portfolio.stages(d, budget)[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(portfolio, "stages", lambda *_: [(kind, share, options)])
        alone, first = search("portfolio", model, seed)
    count = len(first.points)
    assert first.points == oracle.points[:count] and count <= len(oracle.points) == budget
    assert answer.primal_bound <= alone.primal_bound
    # Products of matrices with one row and with several rows differ in the last digit.
    best = min(model.function.values(np.array([x]))[0] for x in oracle.points)
    assert answer.primal_bound == pytest.approx(best, rel=1e-12, abs=1e-300)


def test_the_portfolio_divides_the_time():
    """Each search gets its share, although the evaluations would last for hours."""
    model = box("sphere", *[(-1, 1)] * 3, budget=10**8)
    ct.solve(model, "portfolio", evaluations=1)  # imports the libraries
    answer = ct.solve(model, "portfolio", time_limit=0.5)
    last = "dual-annealing" if "cma-es" in LACKING else "cma-es"
    assert answer.statistics[last] > 0  # the others may lose their share to imports
    assert str(answer.limit) == "time"


def test_an_evolution_strategy_begins_around_the_centre():
    if "cma-es" in LACKING:
        pytest.skip("needs crosstrack[blackbox]")
    _, oracle = search("cma-es", box("sphere", *[(-1, 1)] * 30, budget=200), population=200)
    points = np.array(oracle.points)
    assert np.abs(points.mean(axis=0)).max() < 0.15 and 0.3 < points.std() < 0.5


@pytest.mark.parametrize(("d", "is_fitted"), [(40, True), (41, False), (1000, False)])
def test_the_portfolio_fits_no_quadratic_model_in_many_variables(d, is_fitted):
    """A fit takes minutes with a hundred variables."""
    parts = [
        options for kind, _, options in portfolio.stages(d, 100 * d) if kind is portfolio.CmaEs
    ]
    assert [options["surrogate"] for options in parts] == [is_fitted]


def test_the_portfolio_selects_its_stages_for_the_evaluations_that_the_time_allows():
    """A slow function with a time limit has few evaluations, whatever its budget."""

    def slow(x):
        time.sleep(0.05)
        return x @ x

    control = Control()
    model = box(slow, (-1, 2), (-1, 2), budget=10**6)
    backend = find_backend("portfolio")
    backend.prepare()
    control.arm(2.5)
    control.oracle = Counted(model)
    answer = backend.run(model.blinded(), Request(time_limit=2.5, control=control, seed=1))
    assert answer.limit is Limit.TIME
    assert answer.statistics["surrogate-search"] > 0 and answer.primal_bound < 0.1


@pytest.mark.slow
def test_the_portfolio_is_no_worse_than_its_searches_on_a_path():
    model = ct.load("black-box/path-corners")
    best = ct.solve(model, "portfolio", seed=1, evaluations=4000).primal_bound
    others = [
        ct.solve(model, name, seed=1, evaluations=4000).primal_bound
        for name in ("direct", "dual-annealing")
    ]
    assert best <= min(others) * 1.01


def test_the_portfolio_counts_the_evaluations_of_all_stages():
    """Each incumbent has the number of its evaluation in the whole run."""
    control = Control()
    model = box("ackley", *[(-1.0, 2.0)] * 3, budget=100)
    _, oracle = search("portfolio", model, control=control)
    values = model.function.values(np.array(oracle.points))
    places = []
    while not control.events.empty():
        _, objective, _, place = control.events.get()
        assert objective == pytest.approx(values[place - 1], rel=1e-12)
        places.append(place)
    assert len(places) > 5 and places == sorted(places)


def test_the_portfolio_reports_a_time_limit_that_ends_an_early_stage(monkeypatch):
    class Idle(RandomSearch):
        def search(self, objective):
            time.sleep(0.3)
            return {}

    stages = ((Idle, 0.5, {}), (portfolio.DualAnnealing, 1.0, {}))
    monkeypatch.setattr(portfolio, "stages", lambda *_: stages)
    control = Control()
    control.arm(0.1)
    backend = find_backend("portfolio")
    backend.prepare()
    model = box("sphere", *SQUARE)
    control.oracle = Counted(model)
    answer = backend.run(model.blinded(), Request(time_limit=0.1, control=control))
    assert answer.limit is Limit.TIME


@pytest.mark.parametrize("name", EVERY)
def test_a_time_limit_that_the_start_uses_up_leaves_one_evaluation(name):
    """The import of a library counts; the run still returns a plan."""
    control = Control()
    control.stop(Limit.TIME)
    answer, oracle = search(name, box("sphere", (1, 2), (1, 2), budget=100), control=control)
    assert answer.point is not None and answer.limit is Limit.TIME
    assert 1 <= len(oracle.points) == answer.statistics["evaluations"] <= 100
