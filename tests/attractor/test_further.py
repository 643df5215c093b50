"""Series with further coordinates: states, backends that use or refuse them, files, pictures, wild values."""

import numpy as np
import pytest
from attractor.known import henon

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedFormulation
from crosstrack.instances.attractor import generate, read_series, write_states_csv
from crosstrack.instances.attractor.motions import orbit
from crosstrack.instances.attractor.systems import System, motion_of
from crosstrack.models import AttractorAnalysis
from crosstrack.solvers.attractor import BACKENDS
from crosstrack.solvers.attractor.native import ONE_SERIES


def lorenz(count=2000, period=0.05):
    states = orbit(motion_of(System.LORENZ, np.random.default_rng(1)), count, period)
    return AttractorAnalysis(states[:, 0], period, further=states[:, 1:], true_exponent=0.9056)


def test_states_are_stacked_after_scaling():
    model = lorenz(200)
    states = model.states(3, 2)
    assert states.shape == (197, 6)
    assert np.array_equal(states[:, 0], model.series[:-3])
    assert np.array_equal(states[:, 1], model.series[3:])
    for k, column in enumerate(model.further.T):
        scaled = states[:, 2 + 2 * k]
        assert np.corrcoef(scaled, column[:-3])[0, 1] == pytest.approx(1.0)
        assert model.coordinates[k + 1].std() == pytest.approx(model.series.std())
        assert model.coordinates[k + 1].mean() == pytest.approx(model.series.mean())
    assert "200 samples" in model.describe() and "3 coordinates" in model.describe()


def test_the_unit_of_a_further_coordinate_has_no_effect():
    model = lorenz(300)
    other = AttractorAnalysis(
        model.series, model.period, further=model.further * [1e-6, 1e9] + [0, 5e9]
    )
    assert np.allclose(model.states(1, 1), other.states(1, 1), rtol=1e-9)


def test_models_without_further_coordinates_keep_their_digest():
    model = AttractorAnalysis(henon(60))
    assert "further" not in model.data() and model.further is None
    again = AttractorAnalysis.from_data(lorenz(60).data())
    assert again.digest == lorenz(60).digest
    assert again.digest != AttractorAnalysis(again.series, again.period).digest


def test_each_backend_uses_or_refuses_them():
    model = lorenz(600)
    assert set(BACKENDS) > ONE_SERIES
    for name in BACKENDS:
        options = {"dimension": 1} if name in ("rosenstein", "kantz") else {}
        if name in ONE_SERIES:
            with pytest.raises(UnsupportedFormulation, match=f"{name}.*further coordinates"):
                ct.solve(model, name)
        else:
            found = ct.solve(model, name, backend_options=options, seed=1)
            assert found.verification.ok, name
            assert found.plan.dimension <= 2, name
    assert ct.solve(model, seed=1).backend not in ONE_SERIES


def test_coordinates_replace_delays():
    """Three coordinates of Lorenz' equations span the space without a delay."""
    model = lorenz(4000)
    found = ct.solve(model, "correlation-dimension", backend_options={"dimension": 1})
    assert found.plan.correlation.value == pytest.approx(2.05, abs=0.1)
    found = ct.solve(model, "rosenstein", backend_options={"dimension": 1})
    assert found.plan.exponent.value == pytest.approx(0.9056, rel=0.15)


@pytest.mark.parametrize(
    ("further", "message"),
    [
        (np.zeros((60, 1)), r"further\[:, 0\] must not be constant, got 0 at all 60"),
        (np.column_stack([henon(60), np.full(60, 3)]), r"further\[:, 1\] must not be constant"),
        (1e160 * henon(60)[:, None], r"further\[:, 0\] must have values below 1e150"),
        (1e9 + 1e-5 * henon(60)[:, None], r"further\[:, 0\] must vary by more than rounding"),
        (henon(59)[:, None], "further"),
        (henon(60), "further"),
        (np.full((60, 1), np.nan), "further.*finite"),
    ],
)
def test_invalid_coordinates(further, message):
    with pytest.raises(InvalidData, match=message) as caught:
        AttractorAnalysis(henon(60), further=further)
    assert caught.value.field == "further"


