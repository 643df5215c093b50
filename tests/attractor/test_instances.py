"""Instances of attractors: the catalogue, exports and the demonstration."""

import math

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances import entries, entry, export_formats, export_plan
from crosstrack.instances.attractor import Hunt, generate
from crosstrack.instances.attractor.listing import HUNT_EXPONENTS, HUNTS
from crosstrack.instances.attractor.motions import orbit
from crosstrack.instances.attractor.systems import SYSTEMS
from crosstrack.instances.demos import build_demo
from crosstrack.models.attractor import AttractorEstimate

OURS = [one for one in entries() if one.name.startswith("attractor/")]
#: Their names behind the problem's.
NAMES = [one.name.partition("/")[2] for one in OURS]


@pytest.fixture(scope="module")
def models():
    return {name: one.build() for name, one in zip(NAMES, OURS, strict=True)}


# -- the catalogue -------------------------------------------------------------------------------


def test_the_catalogue_says_what_it_holds(models):
    assert len({model.digest for model in models.values()}) == len(OURS) >= 28
    assert set(HUNTS) | {str(name) for name in SYSTEMS} < set(NAMES)
    rows = [one.published["row"] for one in OURS if "row" in one.published]
    assert len(set(rows)) == len(rows)
    for one in OURS:
        assert ("table" in one.published) == ("row" in one.published)
        assert one.provenance == "seeded" and one.note.endswith(".")
        assert one.title[0].isupper() and not one.title.endswith(".")


def test_the_papers_hunt(models):
    model, one = models["hunt"], entry("attractor/hunt")
    assert (len(model.series), model.unit, model.period) == (1000, "m", 1.0)
    assert model.true_exponent / math.log(2) == pytest.approx(0.12, abs=0.01)
    assert one.published == {
        "delay": 8, "dimension": 10, "exponent_bits": 0.12, "correlation": 5.5, "horizon": 8.3,
    }  # fmt: skip
    # The horizon is the inverse of the exponent, whatever its unit is.
    assert 1 / one.published["exponent_bits"] == pytest.approx(one.published["horizon"], abs=0.05)
    assert np.array_equal(models["hunt-long"].series[:1000], model.series)
    for name, exponent in HUNT_EXPONENTS.items():
        assert models[name].true_exponent == exponent
        assert models[name].chaotic == (exponent > 0)
        assert f"{exponent:g} nats/s" in entry(f"attractor/{name}").note


def test_the_calm_hunt_repeats_itself():
    calm, hunt = (Hunt.from_data(HUNTS[name]).motion for name in ("hunt-calm", "hunt"))
    returns = orbit(calm, 4, 311.15)
    off = np.abs(returns[1:] - returns[0]).max()
    states = orbit(hunt, 4000, 0.5)
    # Soon after, they are still near.
    others = np.abs(states[100:] - states[0]).max(axis=1).min()
    # Bodies move some 0.02 m within the 0.05 s that the time of return is known to.
    assert off < 0.02
    assert others > 0.2


def test_known_systems_state_what_is_known(models):
    for system, known in SYSTEMS.items():
        model, said = models[system], entry(f"attractor/{system}").published
        assert said["source"] == known.source
        assert said.get("exponent") == model.true_exponent == known.exponent
        assert said.get("correlation") == model.true_dimension == known.dimension
        assert model.chaotic is known.chaotic
    assert ct.load("attractor/henon").describe() == "2000 samples, one each 1 s"


def test_wild_ones_are_wild(models):
    assert len(models["samples-50"].series) == 50
    assert len(models["samples-100000"].series) == 100_000
    assert len(np.unique(models["quantised"].series)) <= 32
    assert len(np.unique(models["tied"].series)) == 3
    assert len(np.unique(models["two-values"].series)) == 2
    assert len(np.unique(models["sawtooth"].series)) == 20
    trend = models["trend"].series
    assert np.corrcoef(trend, np.arange(len(trend)))[0, 1] > 0.9
    plain, noisy = generate("lorenz").series, models["noise-10db"].series
    ratio = plain.var() / (noisy - plain).var()
    assert 10 * math.log10(ratio) == pytest.approx(-10, abs=0.3)
    assert np.ptp(models["spikes"].series) > 2 * np.ptp(generate("rossler").series)
    henon = models["henon"].series
    assert models["scale-1e-6"].series == pytest.approx(1e-6 * henon)
    assert models["scale-1e6"].series == pytest.approx(1e6 * henon)
    for name, least, most in (("oversampled", 0.999, 1), ("undersampled", -0.2, 0.2)):
        x = models[name].series
        assert least < np.corrcoef(x[1:], x[:-1])[0, 1] < most
    for name in ("quantised", "tied", "trend", "noise-10db", "spikes"):
        model = models[name]
        assert (model.true_exponent, model.true_dimension, model.chaotic) == (None, None, True)


# -- files and tables ----------------------------------------------------------------------------


def test_states_are_exported(models, tmp_path):
    model = models["hunt"]
    plan = AttractorEstimate(delay=8, dimension=3)
    assert list(export_formats(model)) == ["csv"]
    lines = export_plan(model, plan, tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "time [s],x0 [m],x1 [m],x2 [m]"
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert np.array_equal(table[:, 1:], model.states(8, 3))
    assert table[:, 0].tolist() == list(range(984))
    single = export_plan(model, AttractorEstimate(delay=1, dimension=1), tmp_path / "b.csv")
    assert single.read_text().splitlines()[:2] == [
        "time [s],x0 [m]",
        f"0.0,{float(model.series[0])!r}",
    ]
    with pytest.raises(InvalidData, match="need more than 1801 samples, got 1000"):
        export_plan(model, AttractorEstimate(delay=200, dimension=10), tmp_path / "c.csv")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.csv", "b.csv"]


def test_an_exported_coordinate_is_read_again(models, tmp_path):
    from crosstrack.instances.attractor import read_series

    model = models["hunt"]
    file = export_plan(model, AttractorEstimate(delay=3, dimension=2), tmp_path / "a.csv")
    with pytest.raises(InvalidData, match="several columns of values"):
        read_series(file)
    again = read_series(file, "x1")
    assert np.array_equal(again.series, model.series[3:])
    assert (again.period, again.unit) == (1.0, "m")


def test_the_demonstration_is_the_papers_hunt():
    assert build_demo("attractor", {}).digest == ct.load("attractor/hunt").digest
