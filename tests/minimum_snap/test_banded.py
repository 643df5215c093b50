"""The native minimum-derivative solver: against 50 digits, SciPy and brute force."""

import numpy as np
import pytest
from minimum_snap import hundred_digits
from minimum_snap.splines import (
    brute_force,
    cost_in_digits,
    only,
    random_problem,
    reference,
    through_waypoints,
    worst_jumps,
)
from scipy.interpolate import make_interp_spline

from crosstrack.models.minimum_snap import MinimumDerivative
from crosstrack.solvers.minimum_snap import (
    banded,
    boundary,
    hermite,
    moment_kernels,
)
from crosstrack.solvers.minimum_snap.hermite import Outcome
from crosstrack.solvers.minimum_snap.refined_kernels import refined

# -- against the references -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "count", "ratio", "kind"),
    [
        (2, 150, 400.0, "alternating"),
        (6, 30, 400.0, "any"),
        (3, 200, 400.0, "any"),
        (4, 200, 4.0, "any"),
        (4, 200, 400.0, "alternating"),
        *(
            pytest.param(order, 1000, ratio, kind, marks=pytest.mark.slow)
            for order, ratio, kind in [
                (3, 400.0, "any"),
                (4, 4.0, "any"),
                (4, 4.0, "alternating"),
                (4, 400.0, "any"),
                (4, 400.0, "alternating"),
            ]
        ),
    ],
)
def test_fifty_digits(order, count, ratio, kind):
    """Objective to 1e-12, all derivatives up to 2r-2 continuous: to 1e-11, 1e-10 for wild times."""
    durations, values, fixed = through_waypoints(order, count, ratio, axes=1, kind=kind)
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    assert solved.outcome is Outcome.SOLVED
    exact = reference(durations, values[0], order)
    assert abs(solved.objective[0] / exact - 1) <= 1e-12
    coefficients = hermite.jets_to_coefficients(durations, solved.jets, solved.moments)
    assert abs(cost_in_digits(durations, coefficients[:, :, 0], order) / exact - 1) <= 1e-12
    allowed = 1e-11 if ratio <= 4 else 1e-10
    assert worst_jumps(durations, coefficients, 2 * order - 2).max() <= allowed


@pytest.mark.parametrize("order", [2, 3, 4, 5])
@pytest.mark.parametrize("ratio", [1.0001, 4.0, 400.0])
def test_shapes_of_many_paths(order, ratio):
    """Continuous derivatives jump by rounding only, and one more step certifies the shape."""
    for seed in range(10):
        kind = "alternating" if seed % 2 else "any"
        durations, values, fixed = through_waypoints(order, 300, ratio, seed=seed, kind=kind)
        weights = only(order)
        solved = banded.solve_hermite(durations, values, fixed, weights, order - 1, certify=True)
        assert solved.correction <= hermite.CERTIFIED
        coefficients = hermite.jets_to_coefficients(durations, solved.jets, solved.moments)
        highest = 2 * order - 2 if ratio <= 4 and order < 5 else order - 1
        assert worst_jumps(durations, coefficients, highest).max() <= 1e-10