def test_columns_of_a_file(tmp_path):
    model = lorenz(60)
    rows = [
        f"{20 * k},{x},{y},{z}"
        for k, (x, y, z) in enumerate(zip(model.series, *model.further.T, strict=True))
    ]
    file = tmp_path / "a.csv"
    file.write_text("\n".join(["time [ms],x [m],series,z [m/s]", *rows]))
    found = read_series(file, "x, series ,Z")
    assert found.unit == "m" and np.array_equal(found.series, model.series)
    assert np.array_equal(found.further, model.further)
    assert np.array_equal(read_series(file, "z,x").further[:, 0], model.series)
    assert read_series(file, "x").further is None
    loaded = ct.load(file, model="attractor", data={"column": "x,series,z"})
    assert loaded.digest == found.digest
    with pytest.raises(InvalidData, match="columns must differ, got 'x,x'"):
        read_series(file, "x,x")
    with pytest.raises(UnknownName, match="'w'"):
        read_series(file, "x,w")
    file.write_text('time [s],"x,y"\n' + "\n".join(f"{k},{x}" for k, x in enumerate(model.series)))
    assert read_series(file, "x,y").further is None
    file.write_text(
        "time [s],x,y\n"
        + "\n".join(f"{k},{x},{'' if k == 9 else x}" for k, x in enumerate(model.series))
    )
    with pytest.raises(InvalidData, match="line 11, column y"):
        read_series(file, "x,y")
    assert read_series(file, "x,y", missing="interpolate").further.shape == (60, 1)


def test_states_are_written_and_drawn(tmp_path):
    model = lorenz(300)
    found = ct.solve(model, "lyapunov-spectrum", backend_options={"dimension": 1})
    lines = write_states_csv(found.plan, tmp_path / "s.csv", model=model).read_text().splitlines()
    assert lines[0] == "time [s],x0,x1,x2" and len(lines) == 301
    title = ct.plot(model, found).get_suptitle() or ct.plot(model, found).texts[0].get_text()
    assert "resolved" in title and "nats/s" in title
    measures = ct.solve(model, "measures", backend_options={"dimension": 1})
    texts = " ".join(text.get_text() for text in ct.plot(model, measures).texts)
    assert "recurrence rate" in texts.replace("\n", " ")


# -- wild series ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("series", "message"),
    [
        ([1.0, 2.0, 3.0], "50 … 10000000 samples, got 3"),
        ([], "got 0"),
        ([7.0] * 60, "constant"),
        ([1.0] * 59 + [float("nan")], "finite"),
        ([1.0] * 59 + [float("inf")], "finite"),
        ([None] * 60, "series"),
        (["1"] * 60, "series"),
        ((1e-200 * henon(60)).tolist(), "differ by more than 1e-150"),
        ((1e200 * henon(60)).tolist(), "below 1e150"),
    ],
)
def test_wild_series_are_refused(series, message):
    with pytest.raises(InvalidData, match=message):
        AttractorAnalysis(series)


@pytest.mark.parametrize("name", BACKENDS)
def test_scales(name):
    plain = ct.solve(AttractorAnalysis(henon(150)), name, seed=1)
    for scale in (1e-100, 1e100):
        found = ct.solve(AttractorAnalysis(scale * henon(150)), name, seed=1)
        assert found.verification.ok
        assert (found.plan.delay, found.plan.dimension) == (plain.plan.delay, plain.plan.dimension)
        largest = plain.plan.largest_exponent
        if largest is not None:
            assert found.plan.largest_exponent == pytest.approx(largest, rel=1e-6)


def wild():
    """Series that instruments deliver when they fail."""
    g = np.random.default_rng(1)
    return {
        "a jump": np.r_[henon(100), 1e6 + henon(100)],
        "a dead sensor": np.r_[henon(120), np.full(100, 0.3)],
        "each sample twice": np.repeat(henon(120), 2),
        "repeated": np.tile(henon(60), 4),
        "an outlier of 1e140": np.r_[henon(200), 1e140],
        "two clusters": np.r_[1e-8 * g.normal(size=100), 1 + 1e-8 * g.normal(size=100)],
        "alternating": np.tile([0.0, 1.0], 30),
        "one step": np.r_[np.zeros(49), 1.0],
        "underflow": np.exp(-(np.linspace(-30, 30, 200) ** 2)),
    }


@pytest.mark.sample(4)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", wild())
def test_wild_series_have_a_verified_result(backend, name):
    model = AttractorAnalysis(wild()[name])
    assert ct.solve(model, backend, seed=1).verification.ok


def test_generated_series_have_one_coordinate():
    assert generate("henon", 60).further is None
