"""The native minimum-derivative solver: against 50 digits, SciPy, brute force, and its own laws."""

import json
import math
import os
import subprocess
import sys

import mpmath
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings, strategies as st
from scipy.interpolate import make_interp_spline

from crosstrack.solvers.minimum_snap import banded, banded_fallback, banded_kernels, hermite
from crosstrack.solvers.minimum_snap.hermite import Outcome

SOLVERS = {
    "compiled": banded_fallback.solver(compiled=True),
    "numpy": banded_fallback.solver(compiled=False),
}


# -- problems -------------------------------------------------------------------------------------


def only(order):
    """Weights of the highest order alone."""
    return np.eye(order)[-1]


def through_waypoints(order, count, ratio=4.0, axes=3, seed=0, kind="any"):
    """Durations, values and pattern: positions fixed, ends fixed, all else free (NaN)."""
    rng = np.random.default_rng(seed)
    if kind == "alternating":
        durations = np.where(np.arange(count) % 2, ratio, 1.0)
    else:
        durations = np.exp(rng.uniform(0.0, math.log(ratio), count))
    values = np.full((axes, count + 1, order), np.nan)
    values[:, :, 0] = np.cumsum(rng.normal(size=(axes, count + 1)), axis=1)
    values[:, [0, -1], 1:] = rng.normal(size=(axes, 2, order - 1))
    return durations, values, ~np.isnan(values)


def random_problem(rng, most_order=5, most_segments=6):
    """Any pattern, weights and continuity: what :func:`solve_hermite` takes."""
    order = int(rng.integers(1, most_order + 1))
    count, axes = int(rng.integers(1, most_segments + 1)), int(rng.integers(1, 4))
    continuity = int(rng.integers(max(0, order - 3), order))
    fixed = rng.random((axes, count + 1, order)) < rng.choice([0.2, 0.5, 0.8])
    if rng.random() < 0.5:
        fixed[:] = fixed[:1]
    if rng.random() < 0.7:
        fixed[:, :, 0] = True
    values = np.where(fixed, rng.normal(size=fixed.shape), np.nan)
    weights = only(order) * rng.uniform(0.5, 2.0)
    if rng.random() < 0.4:
        weights += rng.uniform(0.0, 1.0, order) * (rng.random(order) < 0.5)
    durations = np.exp(rng.uniform(0.0, math.log(4.0), count))
    return durations, values, fixed, weights, continuity


# -- references -----------------------------------------------------------------------------------


def unit_hessian(order):
    """Hessian of ∫ (x^(r))² ds by the derivatives at 0 and 1, from monomials, in mpmath."""
    size = 2 * order
    ends = mpmath.zeros(size)
    cost = mpmath.zeros(size)
    for p in range(size):
        for j in range(order):
            ends[j, p] = math.factorial(j) if p == j else 0
            ends[order + j, p] = math.perm(p, j)
        for q in range(size):
            if p >= order and q >= order:
                cost[p, q] = mpmath.mpf(math.perm(p, order) * math.perm(q, order)) / (
                    p + q - 2 * order + 1
                )
    powers = ends**-1
    return (powers.T * cost * powers).tolist()


def reference(durations, values, order, fixed=None):
    """Return J in 50 digits for one axis: block elimination, fixed entries as rows of identity.

    Derived from monomials; nothing of the package is used.
    """
    with mpmath.workdps(50):
        unit = unit_hessian(order)
        one, zero = mpmath.mpf(1), mpmath.mpf(0)
        if fixed is None:
            fixed = ~np.isnan(values)
        places = range(order)
        carried = [[zero] * order for _ in places]
        load = [zero] * order
        total = zero
        long = [d if isinstance(d, mpmath.mpf) else mpmath.mpf(float(d)) for d in durations]
        given = [[mpmath.mpf(float(v)) if f else zero for v, f in zip(vs, fs, strict=True)]
                 for vs, fs in zip(values, fixed, strict=True)]  # fmt: skip
        for k in range(len(long) + 1):
            block, right = carried, load
            coupling = [[zero] * order for _ in places]
            carried, load = [[zero] * order for _ in places], [zero] * order
            if k < len(long):
                power = [long[k] ** n for n in range(1 - 2 * order, 1)]
                held = [*given[k], *given[k + 1]]
                free = [*~fixed[k], *~fixed[k + 1]]
                for p in range(2 * order):
                    for q in range(2 * order):
                        i, j = p % order, q % order
                        entry = unit[p][q] * power[i + j]
                        total += held[p] * entry * held[q]
                        if not free[p]:
                            continue
                        if p < order:
                            right[i] -= entry * held[q]
                        else:
                            load[i] -= entry * held[q]
                        if free[q] and p < order:
                            (block if q < order else coupling)[i][j] += entry
                        elif free[q] and q >= order:
                            carried[i][j] += entry
            for i in places:
                if fixed[k, i]:
                    block[i][i] = one
            # Gauss-Jordan on [block | coupling, right].
            table = [[*block[i], *coupling[i], right[i]] for i in places]
            for p in places:
                pivot = table[p][p]
                table[p] = [v / pivot for v in table[p]]
                for i in places:
                    if i != p and table[i][p]:
                        share = table[i][p]
                        table[i] = [v - share * w for v, w in zip(table[i], table[p], strict=True)]
            total -= sum(right[i] * table[i][-1] for i in places)
            for i in places:
                for j in places:
                    carried[i][j] -= sum(coupling[p][i] * table[p][order + j] for p in places)
                load[i] -= sum(coupling[p][i] * table[p][-1] for p in places)
        return total