@pytest.mark.parametrize("order", [2, 3, 4, 5])
@pytest.mark.parametrize("count", [1, 2, 1000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_it_is_scipys_spline(order, count):
    durations, values, fixed = through_waypoints(order, count, 2.0)
    times = np.concatenate([[0.0], np.cumsum(durations)])
    # SciPy takes times, so the comparison uses their differences.
    durations = np.diff(times)
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    conditions = [[(j, values[:, end, j]) for j in range(1, order)] for end in (0, -1)]
    spline = make_interp_spline(times, values[:, :, 0].T, k=2 * order - 1, bc_type=conditions)
    for j in range(order):
        mine = np.concatenate([solved.jets[:, :, 0, j], solved.jets[:, -1:, 1, j]], axis=1)
        # Its absolute times cost it digits that grow with the path.
        allowed = 1e-15 * max(count, 1000) * 10**order
        assert np.abs(mine - spline(times, j).T).max() <= allowed * np.abs(mine).max()


def test_brute_force():
    """Any pattern of fixed entries, weights and continuity; and whether the optimum is unique."""
    rng = np.random.default_rng(7)
    outcomes = {Outcome.SOLVED: 0, Outcome.NOT_UNIQUE: 0, Outcome.ILL_CONDITIONED: 0}
    for _ in range(150):
        problem = random_problem(rng)
        durations, values, fixed, weights, continuity = problem
        solved = banded.solve_hermite(*problem)
        outcomes[solved.outcome] += 1
        found = [
            brute_force(durations, v, f, weights, continuity)
            for v, f in zip(values, fixed, strict=True)
        ]
        unique = all(missing == 0 for _, missing in found)
        assert (solved.outcome is Outcome.SOLVED) == unique
        if not unique:
            assert np.isnan(solved.objective).all() and np.isnan(solved.jets).all()
            continue
        costs = np.array([cost for cost, _ in found])
        assert solved.objective == pytest.approx(costs, rel=1e-8, abs=1e-9 * costs.max() + 1e-18)
        knots = np.concatenate([solved.jets[:, :, 0], solved.jets[:, -1:, 1]], axis=1)
        assert np.array_equal(knots[fixed], values[fixed])
        again = np.concatenate([solved.jets[:, :1, 0], solved.jets[:, :, 1]], axis=1)
        assert np.array_equal(again[fixed], values[fixed])
        shared = continuity + 1
        assert np.array_equal(solved.jets[:, :-1, 1, :shared], solved.jets[:, 1:, 0, :shared])
    assert outcomes[Outcome.SOLVED] > 80 and outcomes[Outcome.NOT_UNIQUE] > 5


def test_any_pattern_in_fifty_digits():
    """Free positions, derivatives fixed inside: the general kernels to 1e-12 too."""
    rng = np.random.default_rng(3)
    for order in (2, 3, 4, 4):
        durations, values, _ = through_waypoints(order, 40, 4.0, axes=1, seed=order)
        drop = rng.random(41) < 0.4
        values[0, drop, 0] = np.nan
        extra = rng.random((41, order)) < 0.1
        values[0][extra] = rng.normal(size=int(extra.sum()))
        fixed = ~np.isnan(values)
        solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
        assert solved.method == "general"
        exact = reference(durations, values[0], order)
        assert abs(solved.objective[0] / exact - 1) <= 1e-12


@pytest.mark.parametrize(
    ("fix", "order", "continuity", "unique"),
    [
        ([], 4, 3, False),
        ([(0, 0), (5, 0), (9, 0)], 4, 3, False),
        ([(0, 0), (5, 0), (9, 0), (2, 0)], 4, 3, True),
        ([(k, 1) for k in range(10)], 4, 3, False),
        ([(0, 0), (0, 1), (0, 2), (0, 3)], 4, 3, True),
        # A parabola through 0 at -1 and 1 has no slope at 0: three conditions that leave it open.
        ([(0, 0), (8, 0), (4, 1)], 3, 2, False),
        ([(0, 0), (9, 0), (4, 1)], 3, 2, True),
        ([(k, 0) for k in range(10)], 4, 0, False),
        # C² cubics have no snap: as splines through the points they are one family with two ends.
        ([(k, 0) for k in range(10)], 4, 2, False),
        ([*((k, 0) for k in range(10)), (0, 1), (9, 1)], 4, 2, True),
    ],
)
def test_singular_problems_are_named(fix, order, continuity, unique):
    fixed = np.zeros((1, 10, order), bool)
    for knot, derivative in fix:
        fixed[0, knot, derivative] = True
    values = np.where(fixed, 0.5, np.nan)
    solved = banded.solve_hermite(np.ones(9), values, fixed, only(order), continuity)
    wanted = Outcome.SOLVED if unique else Outcome.NOT_UNIQUE
    assert solved.outcome is wanted


def test_durations_over_a_hundred_million():
    durations, values, fixed = through_waypoints(8, 50, 1e8, axes=1, kind="alternating")
    solved = banded.solve_hermite(durations, values, fixed, only(8), 7)
    assert solved.method == "boundary"
    times, rows = np.concatenate([[0.0], np.cumsum(durations)]), values[0, :, :, None]
    model = MinimumDerivative(rows[:, 0], times, order=8, start=rows[0, 1:], end=rows[-1, 1:])
    exact = float(hundred_digits.solve(model, 400)[0])  # powers of 1e8 cancel a hundred digits
    assert solved.objective[0] == pytest.approx(exact, rel=1e-12)


def test_ill_conditioned_problems_are_reported(monkeypatch):
    """Corrections as large as the path are no solution."""
    durations, values, fixed = through_waypoints(8, 50, 1e8, axes=1, kind="alternating")

    def undecided(*arguments):
        found = boundary.solve_boundary(*arguments)
        return found._replace(outcome=Outcome.ILL_CONDITIONED)

    monkeypatch.setattr(banded, "solve_boundary", undecided)
    solved = banded.solve_hermite(durations, values, fixed, only(8), 7)
    assert solved.outcome is Outcome.ILL_CONDITIONED
    assert np.isnan(solved.objective).all()


# -- the same by other means ----------------------------------------------------------------------


@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_all_kernels_agree(order, monkeypatch):
    durations, values, fixed = through_waypoints(order, 400)
    problem = (durations, values, fixed, only(order), order - 1)
    quick = banded.solve_hermite(*problem)
    # An error that is not measured proves nothing.
    assert (quick.refinements == 0) == (order < 5) == np.isnan(quick.correction)
    assert np.isfinite(quick.gap) == (order == 5)
    found = {"refined": banded.solve_hermite(*problem, certify=True)}
    monkeypatch.setattr(banded, "is_usual", lambda *_: False)
    found["general"] = banded.solve_hermite(*problem)
    monkeypatch.setattr(banded, "CERTIFIED", -1.0)
    found["boundary"] = banded.solve_hermite(*problem)
    exact = found["boundary"]
    powers = hermite.jets_to_coefficients(durations, exact.jets, exact.moments)
    for name, other in [("refined", quick), *found.items()]:
        assert other.method == name
        assert other.objective == pytest.approx(exact.objective, rel=1e-12)
        assert np.abs(other.jets - exact.jets).max() <= 1e-11 * np.abs(exact.jets).max()
        mine = hermite.jets_to_coefficients(durations, other.jets, other.moments)
        assert np.abs(mine - powers).max() <= 1e-11 * np.abs(powers).max()


@pytest.mark.parametrize("ratio", [4.0, 400.0])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_refinement_in_plain_python_means_the_same(order, ratio):
    durations, values, _ = through_waypoints(order, 12, ratio)
    table = hermite.table_of(only(order))
    for certify in (False, True):
        results = []
        for function in (refined, refined.py_func):
            jets, objective = np.empty((3, 12, 2, order)), np.empty(3)
            room = np.empty((12, 2, order - 1, order - 1)), np.empty((3, 12, order - 1))
            failed, steps, correction, *_ = function(
                tuple(range(1, order)), durations, values, table.rows, table.factors, certify, jets,
                objective, *room,
            )  # fmt: skip
            assert failed == -1 and correction <= hermite.CERTIFIED
            assert steps >= certify
            results.append((steps, jets, objective))
        # Compiled code may not reorder, but a power may be rounded otherwise.
        assert results[0][0] == results[1][0]
        assert results[0][1] == pytest.approx(results[1][1], rel=1e-11, abs=1e-13)
        assert results[0][2] == pytest.approx(results[1][2], rel=1e-14)


def test_negligible_pivots_are_reported():
    durations, values, _ = through_waypoints(4, 6, 1e6, kind="alternating")
    table = hermite.table_of(only(4))
    room = np.empty((6, 2, 3, 3)), np.empty((3, 6, 3))
    failed, *_ = refined(
        (1, 2, 3), durations, values, table.rows, table.factors, True, np.empty((3, 6, 2, 4)),
        np.empty(3), *room,
    )  # fmt: skip
    assert failed > 0


def test_the_gradient_in_plain_python_means_the_same():
    durations, values, fixed = through_waypoints(4, 8, 400.0)
    jets = np.where(fixed, values, 0.5)
    jets = np.stack([jets[:, :-1], jets[:, 1:]], axis=2)
    table = hermite.table_of(only(4))
    results = []
    for function in (moment_kernels.differentiate, moment_kernels.differentiate.py_func):
        out = [np.empty(shape) for shape in ((3, 8, 2, 4), (3, 8, 2, 4), (3, 8, 4), (3,))]
        function(durations, *table, jets, np.zeros_like(jets), *out)
        results.append(out)
    for place, (one, other) in enumerate(zip(*results, strict=True)):
        # What rounding left of forces is compared with the forces.
        size = np.abs(results[0][0]).max() if place == 1 else 0.0
        assert one == pytest.approx(other, rel=1e-13, abs=1e-16 * size)
