"""The catalogue and the generators."""

import hashlib
import inspect
import itertools
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from crosstrack import instances
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.instances import (
    CatalogueEntry,
    Provenance,
    error_correction as ec,
    minimum_snap as ms,
)
from crosstrack.instances.error_correction.settings import TIGHT
from crosstrack.models import ErrorCorrectionRouting, Route

# Points and kinds of what the catalogue ships: a change of NumPy's streams would show here.
FINGERPRINTS = {
    "error-correction/1": "2f31a945cdfa0c7f",
    "error-correction/2": "3904b7b22595ecaa",
    "error-correction/3": "5dd2eca375ed7981",
    "error-correction/4": "3c3a7d75dd3f9a51",
    "error-correction/5": "94dde13f7885f3a6",
    "error-correction/6": "43a383760de07ef4",
    "error-correction/7": "5e16262ddacb3cca",
    "error-correction/8": "5e16262ddacb3cca",
    "error-correction/9": "5e16262ddacb3cca",
    "error-correction/10": "d872258d4c1a07b3",
    "error-correction/11": "d872258d4c1a07b3",
    "error-correction/12": "d872258d4c1a07b3",
}
DATA = {
    "kinds": ["A", "horizontal", "vertical", "B"],
    "alpha1": 25, "alpha2": 15, "beta1": 20, "beta2": 25, "theta": 30, "delta": 0.001,
}  # fmt: skip
POINTS = [[0, 0, 0], [1.5, 2.5, 3.5], [1e-3, -7, 0.1], [9, 9, 9]]


def feasible_routes(model):
    """Yield every simple route that keeps the thresholds, with its length."""
    points, limits, codes = model.points.tolist(), model.limits, model.codes
    stack = [((model.start,), 0.0, 0.0, 0.0)]
    while stack:
        route, length, horizontal, vertical = stack.pop()
        for j in set(range(len(points))) - set(route):
            leg = math.dist(points[route[-1]], points[j])
            h = horizontal + model.horizontal_rate * leg
            v = vertical + model.vertical_rate * leg
            if h > limits[codes[j], 0] + 1e-9 or v > limits[codes[j], 1] + 1e-9:
                continue
            if j == model.end:
                yield length + leg, (*route, j)
            else:
                after = (0.0 if codes[j] == 1 else h, 0.0 if codes[j] == 2 else v)
                stack.append(((*route, j), length + leg, *after))


# -- the catalogue -------------------------------------------------------------------------------


def test_names_are_in_their_natural_order():
    names = [entry.name for entry in instances.entries()]
    rows = [name for name in names if name.startswith("error-correction/")]
    suspects = [f"error-correction/suspect-{n}" for n in (21, 38, 327)]
    numbered = [f"error-correction/{k}" for k in range(1, 13)]
    assert rows == [*numbered, "error-correction/example-1", *suspects]


def test_entries_are_json_and_name_the_source_of_their_data():
    for entry in instances.entries():
        assert json.loads(json.dumps(entry.to_dict(), allow_nan=False)) == entry.to_dict()
        assert entry.paper
        assert entry.note
        hash(entry)
    assert instances.entry("error-correction/7").provenance is Provenance.SEEDED
    assert instances.entry("error-correction/example-1").provenance is Provenance.COMPLETED
    assert "12 and 11" in instances.entry("error-correction/4").note


@pytest.mark.parametrize("row", range(1, 13))
def test_rows_have_the_sizes_of_table_1_and_points_that_never_change(row):
    name = f"error-correction/{row}"
    setting, model = ec.SETTINGS[row], instances.load(name)
    assert setting.n == setting.horizontal + setting.vertical + 2 == len(model.points)
    assert model.name == name
    assert (model.kinds == "horizontal").sum() == setting.horizontal
    assert (model.kinds == "vertical").sum() == setting.vertical
    assert setting.thresholds == tuple(getattr(model, field) for field in ec.Thresholds._fields)
    assert model.horizontal_rate == model.vertical_rate == 0.001
    assert (model.points >= 0).all()
    assert (model.points <= 100_000).all()
    assert model.points[0, 0] == 0
    assert model.points[-1, 0] == 100_000
    content = model.points.tobytes() + " ".join(model.kinds).encode()
    assert hashlib.sha256(content).hexdigest()[:16] == FINGERPRINTS[name]


