"""The paper's rows: the public points of rows 7-9 with their proven optima, and rows by seed."""

import csv
from pathlib import Path

import pytest

import crosstrack as ct
import crosstrack.models.resource_routing.arcs
from crosstrack.models import ErrorCorrectionRouting

POINTS = (
    Path(__file__).resolve().parents[3] / "shared" / "data" / "error-correction" / "points_327.csv"
)

#: Thresholds with the optimum, its corrections and its route, proven by several exact methods.
ROWS = {
    7: ((20, 10, 15, 20, 20), 109342.281, "0-163-114-8-309-305-123-45-160-92-93-61-292-326"),
    8: ((25, 15, 20, 25, 30), 106545.931, "0-163-114-234-309-305-123-45-160-92-93-61-326"),
    9: ((50, 50, 50, 50, 50), 103251.457, "0-114-305-45-160-326"),
}

real = pytest.mark.skipif(
    not POINTS.exists(), reason=f"public data {POINTS.name} is not beside the checkout"
)


def load(row):
    with POINTS.open() as file:
        table = list(csv.DictReader(file))
    points = [[float(line[axis]) for axis in "xyz"] for line in table]
    return ErrorCorrectionRouting(
        points, [line["kind"] for line in table], *ROWS[row][0], delta=0.001, name=f"real/{row}"
    )


def agreed(models, backends, **options):
    """Compare in one call, so that each backend's worker serves all models; return the verdicts."""
    result = ct.compare(models, backends, **options)
    for verdict in result.verdicts:
        assert verdict.outcome == "AGREED", verdict
        assert all(solution.termination == "optimal" for solution in verdict.solutions), verdict
    assert len(result.verdicts) == len(models)
    return result.verdicts


@real
@pytest.mark.parametrize("rows", [(7,), pytest.param((7, 8, 9), marks=pytest.mark.slow)])
def test_exact_backends_agree_on_the_real_rows(rows):
    for row in rows:
        model, (_, optimum, route) = load(row), ROWS[row]
        for name in ("label-setting", "two-stage", "pulse", "dynamic-programming"):
            solution = ct.solve(model, name, time_limit=100, isolate=False)
            assert solution.termination == "optimal", solution
            assert solution.primal_bound == pytest.approx(optimum, abs=6e-4)
            assert solution.dual_bound == pytest.approx(optimum, rel=2e-6)
            assert str(solution.plan) == route


@real
@pytest.mark.parametrize(
    "programs",
    [("highs",), pytest.param(("scip", "ortools", "scipy", "cvxpy"), marks=pytest.mark.slow)],
)
def test_arc_flow_proves_the_real_rows_from_a_native_bound(programs):
    models = [load(row) for row in ROWS]
    start = [ct.solve(model).plan for model in models]
    verdicts = agreed(models, programs, time_limit=60, warm_start=start)
    for (_, optimum, _), verdict in zip(ROWS.values(), verdicts, strict=True):
        for solution in verdict.solutions:
            assert solution.primal_bound == pytest.approx(optimum, abs=6e-4)


@real
@pytest.mark.parametrize("row", ROWS)
def test_the_real_routes_satisfy_the_papers_program(row):
    model = load(row)
    route = model.plan_from_data([int(k) for k in ROWS[row][2].split("-")])
    found = ct.verify(model, route, formulation="paper", tolerance=1e-9)
    assert found.ok, found
    assert found.objective == pytest.approx(ROWS[row][1], abs=6e-4)


@pytest.mark.parametrize("rows", [(1,), pytest.param(range(1, 13), marks=pytest.mark.slow)])
def test_rows_by_seed_have_equal_results(rows):
    models = [ct.load(f"error-correction/{row}") for row in rows]
    start = [ct.solve(model) for model in models]
    backends = ["label-setting", "two-stage", "highs:arc-flow"]
    agreed(models, backends, time_limit=100, warm_start=start)


@pytest.mark.parametrize("last", [1, pytest.param(6, marks=pytest.mark.slow)])
def test_the_papers_program_proves_its_small_rows(last):
    models = [ct.load(f"error-correction/{row}") for row in range(1, last + 1)]
    agreed(models, ["label-setting", "highs:paper"], time_limit=100)


def test_a_program_that_cannot_fit_is_refused_before_it_is_built(monkeypatch):
    from crosstrack.errors import UnsupportedFormulation
    from crosstrack.instances.error_correction.generator import uniform_slab

    monkeypatch.setattr(crosstrack.models.resource_routing.arcs, "MOST_ARCS", 100_000)
    model = uniform_slab(1000, (50, 50, 50, 50, 50), seed=0)
    for formulation in ("paper", "arc-flow"):
        with pytest.raises(UnsupportedFormulation, match="native backend"):
            _ = model.formulate(formulation).program
