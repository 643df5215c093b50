"""Several UAVs: brute force over assignments, bounds, verification, refusals, plots and files."""

import dataclasses
import functools
import itertools
import json
import math

import numpy as np
import pytest
from messenger.extended import shortest_flight

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances.messenger import generate
from crosstrack.instances.messenger.samples import write_tour_samples
from crosstrack.models import MessengerTour
from crosstrack.models.messenger import TourPlan
from crosstrack.models.messenger.plot import animate_tour
from crosstrack.models.messenger.relaxation import euclidean_relaxation

FIELD = ([[60, 20], [10, 70], [-50, 40], [-30, -60]], [[1, 0], [0, -2], [2, 1], [0, 0]])


def drawn(seed):
    draw = np.random.default_rng(seed)
    n = int(draw.integers(1, 4))
    same = seed % 2
    starts = np.column_stack([draw.uniform(-60, 60, (2, 2)), draw.uniform(0, 6, 2)])
    return MessengerTour(
        draw.uniform(-90, 90, (n, 2)), draw.uniform(-3, 3, (n, 2)), draw.choice([0.0, 5.0], n),
        start=starts[0], uavs=2 if same else starts, wind=draw.uniform(-3, 3, 2) if seed % 3 else None,
        closed=seed % 4 == 3,
    )  # fmt: skip


def by_enumeration(model):
    """Return the latest finish (m) of the best assignment, by independent flights of each UAV."""
    starts = [tuple(start) for start in model.starts]

    @functools.cache
    def finish(start, rows):
        return shortest_flight(model.share(starts.index(start), rows))

    return min(
        max(
            finish(starts[uav], tuple(k for k, other in enumerate(choice) if other == uav))
            for uav in set(choice)
        )
        for choice in itertools.product(range(len(starts)), repeat=model.size)
    )


@pytest.mark.parametrize(
    "seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 2))]
)
def test_the_search_is_as_good_as_the_enumeration_of_assignments_and_the_bound_below(seed):
    model = drawn(seed)
    best, answer = by_enumeration(model), ct.solve(model, seed=1)
    assert math.isfinite(best)
    assert answer.backend == "crew-search"
    assert model.verify(answer.plan).ok
    assert answer.primal_bound <= best * (1 + 1e-6)
    assert 0 < answer.dual_bound <= best * (1 + 1e-6)


@pytest.fixture(scope="module")
def solved():
    model = MessengerTour(
        *FIELD, ids=["a", "b", "c", "d"], uavs=[[0, 0, 0], [-40, 0, 3]], wind=[1, 0], closed=True
    )
    return model, ct.solve(model, seed=3)


def test_the_same_seed_gives_the_same_plan_within_which_each_tour_stands_alone(solved):
    model, best = solved
    assert ct.solve(model, seed=3).plan == best.plan
    parts = best.plan.parts()
    assert sorted(k for part in parts for k in part.order) == [0, 1, 2, 3]
    assert TourPlan.join(parts) == best.plan
    assert str(best.plan).count(" | ") == 1
    assert best.primal_bound == pytest.approx(max(part.length for part in parts))
    assert TourPlan.from_data(json.loads(json.dumps(best.plan.to_data()))) == best.plan
    one = ct.solve(MessengerTour(*FIELD, start=[0, 0, 0], wind=[1, 0], closed=True), seed=3)
    assert best.primal_bound < one.primal_bound


def test_verification_finds_wrong_tours(solved):
    model, best = solved
    parts = best.plan.parts()
    swapped = model.verify(TourPlan.join(parts[::-1]))
    assert {"starts at its place (UAV 0)", "starts at its place (UAV 1)"} <= {
        check.name for check in swapped.violated
    }
    k = max(range(2), key=lambda row: len(parts[row].order))
    twice = [parts[k], parts[k]]
    names = {check.name for check in model.verify(TourPlan.join(twice)).violated}
    assert "each vehicle met once" in names
    assert not model.verify(TourPlan.join([*parts, parts[0]])).ok
    idle = TourPlan(
        (), [], np.zeros((0, 2)), [0, 0, 0], [{"leg": 0, "turn": "S", "length": 9, "heading": 0}]
    )
    assert not model.verify(TourPlan.join([idle, idle])).ok
    assert "one tour per UAV" in {check.name for check in model.verify(parts[0]).violated}
    data = best.plan.to_data()
    stray = {**data["primitives"][0], "leg": 99}
    lost = TourPlan.from_data({**data, "primitives": [*data["primitives"], stray]})
    assert [check.name for check in model.verify(lost).violated] == ["one tour per UAV"]
    with pytest.raises(InvalidData, match="that of the first UAV"):
        TourPlan.from_data({**data, "start": [9, 9, 9]})
    single = MessengerTour(*FIELD)
    with pytest.raises(InvalidData, match="shares must be empty"):
        single.verify(best.plan)


