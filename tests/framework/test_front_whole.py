"""Fronts of a second objective that is whole: every limit once, none twice, all that there is."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from commands import run
from fronts import MODEL, pareto_set, values
from listening import solutions

import crosstrack as ct
from crosstrack.models import ErrorCorrectionRouting
from crosstrack.solvers import Answer, Backend, Guarantee, Limit, Termination

PUBLIC = (
    Path(__file__).resolve().parents[3] / "shared" / "data" / "error-correction" / "points_327.csv"
)


def drawn(seed, *, suspects):
    """Points near the line from A to B, and some apart from it."""
    draw = np.random.default_rng(seed)
    near = draw.uniform([0, -0.1, 0], [4, 0.1, 0], (5, 3))
    apart = draw.uniform([0, 0.3, 0], [4, 1, 0], (4, 3))
    suspect = np.concatenate([[False], draw.random(9) < 0.4, [False]])
    extra = {"suspect": suspect, "residual": 0.3} if suspects else {}
    return ErrorCorrectionRouting(
        np.vstack([[0, 0, 0], near, apart, [4, 0, 0]]),
        ["A", *draw.choice(["horizontal", "vertical"], 9), "B"],
        *draw.uniform(1.8, 2.8, 5), delta=1.0, name=f"drawn-{seed}", **extra,
    )  # fmt: skip


def bridges(seed=0):
    """Three spans, each crossed by two corrections on the line or by one that is a detour.

    Three detours of different lengths, so that the front has four points.
    """
    heights = np.random.default_rng(seed).permutation([0.3, 0.4, 0.5])
    points = [(0, 0, 0)]
    for span, height in enumerate(heights.tolist()):
        west = 2.0 * span
        points += [
            (west + 0.67, 0, 0),
            (west + 1.33, 0, 0),
            (west + 1, height, 0),
            (west + 2, 0, 0),
        ]
    kinds = ["A", *["vertical"] * (len(points) - 2), "B"]
    return ErrorCorrectionRouting(
        points, kinds, 1.2, 9, 1.2, 9, 1.2, horizontal_rate=0.1, vertical_rate=1.0, name="bridges"
    )


def all_routes(model):
    """Length and corrections of every simple route that keeps the thresholds in the worst case."""
    suspect = np.zeros(len(model.kinds), bool) if model.suspect is None else model.suspect
    found = []

    rates = model.horizontal_rate, model.vertical_rate

    def extend(route, length, errors):
        for j in range(len(model.kinds)):
            if j in route:
                continue
            leg = math.dist(model.points[route[-1]], model.points[j])
            horizontal, vertical = (e + r * leg for e, r in zip(errors, rates, strict=True))
            kind = model.kinds[j]
            most = {
                "horizontal": (model.beta2, model.beta1),
                "vertical": (model.alpha2, model.alpha1),
                "B": (model.theta, model.theta),
            }[kind]
            if horizontal > most[0] or vertical > most[1]:
                continue
            if kind == "B":
                found.append((length + leg, len(route) - 1))
                continue
            left = model.residual if suspect[j] else 0.0
            if kind == "horizontal":
                horizontal = min(horizontal, left)
            else:
                vertical = min(vertical, left)
            extend([*route, j], length + leg, (horizontal, vertical))

    extend([0], 0.0, (0.0, 0.0))
    return np.array(found, float).reshape(-1, 2)


def check_front(model):
    """Return the size of the front, which must be the Pareto set, found without needless runs."""
    wanted = pareto_set(*all_routes(model).T)
    ran = []
    found = ct.front(model, "corrections", on_event=solutions(ran.append))
    assert values(found) == [pytest.approx(pair, rel=1e-9) for pair in wanted], model.name
    assert all(point.proven for point in found.points)
    assert not found.repeated
    ends = 1 if not wanted or wanted[-1][1] > 0 else 0
    assert [one.termination for one in found.unsolved] == ["infeasible"] * ends
    # The first run may have more corrections than it needs.
    assert len(ran) == len(found.points) + len(found.dominated) + ends
    return len(wanted)


@pytest.mark.parametrize("suspects", [False, True])
def test_the_front_of_corrections_is_the_whole_pareto_set(suspects):
    assert {check_front(drawn(seed, suspects=suspects)) for seed in range(22, 38)} == {0, 1, 2}


@pytest.mark.parametrize("seed", range(3))
def test_every_number_of_corrections_is_found(seed):
    assert check_front(bridges(seed)) == 4


def test_limits_are_whole_and_each_is_run_once():
    model, ran = bridges(), []
    whole = ct.front(model, "corrections")
    found = ct.front(
        model, "corrections", limits=[9, 6.5, 6, 0, 6.0], on_event=solutions(ran.append)
    )
    assert [one.instance for one in ran] == [
        f"{model.name}, corrections <= {limit}" for limit in (9, 6, 0)
    ]
    kept = {point.second: point.objective for point in whole.points}
    for point in found.points:
        assert point.limit in (9.0, 6.0)
        assert point.second in kept
    for points, expected in ((1, 1), (2, 2)):
        assert len(ct.front(model, "corrections", points=points).points) == expected


@pytest.mark.parametrize("step", [1e-6, 0.05, 0.3, 1.0])
def test_a_step_that_is_given_skips_values_and_ends_at_the_least(step):
    model, ran = bridges(), []
    whole = ct.front(model, "corrections")
    found = ct.front(model, "corrections", step=step, on_event=solutions(ran.append))
    assert len({one.instance for one in ran}) == len(ran)
    assert {values(found)[0], values(found)[-1]} == {values(whole)[0], values(whole)[-1]}
    assert set(values(found)) <= set(values(whole))
    if step < 0.1:
        assert values(found) == values(whole)


def test_a_limit_of_the_model_stays_and_zero_is_one():
    model = bridges()
    first = ct.front(model, "corrections").points
    under = ct.front(model.limited("corrections", first[0].second - 1), "corrections")
    assert values(under) == [(one.objective, one.second) for one in first[1:]]
    assert ct.solve(model.limited("corrections", 1e6)).primal_bound == first[0].objective
    assert ct.solve(model.limited("corrections", 0)).termination == "infeasible"
    line = ErrorCorrectionRouting(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]], ["A", "horizontal", "B"], *[3] * 5, delta=1.0
    )
    ran = []
    assert values(ct.front(line, "corrections", on_event=solutions(ran.append))) == [(2.0, 0.0)]
    assert len(ran) == 1
    assert ct.solve(line.limited("corrections", 0)).plan.route == (0, 2)


def test_a_run_without_a_proof_ends_the_front():
    """What found nothing under a limit would find nothing under less."""
    ran = []

    class Once(Backend):
        name = "once"
        accepts = ErrorCorrectionRouting
        guarantee = Guarantee.HEURISTIC

        def run(self, problem, request):
            if ran:
                return Answer(Termination.NO_SOLUTION, Limit.TIME)
            return Answer(Termination.FEASIBLE, None, route)

    route = ct.solve(bridges()).plan
    found = ct.front(
        bridges(), "corrections", backend=Once(), isolate=False, on_event=solutions(ran.append)
    )
    assert len(ran) == 2
    assert len(found.points) == len(found.unsolved) == 1


def test_the_front_is_continued_and_printed(tmp_path):
    model = bridges()
    path, record = tmp_path / "model.json", tmp_path / "runs.jsonl"
    path.write_text(model.to_json())
    whole = ct.front(model, "corrections")
    ct.front(model, "corrections", points=2, record=record)
    ran = []
    again = ct.front(
        model, "corrections", record=record, resume=True, on_event=solutions(ran.append)
    )
    assert values(again) == values(whole)
    assert len(record.read_text().splitlines()) == len(ran)
    done = run("front", path, "corrections", "--json")
    data = json.loads(done.stdout)
    assert [(one["objective"], one["second"]) for one in data["points"]] == values(whole)
    assert data["field"] == "corrections_limit"


def test_other_fronts_descend_by_shares():
    ran = []
    ct.front(MODEL, "max", on_event=solutions(ran.append))
    assert 3 <= len(ran) <= 10


def public(thresholds, *, suspects):
    """Return the public points, some of whose corrections may fail."""
    with PUBLIC.open() as file:
        table = list(csv.DictReader(file))
    extra = {"suspect": [line["fail"] == "1" for line in table], "residual": 5.0}
    return ErrorCorrectionRouting(
        [[float(line[axis]) for axis in "xyz"] for line in table],
        [line["kind"] for line in table],
        *thresholds, delta=0.001, **(extra if suspects else {}),
    )  # fmt: skip


real = pytest.mark.skipif(
    not PUBLIC.exists(), reason="the public points are not beside the checkout"
)


@real
@pytest.mark.parametrize(
    ("thresholds", "optimum", "corrections"),
    [
        ((20, 10, 15, 20, 20), 161650.410, 21),
        ((25, 15, 20, 25, 30), 108149.397, 11),
        ((50, 50, 50, 50, 50), 103362.905, 4),
    ],
)
def test_the_public_rows_with_suspects(thresholds, optimum, corrections):
    found = ct.solve(public(thresholds, suspects=True))
    assert found.backend == "resource-labelling"
    assert found.termination == "optimal"
    assert found.primal_bound == pytest.approx(optimum, abs=6e-4)
    assert found.plan.corrections == corrections


@real
@pytest.mark.parametrize(
    ("suspects", "wanted"),
    [
        pytest.param(
            False,
            {11: 106545.931, 10: 107964.430, 9: 112152.654},
            marks=pytest.mark.slow,
        ),
        (True, {11: 108149.397, 10: 126030.420}),
    ],
)
def test_the_front_of_row_8(suspects, wanted):
    model = public((25, 15, 20, 25, 30), suspects=suspects)
    found = ct.front(model, "corrections")
    assert {point.second: point.objective for point in found.points} == pytest.approx(
        wanted, abs=6e-4
    )
    assert all(point.proven for point in found.points)
    assert not found.dominated
    assert not found.repeated
    assert [one.termination for one in found.unsolved] == ["infeasible"]