def cost_in_digits(durations, coefficients, order):
    """Return J of the polynomials as they are written down, one axis, in 50 digits."""
    with mpmath.workdps(50):
        total = mpmath.mpf(0)
        powers = range(order, 2 * order)
        for long, own in zip(durations, coefficients, strict=True):
            exact = [mpmath.mpf(float(c)) for c in own]
            part = mpmath.mpf(0)
            for p in powers:
                for q in powers:
                    factor = mpmath.mpf(math.perm(p, order) * math.perm(q, order))
                    part += exact[p] * exact[q] * factor / (p + q - 2 * order + 1)
            total += part * mpmath.mpf(float(long)) ** (1 - 2 * order)
        return total


def brute_force(durations, values, fixed, weights, continuity):
    """Return J of one axis and how many directions are left open, by monomials and quadrature."""
    order, count = len(weights), len(durations)
    size = 2 * order
    nodes, shares = np.polynomial.legendre.leggauss(size)
    nodes, shares = (nodes + 1) / 2, shares / 2

    def derivative(at, j):
        return np.array([[math.perm(p, j) * s ** (p - j) if p >= j else 0.0 for p in range(size)]
                         for s in np.atleast_1d(at)])  # fmt: skip

    cost, rules, right = [], [], []
    for k, long in enumerate(durations):
        for j, weight in enumerate(weights, start=1):
            rows = np.zeros((size, count * size))
            scale = np.sqrt(weight * shares * long ** (1 - 2 * j))
            rows[:, k * size : (k + 1) * size] = scale[:, None] * derivative(nodes, j)
            cost.append(rows)
        for end in (0, 1):
            for j in range(order):
                row = np.zeros(count * size)
                row[k * size : (k + 1) * size] = derivative(end, j)[0] / long**j
                if fixed[k + end, j]:
                    rules.append(row)
                    right.append(values[k + end, j])
                elif end == 1 and k + 1 < count and j <= continuity:
                    row[(k + 1) * size : (k + 2) * size] = (
                        -derivative(0, j)[0] / durations[k + 1] ** j
                    )
                    rules.append(row)
                    right.append(0.0)
    cost = np.concatenate(cost)
    start, open_ = np.zeros(count * size), np.eye(count * size)
    if rules:
        rules = np.array(rules)
        start = np.linalg.lstsq(rules, np.array(right), rcond=None)[0]
        open_ = scipy.linalg.null_space(rules)
    reduced = cost @ open_
    if open_.shape[1] == 0:
        return float(np.sum((cost @ start) ** 2)), 0
    found, _, rank, _ = np.linalg.lstsq(reduced, -cost @ start, rcond=1e-10)
    return float(np.sum((cost @ start + reduced @ found) ** 2)), open_.shape[1] - rank


def worst_jumps(durations, coefficients, highest):
    """Jumps of every derivative at inner knots, relative to its largest value on that axis."""
    found = []
    powers = range(coefficients.shape[1])
    for j in range(highest + 1):
        values = []
        for s in np.linspace(0.0, 1.0, 9):
            row = np.array([math.perm(p, j) * s ** (p - j) if p >= j else 0.0 for p in powers])
            scale = durations[:, None] ** -float(j)
            values.append(np.einsum("p,kpa->ka", row, coefficients) * scale)
        jump = np.abs(values[-1][:-1] - values[0][1:]).max(axis=0, initial=0.0)
        found.append((jump / np.abs(values).max(axis=(0, 1))).max())
    return np.array(found)


