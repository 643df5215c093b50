"""Instances of black boxes: the catalogue, the generator, files, diagnosis, and the paper's tables."""

import csv
from dataclasses import replace

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import entries, entry, export_formats, export_plan
from crosstrack.instances.black_box import generate, path_grid
from crosstrack.instances.black_box.generator import BOUNDS
from crosstrack.instances.black_box.listing import LENGTHS
from crosstrack.instances.black_box.paper import FUNCTIONS as NAMES
from crosstrack.instances.black_box.paths import PATHS
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import BlackBoxPoint
from crosstrack.models.black_box.functions import Landscape

OURS = [one for one in entries() if one.name.startswith("black-box/")]
REPRODUCED = [
    entry(f"black-box/{name}{ending}") for name in NAMES.values() for ending in ("", "-shifted")
]
#: Where each function is least, per variable, before it is moved.
LEAST_AT = {
    "rastrigin": 0.0,
    "easom": np.pi,
    "booth": np.array([1.0, 3.0]),
    "bohachevsky": 0.0,
    "sum-squares": 0.0,
    "sphere": 0.0,
    "rosenbrock": 1.0,
    "ackley": 0.0,
    "step": 0.0,
    "constant": 0.0,
}
LEAST = {name: -1.0 if name == "easom" else 0.0 for name in LEAST_AT}


def optimum_of(model):
    """Return where the function is least within the bounds, by its formula."""
    function = model.function
    shift = 0.0 if function.shift is None else function.shift
    at = np.asarray(LEAST_AT[str(function.name)]) * function.stretch + shift
    return np.clip(np.broadcast_to(at, model.dimension), model.lows, model.highs)


# -- the catalogue -------------------------------------------------------------------------------


def test_the_catalogue_says_what_it_holds():
    assert len({one.build().digest for one in OURS}) == len(OURS) >= 23
    assert len(REPRODUCED) == 10
    for one in REPRODUCED:
        model = one.build()
        assert model.budget == 20_000
        assert one.provenance == ("seeded" if one.name.endswith("-shifted") else "completed")
        assert (model.function.shift is None) == (not one.name.endswith("-shifted"))


@pytest.mark.parametrize(
    "one", [one for one in OURS if "/path-" not in one.name], ids=lambda e: e.name
)
def test_known_optima(one):
    model = one.build()
    found = model.verify(BlackBoxPoint(tuple(optimum_of(model).tolist())))
    assert found.ok
    if one.name != "black-box/one-evaluation":
        # Digits of points beside wide or narrow bounds are all that is lost.
        assert found.objective == pytest.approx(one.published["optimum"], abs=1e-8)
    # No point drawn within the bounds is below: the formula's least value holds in all of them.
    points = np.random.default_rng(1).uniform(model.lows, model.highs, (2000, model.dimension))
    assert model.function.values(points).min() >= one.published["optimum"] - 1e-9


@pytest.mark.parametrize("one", REPRODUCED, ids=lambda e: e.name)
def test_moved_optima_are_inside_and_not_in_the_middle(one):
    model = one.build()
    if model.function.shift is None:
        return
    plain = ct.load(one.name.removesuffix("-shifted"))
    width = model.highs - model.lows
    assert np.array_equal(plain.bounds, model.bounds)
    at = optimum_of(model)
    assert np.all((at - model.lows > 0.05 * width) & (model.highs - at > 0.05 * width))
    moved = np.abs(at - optimum_of(plain)) / width
    assert np.all((moved >= 0.0999) & (moved <= 0.3001))


def test_wild_ones_are_wild():
    by_name = {one.name.partition("/")[2]: one.build() for one in OURS}
    assert by_name["one-variable"].dimension == 1
    assert by_name["sphere-100"].dimension == 100
    assert by_name["noisy"].function.noise == 0.1
    assert np.ptp(by_name["bounds-1e-9"].bounds, axis=1) == pytest.approx(1e-9, rel=1e-6)
    assert np.ptp(by_name["bounds-1e9"].bounds, axis=1).tolist() == [1e9, 1e9]
    assert np.ptp(by_name["one-fixed"].bounds, axis=1).tolist() == [3, 0, 3]
    assert np.ptp(by_name["all-fixed"].bounds, axis=1).tolist() == [0, 0]
    assert by_name["one-evaluation"].budget == 1
    corner = by_name["corner"]
    assert optimum_of(corner).tolist() == [1, 2, -1]


def test_lengths_of_paths_are_those_of_the_exact_searches():
    assert set(PATHS) - set(LENGTHS) == {"enclosed"}
    for name in PATHS:
        grid = path_grid(name)
        any_angle = ct.solve(grid, "any-angle")
        eight = ct.solve(replace(grid, connectivity="8"), "a-star")
        published = entry(f"black-box/path-{name}").published
        if name not in LENGTHS:
            assert any_angle.termination == eight.termination == "infeasible"
            continue
        assert any_angle.termination == eight.termination == "optimal"
        found = (any_angle.primal_bound, eight.primal_bound)
        assert found == pytest.approx(LENGTHS[name], rel=1e-9)
        assert (published["optimum"], published["eight neighbours"]) == LENGTHS[name]