def test_figures_of_the_paper():
    assert instances.entry("error-correction/6").published["seconds"]["gurobi"] == 439.59
    assert instances.entry("error-correction/6").published["optimum"] == 135068
    seconds = instances.entry("error-correction/9").published["seconds"]
    assert seconds == {"two-stage": 4.19, "pulse": 542.18, "dynamic-programming": 726.76}
    for figures in ec.TABLE_3.values():
        # Printed to two digits, so a sum may be off by one.
        assert figures.two_stage == pytest.approx(figures.stage_1 + figures.stage_2, abs=0.011)
    assert sorted([*ec.TABLE_2, *ec.TABLE_3]) == sorted(ec.SETTINGS)


@pytest.mark.parametrize("row", range(1, 7))
def test_small_rows_are_no_trifles(row):
    """More routes than the planted one, the best one with several corrections."""
    setting = ec.SETTINGS[row]
    model, planted = ec.generate_with_route(
        setting.horizontal, setting.vertical, setting.thresholds, seed=setting.seed
    )
    assert model.digest == instances.load(f"error-correction/{row}").digest
    routes = sorted(feasible_routes(model))
    assert len(routes) > 50
    assert len(routes[0][1]) - 2 >= 4
    assert routes[0][0] < model.verify(planted).objective - 1
    assert model.verify(Route(routes[0][1])).ok


def test_example_1():
    """All routes tried: the optimum is the paper's, and it alone has this length."""
    model = instances.load("error-correction/example-1")
    distance = {
        (i, j): math.dist(model.points[i - 1], model.points[j - 1])
        for i, j in itertools.combinations(range(1, 6), 2)
    }
    for pair, published in {(1, 2): 2, (1, 3): 2, (2, 3): 0.5, (3, 5): 2}.items():
        assert distance[pair] == pytest.approx(published, abs=1e-14)
    assert model.ids == (1, 2, 3, 4, 5)
    routes = sorted(feasible_routes(model))
    assert [model.label(k) for k in routes[0][1]] == ["1", "2", "3", "5"]
    assert routes[0][0] == pytest.approx(4.5, abs=1e-12)
    assert routes[1][0] > 4.6
    assert any(3 in route for _, route in routes), "point 4 leads somewhere, yet not as soon"
    assert not model.verify(Route((0, 2, 4))).ok, "the shorter way to 3 leads nowhere"
    for count in range(4):
        for inner in itertools.permutations((1, 2, 3), count):
            route = Route((0, *inner, 4))
            assert model.verify(route).ok == any(route.route == other for _, other in routes)


def test_unknown_names():
    with pytest.raises(UnknownName, match="did you mean 'error-correction/7'"):
        instances.entry("error-corection/7")
    with pytest.raises(
        UnknownName, match=r"no such file.*'nowhere\.json'.*attractor/ar1, .* in all"
    ):
        instances.load("nowhere.json")
    with pytest.raises(UnknownName, match="no such file"):
        instances.load("a\0b")
    with pytest.raises(InvalidData, match=r"nowhere\.json: no such file"):
        instances.load(Path("nowhere.json"))


def test_a_user_registers_an_instance(monkeypatch):
    monkeypatch.setattr("crosstrack.instances.catalogue._REGISTERED", {})
    model = ErrorCorrectionRouting(POINTS, **DATA)
    mine = CatalogueEntry(
        "error-correction/mine", "error-correction", "Mine", "none", "public", lambda: model
    )
    assert instances.register_entry(mine) is mine
    loaded = instances.load("error-correction/mine")
    assert loaded.digest == model.digest
    assert loaded.name == "error-correction/mine"
    assert mine in instances.entries()
    with pytest.raises(InvalidData, match="already"):
        instances.register_entry(mine)
    with pytest.raises(InvalidData, match="<problem>/<instance>"):
        CatalogueEntry("mine", "error-correction", "Mine", "none", "public", lambda: model)


