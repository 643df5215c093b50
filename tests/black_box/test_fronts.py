"""Several objectives: ``nsga-ii`` and the archive, against closed fronts."""

import itertools
import math
import time

import numpy as np
import pytest
from black_box.searches import box, search

import crosstrack as ct
from crosstrack.models.black_box import PythonFunction
from crosstrack.models.black_box.fronts import hypervolume, non_dominated
from crosstrack.solvers import Termination, find_backend
from crosstrack.solvers.black_box.archive import Archive

PYMOO = pytest.mark.skipif(
    bool(find_backend("nsga-ii").missing()), reason="needs crosstrack[blackbox]"
)


def zdt1(x):
    """Zitzler, Deb and Thiele (2000): the front is f2 = 1 - sqrt(f1)."""
    g = 1 + 9 * x[:, 1:].mean(1)
    return np.column_stack([x[:, 0], g * (1 - np.sqrt(x[:, 0] / g))])


def dtlz2(x):
    """Deb, Thiele, Laumanns and Zitzler (2002): the front is an eighth of the unit sphere."""
    g = ((x[:, 2:] - 0.5) ** 2).sum(1)
    a, b = x[:, 0] * np.pi / 2, x[:, 1] * np.pi / 2
    parts = np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)
    return (1 + g)[:, None] * np.column_stack(parts)


@PYMOO
@pytest.mark.parametrize(
    ("function", "dimension", "reference", "volume", "share", "budget"),
    [
        pytest.param(zdt1, 10, [1.1, 1.1], 1.21 - 1 / 3, 0.98, 6000, marks=pytest.mark.slow),
        (dtlz2, 7, [1.1] * 3, 1.331 - math.pi / 6, 0.85, 3000),
    ],
)
def test_fronts_with_a_closed_form(function, dimension, reference, volume, share, budget):
    model = box(
        PythonFunction(function, vectorized=True), *[(0, 1)] * dimension,
        objectives=len(reference), reference=reference, budget=budget,
    )  # fmt: skip
    answer, _ = search("nsga-ii", model, seed=1)
    assert -volume < answer.primal_bound < -share * volume
    checked = model.verify(answer.point)
    assert checked.ok and checked.objective == pytest.approx(answer.primal_bound, rel=1e-12)
    assert answer.point.x in answer.point.front and len(answer.point.front) <= 100


@PYMOO
def test_a_front_with_constraints_and_kinds_equals_enumeration():
    """All points are known: 11 integers times 3 categories."""

    def function(x):
        return [x[0] + 3 * x[1], (10 - x[0]) * (3 - x[1]), 2 - x[0] * (x[1] + 1)]

    kinds = ["integer", {"type": "category", "values": ["a", "b", "c"]}]
    model = box(
        function, (0, 10), (0, 2), variables=kinds, inequalities=1, objectives=2, reference=[20, 40],
        budget=1500,
    )  # fmt: skip
    rows = np.array([function((i, j)) for i in range(11) for j in range(3)])
    best = hypervolume(rows[rows[:, 2] <= 0, :2], np.array([20.0, 40.0]))
    answer, _ = search("nsga-ii", model, seed=1)
    assert model.verify(answer.point).ok and answer.primal_bound == -best


@PYMOO
def test_a_solution_with_a_front_is_verified_and_written():
    model = box(
        lambda x: [x[0], 1 - x[0]], (0, 1), (0, 1), objectives=2, reference=[1.1, 1.1], budget=300
    )
    found = ct.solve(model, seed=1, evaluations=200)
    assert found.backend == "nsga-ii" and found.statistics["evaluations"] == 200
    assert found.verification.ok and found.primal_bound < -0.6
    again = ct.solve(model, "nsga-ii", seed=1, warm_start=found.plan, evaluations=50)
    assert again.primal_bound < -0.5, (
        "all points of the front are evaluated first, as far as allowed"
    )
    noisy = box(
        lambda x: [x[0], 1 - x[0]],
        (0, 1),
        objectives=2,
        reference=[1, 1],
        budget=9,
        samples=3,
        repeats=3,
    )
    assert ct.solve(noisy, "random-search", seed=1).verification.spread == 0.0


@pytest.mark.parametrize("name", ["random-search", pytest.param("nsga-ii", marks=PYMOO)])
def test_nothing_better_than_the_reference_is_no_plan(name):
    model = box(lambda x: [x[0], 1 - x[0]], (0, 1), objectives=2, reference=[0, 0], budget=50)
    answer, _ = search(name, model)
    assert answer.termination is Termination.NO_SOLUTION and "reference" in answer.message


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_the_hypervolume_equals_inclusion_and_exclusion(m):
    """Ties, duplicates, dominated rows and rows beyond the reference, in scales from 1e-6 to 1e6."""
    generator = np.random.default_rng(m)
    reference = 10.0 ** np.arange(-6, 7, 4)[:m]
    for count in (0, 1, 9):
        rows = np.round(generator.random((count, m)) * 6) / 5 * reference
        inside = rows[(rows < reference).all(1)]
        expected = sum(
            (-1) ** (size + 1) * np.prod(reference - np.max(chosen, axis=0))
            for size in range(1, len(inside) + 1)
            for chosen in itertools.combinations(inside, size)
        )
        assert hypervolume(rows, reference) == pytest.approx(expected, rel=1e-12)


def test_three_hundred_rows_of_four_objectives_take_milliseconds():
    rows = np.abs(np.random.default_rng(0).normal(size=(400, 4)))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    archive = Archive(np.full(4, 1.1), 300)
    begin = time.process_time()
    assert archive.add(rows, rows, np.ones(400, bool)) and len(archive.x) == 300
    assert time.process_time() - begin < 0.5  # 1 s by slabs of three objectives each


def test_the_archive_keeps_the_largest_volume():
    generator = np.random.default_rng(3)
    for m in (2, 3):
        archive, reference = Archive(np.ones(m), 12), np.ones(m)
        previous, rows = 0.0, np.empty((0, m))
        for _ in range(30):
            x, values = generator.random((10, 2)), generator.random((10, m))
            feasible = generator.random(10) < 0.8
            better = archive.add(x, values, feasible)
            rows = np.vstack([rows, values[feasible]])
            assert archive.volume >= previous and better is (archive.volume > previous)
            previous = archive.volume
            assert (
                len(archive.x) == len(archive.values) <= 12 and non_dominated(archive.values).all()
            )
            assert archive.volume == hypervolume(archive.values, reference)
            assert archive.volume <= hypervolume(rows, reference) * (1 + 1e-12)
            assert archive.compromise().tolist() in archive.x.tolist()
        assert archive.volume > 0.9 * hypervolume(rows, reference)


def test_the_hypervolume_of_extreme_units_is_finite():
    """Products of two lengths overflow before the product of all is 1."""
    sizes = np.array([1e200, 1e200, 1e-200, 1e-200])
    assert hypervolume(-sizes[None], np.zeros(4)) == pytest.approx(1.0, rel=1e-12)
    assert hypervolume(np.array([[-1e300, -1e300, 0.0], [0.0, 0.0, -1e307]]), np.ones(3)) == np.inf