# -- the generator -------------------------------------------------------------------------------


def test_a_seed_means_the_same_function():
    one = generate("rastrigin", 4, 5)
    assert one.digest == generate("rastrigin", 4, 5).digest != generate("rastrigin", 4, 6).digest
    assert one.function.shift.tolist() == [-2.67264, -2.68288, -2.07872, -1.60768]
    noisy = generate("sphere", 2, budget=7, deviation=0.5, name="mine")
    assert (noisy.name, noisy.budget, noisy.function.noise) == ("mine", 7, 0.5)
    assert noisy.function.shift is None
    assert set(BOUNDS) == set(Landscape)


@pytest.mark.parametrize("formula", [str(name) for name in Landscape])
def test_every_formula_has_its_least_value_where_it_is_moved_to(formula):
    for seed in range(20):
        model = generate(formula, 2, seed)
        found = model.verify(BlackBoxPoint(tuple(optimum_of(model).tolist())))
        assert found.ok
        assert found.objective == pytest.approx(LEAST[formula], abs=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: generate("rastrigin", 0), "dimension must"),
        (lambda: generate("rastrigin", 10**6), "dimension must"),
        (lambda: generate("rastrigin", 2, -1), "seed must be >= 0"),
        (lambda: generate("rastrigin", 2, budget=0), "budget must"),
        (lambda: generate("rastrigins", 2), "function must be one of"),
        (lambda: generate("booth", 3), "has 2 variables"),
        (lambda: generate("sphere", 3, stretch=0), "stretch must be > 0"),
        (lambda: generate("sphere", 3, colour="red"), "colour"),
    ],
)
def test_the_generator_refuses(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


# -- files and printed tables --------------------------------------------------------------------


def test_export(tmp_path):
    model = ct.load("black-box/one-fixed")
    plan = BlackBoxPoint((0.1, 0.5, -1 / 3))
    assert list(export_formats(model)) == ["csv"]
    rows = list(
        csv.DictReader(export_plan(model, plan, tmp_path / "a.csv").read_text().splitlines())
    )
    assert [row["variable"] for row in rows] == ["0", "1", "2"]
    assert tuple(float(row["value"]) for row in rows) == plan.x
    assert [
        [float(row[key]) for key in ("lower", "upper")] for row in rows
    ] == model.bounds.tolist()
    with pytest.raises(InvalidData, match="x must have 3 entries, got 1"):
        export_plan(model, BlackBoxPoint((1.0,)), tmp_path / "b.csv")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


# -- diagnosis -----------------------------------------------------------------------------------


def test_a_diagnosis_tells_values_and_proves_nothing():
    found = ct.diagnose(BlackBoxMinimisation("booth", [[-10, 10], [-10, 10]], 19))
    assert found.feasible
    assert "nothing is proven" in found.summary
    told = [one.text for one in found.findings]
    assert told[0].startswith("2 free variables and a budget of 19")
    assert told[1:] == [
        "at the centre the value is 74",
        "at the corner (low, low) the value is 2594",
        "at the corner (low, high) the value is 234",
        "at the corner (high, low) the value is 314",
        "at the corner (high, high) the value is 1154",
    ]
    assert type(found).from_dict(found.to_dict()).to_dict() == found.to_dict()


def test_a_diagnosis_of_no_values():
    calls = []

    def nowhere(x):
        calls.append(x)
        return np.nan

    found = ct.diagnose(BlackBoxMinimisation(nowhere, [[0, 1]] * 30))
    assert found.feasible is None
    assert len(calls) == 3
    assert "cannot show that there is none elsewhere" in found.summary
    assert [one.data["value"] for one in found.findings[-3:]] == [None] * 3
    ct.diagnose(BlackBoxMinimisation(nowhere, [[0, 1]] * 4))
    assert len(calls) == 3 + 17


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ([[1, 1], [0, 2]], "1 variable is fixed between equal bounds, the first x[0] = 1"),
        ([[1, 1], [3, 3]], "every variable is fixed: there is a single point"),
        ([[0, 1], [0, 1e6]], "the range of x[1] is 1e+06 times that of x[0]"),
        ([[-1.7e308, 0], [0, 1]], "the range of x[0] is 1.7e+308 times that of x[1]"),
    ],
)
def test_a_diagnosis_of_bounds(bounds, said):
    found = ct.diagnose(BlackBoxMinimisation("sphere", bounds))
    assert any(one.text.startswith(said) for one in found.findings), found


def test_a_diagnosis_of_a_constant():
    found = ct.diagnose(ct.load("black-box/constant"))
    assert "all these values are the same" in found.findings[-1].text
    assert "all these values" not in str(ct.diagnose(ct.load("black-box/all-fixed")))
    assert entry("black-box/constant").published["optimum"] == 0.0