# -- against the references -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "count", "ratio", "kind"),
    [
        (3, 150, 400.0, "any"),
        (2, 150, 400.0, "alternating"),
        (6, 30, 400.0, "any"),
        (4, 1000, 4.0, "any"),
        (4, 1000, 4.0, "alternating"),
        (4, 1000, 400.0, "any"),
        (4, 1000, 400.0, "alternating"),
        (3, 1000, 400.0, "any"),
    ],
)
def test_fifty_digits(order, count, ratio, kind):
    """Objective to 1e-12, all derivatives up to 2r-2 continuous: to 1e-11, 1e-10 for wild times."""
    durations, values, fixed = through_waypoints(order, count, ratio, axes=1, kind=kind)
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    assert solved.info["outcome"] is Outcome.SOLVED
    exact = reference(durations, values[0], order)
    assert abs(solved.objective[0] / exact - 1) <= 1e-12
    coefficients = banded.jets_to_coefficients(durations, solved.jets, solved.info["lows"])
    assert abs(cost_in_digits(durations, coefficients[:, :, 0], order) / exact - 1) <= 1e-12
    closed = hermite.objective_of_coefficients(durations, coefficients, only(order))
    assert abs(closed[0] / exact - 1) <= 1e-12
    allowed = 1e-11 if ratio <= 4 else 1e-10
    assert worst_jumps(durations, coefficients, 2 * order - 2).max() <= allowed


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("ratio", [1.0001, 4.0, 400.0])
def test_jumps_of_many_paths(order, ratio):
    for seed in range(20):
        kind = "alternating" if seed % 2 else "any"
        durations, values, fixed = through_waypoints(order, 300, ratio, seed=seed, kind=kind)
        solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
        assert solved.info["residual"] <= hermite.ACCEPTED
        coefficients = banded.jets_to_coefficients(durations, solved.jets, solved.info["lows"])
        allowed = 1e-11 if ratio <= 4 else 1e-10
        assert worst_jumps(durations, coefficients, 2 * order - 2).max() <= allowed