def test_verification_checks_the_start_of_an_unused_uav():
    model = MessengerTour([[0, 90]], uavs=[[0, 0, 1.5], [400, 0, 1.5]])
    plan = ct.solve(model, seed=1).plan
    assert plan.shares == (1, 0) and model.verify(plan).ok
    moved = TourPlan.from_data({**plan.to_data(), "starts": [[0, 0, 1.5], [7, 0, 1.5]]})
    assert [check.name for check in model.verify(moved).violated] == ["starts at its place (UAV 1)"]


def test_a_tiny_time_limit_still_gives_a_plan():
    model = dataclasses.replace(generate(60, 8.0, 1), uavs=3)
    best = ct.solve(model, time_limit=1e-3, seed=1)
    assert best.plan is not None and model.verify(best.plan).ok


def test_other_methods_refuse_several_uavs_by_name(solved):
    model, _ = solved
    for name in ("tour-search", "memetic", "greedy-centre", "euclidean-bound", "curvature-bound"):
        with pytest.raises(UnsupportedFormulation, match=r"uavs|closed"):
            ct.solve(model, name)
    with pytest.raises(UnsupportedFormulation, match="uavs"):
        model.formulate("primitives")
    with pytest.raises(UnsupportedFormulation, match="uavs"):
        euclidean_relaxation(model, [0])
    with pytest.raises(UnsupportedFormulation, match="one UAV"):
        ct.solve(MessengerTour(*FIELD), "crew-search")


def test_one_uav_is_the_default():
    plain = MessengerTour(*FIELD)
    assert MessengerTour(*FIELD, uavs=1).digest == plain.digest
    assert MessengerTour(*FIELD, uavs=[[0, 0, np.pi / 2]]).digest == plain.digest
    many = MessengerTour(*FIELD, uavs=[[1, 2, 3], [4, 5, 6]])
    assert many.start.tolist() == [1, 2, 3] and "2 UAVs" in many.describe()
    assert MessengerTour.from_data(json.loads(json.dumps(many.data()))).digest == many.digest
    two = MessengerTour(*FIELD, uavs=2)
    assert MessengerTour.from_data(json.loads(json.dumps(two.data()))).digest == two.digest


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"uavs": 0}, "uavs"), ({"uavs": 2.5}, "uavs"), ({"uavs": True}, "uavs"),
        ({"uavs": []}, "uavs"), ({"uavs": [[1]]}, "uavs"), ({"uavs": "two"}, "uavs"),
        ({"uavs": [[0, 0, np.nan]]}, "uavs"), ({"uavs": [[0, 0], [1, 2, 3]]}, "uavs"),
         ({"uavs": [[1, 2], [3, 4]], "start": [5, 5]}, "start"),
        ({"uavs": 2, "start": None, "closed": True, "velocities": None}, "start"),
    ],
)  # fmt: skip
def test_rejects_invalid_crews(fields, field):
    with pytest.raises(InvalidData) as error:
        MessengerTour(**{"positions": FIELD[0], "velocities": FIELD[1], **fields})
    assert error.value.field == field


def test_plot_animation_and_export_show_every_uav(solved, tmp_path):
    model, best = solved
    figure = ct.plot(model, best)
    paths = [a for axes in figure.axes for a in axes.get_children() if a.get_gid() == "path"]
    assert len(paths) == 2
    assert ct.plot(model, TourPlan.join(best.plan.parts()[::-1])) is not None
    animate_tour(model, best, frames=2).save(tmp_path / "tour.gif", writer="pillow", dpi=30)
    moving = dataclasses.replace(model, home_velocity=[1, 1])
    figure = ct.plot(moving, ct.solve(moving, seed=1, time_limit=0.5))
    homes = [a for axes in figure.axes for a in axes.get_children() if a.get_gid() == "home"]
    assert sum(len(lines.get_segments()) for lines in homes) == 2
    path = write_tour_samples(best.plan, tmp_path / "path.csv", model=model, rate=2.0)
    rows = np.genfromtxt(path, delimiter=",", names=True)
    for uav, part in enumerate(best.plan.parts()):
        assert rows["t"][rows["uav"] == uav].max() == pytest.approx(part.length / 10)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_the_bound_of_several_uavs_holds_on_two_hundred_cases(block):
    usable = 0
    for seed in range(2000 + 20 * block, 2020 + 20 * block):
        model = drawn(seed)
        best = by_enumeration(model)
        bound = ct.solve(model, seed=1, backend_options={"patience": 0}).dual_bound
        assert bound <= best * (1 + 1e-6)
        usable += math.isfinite(best)
    assert usable >= 15