def test_importing_the_catalogue_is_light():
    code = (
        "import sys, crosstrack.instances as i; "
        "print([m for m in ('numpy', 'scipy', 'matplotlib', 'numba') if m in sys.modules]); "
        "i.load('error-correction/1'); "
        "print([m for m in ('scipy', 'matplotlib', 'numba') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "[]"]


@pytest.mark.parametrize("package", [instances, ec])
def test_every_export_exists_and_no_module_hides_one(package):
    folder = Path(package.__file__).parent
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert not (folder / f"{name}.py").exists()
    assert dir(package) == sorted(package.__all__)
    with pytest.raises(AttributeError):
        package.nothing  # noqa: B018


# -- the generators ------------------------------------------------------------------------------


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**40),
    thresholds=st.tuples(*[st.floats(35, 90)] * 5),
    counts=st.tuples(st.integers(8, 15), st.integers(8, 15)),
)
def test_the_planted_route_is_feasible(seed, thresholds, counts):
    model, route = ec.generate_with_route(*counts, thresholds, seed=seed)
    assert model.verify(route, tolerance=1e-12).ok
    assert len(model.points) == sum(counts) + 2
    assert model.digest == ec.generate(*counts, thresholds, seed=seed).digest


def test_rows_that_share_points_share_the_planted_route():
    setting = ec.SETTINGS[10]
    made = [
        ec.generate_with_route(
            setting.horizontal,
            setting.vertical,
            ec.SETTINGS[row].thresholds,
            seed=setting.seed,
            planted_under=TIGHT,
        )
        for row in (10, 11, 12)
    ]
    assert len({model.points.tobytes() for model, _ in made}) == 1
    assert len({route for _, route in made}) == 1
    assert all(model.verify(route, tolerance=1e-12).ok for model, route in made)


def test_generators_follow_their_seed():
    for make in (
        lambda seed: ec.generate(20, 20, (45, 50, 45, 50, 45), seed=seed),
        lambda seed: ec.generate(9, 9, (45,) * 5, seed=seed, box=(100e3, 50e3, 10e3)),
        lambda seed: ec.uniform_slab(500, (25, 15, 20, 25, 30), seed=seed),
        lambda seed: ec.random_small(8, seed),
    ):
        assert make(3).digest == make(3).digest != make(4).digest


def test_slab():
    model = ec.uniform_slab(2000, (25, 15, 20, 25, 30), seed=1)
    assert model.points.max(axis=0) == pytest.approx([100e3, 100e3, 10e3], rel=0.01)
    assert model.points[[0, -1]].tolist() == [[0, 50e3, 5e3], [100e3, 50e3, 5e3]]
    assert (model.start, model.end) == (0, 1999)
    assert 900 < (model.kinds == "vertical").sum() < 1100


@pytest.mark.parametrize("n", range(2, 10))
def test_about_half_of_the_small_instances_are_feasible(n):
    found = [any(True for _ in feasible_routes(ec.random_small(n, seed))) for seed in range(200)]
    assert 70 < sum(found) < 130


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ec.generate(-1, 5, TIGHT, seed=1), "n_horizontal must be a whole number >= 0"),
        (lambda: ec.generate(5, 2.5, TIGHT, seed=1), "n_vertical must be a whole number >= 0"),
        (lambda: ec.generate(5, 5, TIGHT, seed=-1), "seed must be a whole number >= 0"),
        (lambda: ec.generate(5, 5, (1, 2, 3), seed=1), "thresholds must be the five numbers"),
        (lambda: ec.generate(5, 5, (1, 2, -3, 4, 5), seed=1), "thresholds: beta1 must be >= 0"),
        (lambda: ec.generate(5, 5, TIGHT, seed=1, box=0), r"box\[0\] must be > 0"),
        (lambda: ec.generate(5, 5, TIGHT, seed=1, box=(1, 2)), "box must be three edges"),
        (lambda: ec.generate(2, 2, TIGHT, seed=1), "no route could be planted: 2 horizontal"),
        (
            lambda: ec.generate(9, 9, TIGHT, seed=1, planted_under=(50,) * 5),
            "nowhere be wider than thresholds: alpha1 is 50 against 20",
        ),
        (lambda: ec.random_small(10, 1), r"n must be in 2 … 9, got 10"),
        (lambda: ec.uniform_slab(1, TIGHT, seed=1), "n must be at least 2"),
    ],
)
def test_generators_refuse(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


@pytest.mark.parametrize(
    ("short", "full"),
    [(ec.generate, ec.generate_with_route), (ms.corridor, ms.corridor_with_way)],
)
def test_generators_name_every_keyword(short, full):
    """Completion and ``inspect.signature`` show the keywords with their defaults."""
    assert inspect.signature(short).parameters == inspect.signature(full).parameters