@pytest.mark.parametrize("order", [2, 3, 4, 5])
@pytest.mark.parametrize("count", [1, 2, 1000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_it_is_scipys_spline(order, count):
    durations, values, fixed = through_waypoints(order, count, 2.0)
    times = np.concatenate([[0.0], np.cumsum(durations)])
    # SciPy is told times, and their differences are what it can know.
    durations = np.diff(times)
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    # SciPy wants more points than its degree.
    if count + 1 + 2 * (order - 1) < 2 * order:
        pytest.skip("too few points")
    conditions = [[(j, values[:, end, j]) for j in range(1, order)] for end in (0, -1)]
    spline = make_interp_spline(times, values[:, :, 0].T, k=2 * order - 1, bc_type=conditions)
    for j in range(order):
        mine = np.concatenate([solved.jets[:, :, 0, j], solved.jets[:, -1:, 1, j]], axis=1)
        # Its absolute times cost it digits that grow with the path.
        allowed = 1e-15 * max(count, 1000) * 10**order
        assert np.abs(mine - spline(times, j).T).max() <= allowed * np.abs(mine).max()


@pytest.mark.parametrize("name", SOLVERS)
def test_brute_force(name):
    """Any pattern of fixed entries, weights and continuity; and whether the optimum is unique."""
    rng = np.random.default_rng(7)
    outcomes = {Outcome.SOLVED: 0, Outcome.NOT_UNIQUE: 0, Outcome.ILL_CONDITIONED: 0}
    for _ in range(150):
        problem = random_problem(rng)
        durations, values, fixed, weights, continuity = problem
        solved = SOLVERS[name].solve_hermite(*problem)
        outcomes[solved.info["outcome"]] += 1
        found = [
            brute_force(durations, v, f, weights, continuity)
            for v, f in zip(values, fixed, strict=True)
        ]
        unique = all(missing == 0 for _, missing in found)
        assert (solved.info["outcome"] is Outcome.SOLVED) == unique
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
    """Free positions, derivatives fixed inside: the frontal path to 1e-12 too."""
    rng = np.random.default_rng(3)
    for order in (2, 3, 4, 4):
        durations, values, _ = through_waypoints(order, 40, 4.0, axes=1, seed=order)
        drop = rng.random(41) < 0.4
        values[0, drop, 0] = np.nan
        extra = rng.random((41, order)) < 0.1
        values[0][extra] = rng.normal(size=int(extra.sum()))
        fixed = ~np.isnan(values)
        solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
        assert solved.info["method"] in ("frontal", "precise")
        exact = reference(durations, values[0], order)
        assert abs(solved.objective[0] / exact - 1) <= 1e-12


@pytest.mark.parametrize("name", SOLVERS)
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
def test_singular_problems_are_named(name, fix, order, continuity, unique):
    fixed = np.zeros((1, 10, order), bool)
    for knot, derivative in fix:
        fixed[0, knot, derivative] = True
    values = np.where(fixed, 0.5, np.nan)
    solved = SOLVERS[name].solve_hermite(np.ones(9), values, fixed, only(order), continuity)
    wanted = Outcome.SOLVED if unique else Outcome.NOT_UNIQUE
    assert solved.info["outcome"] is wanted


def test_what_cannot_be_told_is_not_guessed():
    durations, values, fixed = through_waypoints(8, 50, 1e8, kind="alternating")
    solved = banded.solve_hermite(durations, values, fixed, only(8), 7)
    assert solved.info["outcome"] is Outcome.ILL_CONDITIONED
    assert np.isnan(solved.objective).all()


# -- the same by other means ----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_fallback_is_the_same(seed):
    rng = np.random.default_rng(100 + seed)
    for _ in range(12):
        problem = random_problem(rng)
        one, other = (SOLVERS[name].solve_hermite(*problem) for name in SOLVERS)
        assert one.info["outcome"] is other.info["outcome"]
        if one.info["outcome"] is Outcome.SOLVED:
            scale = max(np.abs(one.jets).max(), 1e-300)
            assert np.abs(one.jets - other.jets).max() <= 1e-9 * scale
            largest = max(one.objective.max(), 1e-5)  # where nothing costs, only rounding differs
            assert one.objective == pytest.approx(other.objective, rel=1e-11, abs=1e-11 * largest)


@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_fallback_is_the_same_on_waypoints(order):
    durations, values, fixed = through_waypoints(order, 400)
    one, other = (
        SOLVERS[name].solve_hermite(durations, values, fixed, only(order), order - 1)
        for name in SOLVERS
    )
    assert one.objective == pytest.approx(other.objective, rel=1e-11)
    assert np.abs(one.jets - other.jets).max() <= 1e-11 * np.abs(one.jets).max()
    powers = [
        SOLVERS["compiled"].jets_to_coefficients(durations, one.jets),
        SOLVERS["numpy"].jets_to_coefficients(durations, one.jets),
    ]
    assert np.abs(powers[0] - powers[1]).max() <= 1e-11 * np.abs(powers[0]).max()


@pytest.mark.parametrize(
    ("order", "fused"),
    [(2, banded_kernels.accelerate), (3, banded_kernels.jerk), (4, banded_kernels.snap)],
)
def test_plain_python_means_the_same(order, fused):
    durations, values, _ = through_waypoints(order, 30)
    results = []
    for function in (fused, fused.py_func):
        jets, objective = np.empty((3, 30, 2, order)), np.empty(3)
        upper, work = np.empty((30, (order - 1) ** 2)), np.empty((3, 30, 3))
        residual, failed, _ = function(durations, values, jets, objective, upper, work)
        assert residual < 1e-11 and failed == -1
        results.append((jets, objective))
    # Compiled code may not reorder, but a power may be rounded otherwise.
    assert results[0][0] == pytest.approx(results[1][0], rel=1e-11, abs=1e-13)
    assert results[0][1] == pytest.approx(results[1][1], rel=1e-14)


UNCOMPILED = """
import json, sys
if {without}:
    sys.modules["numba"] = None
import numpy as np
from crosstrack.solvers.minimum_snap.banded_fallback import solver
chosen = solver()
durations = np.array([1.0, 300.0, 2.0, 1.5])
values = np.full((2, 5, 4), np.nan)
values[:, :, 0] = [[0, 1, -1, 2, 3], [0, 2, 1, 0, 1]]
values[:, [0, -1], 1:] = 0.0
answers = []
for continuity in (3, 2):
    found = chosen.solve_hermite(
        durations, values, ~np.isnan(values), np.array([0.0, 0.0, 0.0, 1.0]), continuity
    )
    answers.append([found.info["method"], found.objective.tolist(), found.jets.tolist()])
json.dump([chosen.compiled, answers], sys.stdout)
"""


def test_without_compilation_and_without_numba():
    outputs = []
    for disabled, without in (("0", False), ("1", False), ("0", True)):
        done = subprocess.run(
            [sys.executable, "-c", UNCOMPILED.format(without=without)],
            capture_output=True, text=True, timeout=240, check=True,
            env={**os.environ, "NUMBA_DISABLE_JIT": disabled},
        )  # fmt: skip
        outputs.append(json.loads(done.stdout))
    (_, compiled), (_, plain), (native, fallback) = outputs
    assert [output[0] for output in outputs] == [True, True, False] and not native
    assert [answer[0] for answer in fallback] == ["scipy", "scipy"]
    for one, same, other in zip(compiled, plain, fallback, strict=True):
        assert one[0] == same[0]
        assert np.array(one[1]) == pytest.approx(np.array(same[1]), rel=1e-13)
        assert np.array(one[1]) == pytest.approx(np.array(other[1]), rel=1e-11)
        assert np.array(one[2]) == pytest.approx(np.array(same[2]), rel=1e-9, abs=1e-11)


# -- laws -----------------------------------------------------------------------------------------


@st.composite
def paths(draw, most=6):
    """Positions fixed at all knots; at inner knots some derivatives too."""
    order = draw(st.integers(2, 5))
    count = draw(st.integers(1, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    durations, values, fixed = through_waypoints(order, count, 4.0, 2, seed=rng)
    if draw(st.booleans()):
        more = rng.random((count + 1, order)) < 0.2
        values[:, more] = rng.normal(size=(2, int(more.sum())))
        fixed = ~np.isnan(values)
    return durations, values, fixed, only(order), order - 1


LAWS = settings(max_examples=40, deadline=None)


def solve(problem):
    solved = banded.solve_hermite(*problem)
    assert solved.info["outcome"] is Outcome.SOLVED
    return solved


@given(paths(), st.floats(-1e3, 1e3))
@LAWS
def test_moving_the_path_changes_nothing(problem, shift):
    durations, values, *rest = problem
    moved = values.copy()
    moved[:, :, 0] += shift
    # What the sum was rounded to is what both are given.
    back = values.copy()
    back[:, :, 0] = moved[:, :, 0] - shift
    one, other = solve((durations, back, *rest)), solve((durations, moved, *rest))
    assert one.objective == pytest.approx(other.objective, rel=1e-9, abs=1e-12)
    difference = one.jets[..., 1:] - other.jets[..., 1:]
    assert np.abs(difference).max() <= 1e-9 * max(np.abs(one.jets[..., 1:]).max(), 1e-3)


@given(paths(), st.floats(0.01, 100.0))
@LAWS
def test_stretching_time_scales_the_objective(problem, factor):
    durations, values, fixed, weights, continuity = problem
    order = len(weights)
    slower = values / factor ** np.arange(order)
    one = solve(problem)
    other = solve((durations * factor, slower, fixed, weights, continuity))
    assert other.objective * factor ** (2 * order - 1) == pytest.approx(one.objective, rel=1e-10)


@given(paths())
@LAWS
def test_backwards_is_the_same(problem):
    durations, values, fixed, weights, continuity = problem
    signs = (-1.0) ** np.arange(len(weights))
    back = solve((durations[::-1], values[:, ::-1] * signs, fixed[:, ::-1], weights, continuity))
    one = solve(problem)
    assert back.objective == pytest.approx(one.objective, rel=1e-10)
    turned = back.jets[:, ::-1, ::-1] * signs
    assert np.abs(turned - one.jets).max() <= 1e-9 * np.abs(one.jets).max()


@given(paths(), st.integers(0, 5), st.floats(0.2, 0.8))
@LAWS
def test_a_waypoint_on_the_optimum_changes_nothing(problem, segment, share):
    durations, values, _, weights, continuity = problem
    segment %= len(durations)
    one = solve(problem)
    powers = banded.jets_to_coefficients(durations, one.jets)[segment]
    there = np.einsum("p,pa->a", share ** np.arange(len(powers)), powers)
    long = durations[segment]
    split = np.insert(durations, segment, share * long)
    split[segment + 1] = (1.0 - share) * long
    row = np.full((len(values), 1, len(weights)), np.nan)
    row[:, 0, 0] = there
    more = np.concatenate([values[:, : segment + 1], row, values[:, segment + 1 :]], axis=1)
    other = solve((split, more, ~np.isnan(more), weights, continuity))
    assert other.objective == pytest.approx(one.objective, rel=1e-7, abs=1e-12)


@given(paths(), st.randoms(use_true_random=False))
@LAWS
def test_fixing_what_is_optimal_changes_nothing(problem, random):
    durations, values, fixed, weights, continuity = problem
    one = solve(problem)
    knots = np.concatenate([one.jets[:, :, 0], one.jets[:, -1:, 1]], axis=1)
    more = fixed.copy()
    for knot in range(values.shape[1]):
        for i in range(values.shape[2]):
            more[:, knot, i] |= random.random() < 0.3
    other = solve((durations, np.where(more, knots, np.nan), more, weights, continuity))
    assert other.objective == pytest.approx(one.objective, rel=1e-10)
    assert np.abs(other.jets - one.jets).max() <= 1e-8 * np.abs(one.jets).max()


@given(paths(), st.integers(0, 2**32 - 1), st.floats(1e-3, 1.0))
@LAWS
def test_nothing_nearby_is_better(problem, seed, size):
    durations, _, fixed, weights, _ = problem
    one = solve(problem)
    rng = np.random.default_rng(seed)
    step = np.where(fixed, 0.0, size * rng.normal(size=fixed.shape))
    other = one.jets + np.stack([step[:, :-1], step[:, 1:]], axis=2)
    costs = hermite.objective_of_jets(durations, other, weights)
    assert (costs >= one.objective * (1 - 1e-13)).all()


def test_axes_with_other_patterns_are_solved_apart():
    durations, values, fixed = through_waypoints(4, 20, axes=4)
    fixed[2, 7, 0] = False
    fixed[3, 3, 1] = True
    values[3, 3, 1] = 0.25
    together = banded.solve_hermite(durations, values, fixed, only(4), 3)
    assert together.info["factorisations"] == 3
    for a in range(4):
        own = slice(a, a + 1)
        alone = banded.solve_hermite(durations, values[own], fixed[own], only(4), 3)
        assert alone.objective[0] == pytest.approx(together.objective[a], rel=1e-12)


def test_free_and_equal_entries_cost_nothing():
    values = np.full((1, 6, 3), 7.0)
    values[:, :, 1:] = 0.0
    solved = banded.solve_hermite(np.ones(5), values, values == 7.0, only(3), 2)
    assert solved.info["outcome"] is Outcome.SOLVED
    assert solved.objective[0] == 0.0


# -- gradient of durations ------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_duration_gradient(order):
    """Central differences of the optimal value in 50 digits: the envelope theorem."""
    durations, values, fixed = through_waypoints(order, 5, axes=2)
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    apart = hermite.duration_gradient(durations, solved.jets, only(order), per_axis=True)
    summed = hermite.duration_gradient(durations, solved.jets, only(order))
    assert apart.sum(axis=0) == pytest.approx(summed, rel=1e-13)
    with mpmath.workdps(50):
        step = mpmath.mpf(10) ** -15
        for axis in range(2):
            for k in range(5):
                sides = []
                for sign in (1, -1):
                    moved = [mpmath.mpf(float(d)) for d in durations]
                    moved[k] += sign * step
                    sides.append(reference(moved, values[axis], order))
                slope = float((sides[0] - sides[1]) / (2 * step))
                assert apart[axis, k] == pytest.approx(slope, rel=1e-9)


def test_duration_gradient_with_several_weights():
    rng = np.random.default_rng(2)
    weights = np.array([0.3, 0.0, 2.0, 1.0])
    durations = rng.uniform(0.5, 2.0, 6)
    jets = rng.normal(size=(2, 6, 2, 4))
    found = hermite.duration_gradient(durations, jets, weights)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        ahead, behind = (
            hermite.objective_of_jets(durations + sign * step, jets, weights).sum()
            for sign in (1, -1)
        )
        assert found[k] == pytest.approx((ahead - behind) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_from_rest_to_rest_the_gradient_sums_up_to_the_objective(order):
    """Σ T_k dJ/dT_k = (1 - 2r) J, since J scales with T^(1 - 2r)."""
    durations, values, fixed = through_waypoints(order, 50)
    values[:, [0, -1], 1:] = 0.0
    solved = banded.solve_hermite(durations, values, fixed, only(order), order - 1)
    slope = hermite.duration_gradient(durations, solved.jets, only(order), per_axis=True)
    assert slope @ durations == pytest.approx((1 - 2 * order) * solved.objective, rel=1e-10)
