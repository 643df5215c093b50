"""Spectra of exponents: known systems, the equations of motion, other embeddings, and degenerate series."""

import math

import numpy as np
import pytest
from attractor.known import analysed, henon, logistic, strange

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.attractor import generate
from crosstrack.instances.attractor.motions import orbit
from crosstrack.instances.attractor.systems import System, motion_of
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import AttractorEstimate, Spectrum
from crosstrack.models.attractor.checks import Sample
from crosstrack.models.attractor.recomputed import exponents
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.attractor.spectrum import resolved_directions, tangents


def lorenz_rates(u):
    x, y, z = u
    jacobian = [[-10, 10, 0], [28 - z, -1, -x], [y, x, -8 / 3]]
    return np.array([10 * (y - x), x * (28 - z) - y, x * y - 8 / 3 * z]), np.array(jacobian)


def rossler_rates(u):
    x, y, z = u
    jacobian = [[0, -1, -1], [1, 0.2, 0], [z, 0, x - 5.7]]
    return np.array([-y - z, x + 0.2 * y, 0.2 + z * (x - 5.7)]), np.array(jacobian)


def spectrum_of_equations(rates, start, step, steps):
    """Exponents from the variational equations, with the method of Runge and Kutta and QR."""

    def derivative(u, tangents):
        velocity, jacobian = rates(u)
        return velocity, jacobian @ tangents

    state, axes, logs = np.array(start), np.eye(len(start)), []
    for k in range(steps):
        parts = [derivative(state, axes)]
        for share in (0.5, 0.5, 1.0):
            last = parts[-1]
            parts.append(derivative(state + share * step * last[0], axes + share * step * last[1]))
        weights = (1, 2, 2, 1)
        state = state + step / 6 * sum(w * p[0] for w, p in zip(weights, parts, strict=True))
        axes = axes + step / 6 * sum(w * p[1] for w, p in zip(weights, parts, strict=True))
        axes, growth = np.linalg.qr(axes)
        if k >= steps // 20:
            logs.append(np.log(np.abs(np.diag(growth))))
    return np.mean(logs, axis=0) / step


def within(values, deviations, known, count=2.0):
    return np.abs(np.subtract(values, known)) <= count * np.array(deviations)


# -- known systems -------------------------------------------------------------------------------


def test_the_henon_map():
    model = AttractorAnalysis(henon(3000))
    found = ct.solve(model, "lyapunov-spectrum")
    spectrum = found.plan.spectrum
    assert found.verification.ok and spectrum.resolved == 2
    assert spectrum.values == pytest.approx((0.419, -1.623), rel=0.06)
    assert within(spectrum.values, spectrum.deviations, (0.4192, -1.6232)).all()
    assert max(spectrum.deviations) < 0.15
    dimension, deviation = spectrum.kaplan_yorke
    assert abs(dimension - 1.258) < 2 * deviation < 0.05
    # The area of the map contracts by 0.3 in each step.
    assert sum(spectrum.values) == pytest.approx(math.log(0.3), abs=0.1)


def test_exponents_of_the_embedding_are_removed():
    """The map has two exponents in every embedding; a fit of all directions has a spurious one of about 0.8."""
    for dimension in (2, 4):
        _, answer = analysed("lyapunov-spectrum", henon(1000), dimension=dimension)
        assert answer.point.spectrum.values == pytest.approx((0.419, -1.623), rel=0.08)
    _, answer = analysed("lyapunov-spectrum", henon(1500), dimension=3, exponents=3)
    assert answer.point.spectrum.values[0] == pytest.approx(0.8, abs=0.05)
    _, answer = analysed("lyapunov-spectrum", logistic(2000), dimension=3)
    assert answer.point.spectrum.values == pytest.approx((math.log(2),), rel=0.02)


@pytest.mark.parametrize(
    ("system", "rates", "start", "period", "step"),
    [("lorenz", lorenz_rates, (8.0, 8, 27), 0.05, 0.01), pytest.param("rossler", rossler_rates, (-4.0, 0, 0), 0.3, 0.05, marks=pytest.mark.slow)],
)  # fmt: skip
def test_flows_beside_their_equations(system, rates, start, period, step):
    known = spectrum_of_equations(rates, start, step, 12_000)
    assert known == pytest.approx(
        {"lorenz": (0.906, 0, -14.57), "rossler": (0.0714, 0, -5.39)}[system], rel=0.1, abs=0.04
    )
    model = generate(system, 3000, period=period)
    found = ct.solve(model, "lyapunov-spectrum")
    spectrum = found.plan.spectrum
    assert found.verification.ok and spectrum.resolved >= 2
    published = {"lorenz": (0.9056, 0.0), "rossler": (0.0714, 0.0)}[system]
    assert within(spectrum.values[:2], spectrum.deviations[:2], published).all()
    assert spectrum.values[0] == pytest.approx(known[0], rel=0.25)
    # The third direction is thinner than curvature, and marked as such.
    assert spectrum.values[2] < -0.8 and spectrum.deviations[2] >= -spectrum.values[2] / 2
    assert "orders of magnitude" in found.message


def test_all_coordinates_give_the_contraction_of_lorenz():
    """With three measured coordinates and a fine sampling the sum is the divergence, -13.67."""
    states = orbit(motion_of(System.LORENZ, np.random.default_rng(1)), 5000, 0.02)
    model = AttractorAnalysis(states[:, 0], 0.02, further=states[:, 1:])
    options = {"dimension": 1, "delay": 2, "step": 2, "theiler": 20, "exponents": 3}
    found = ct.solve(model, "lyapunov-spectrum", backend_options=options)
    spectrum = found.plan.spectrum
    assert found.verification.ok
    assert spectrum.values == pytest.approx((0.906, 0, -14.57), rel=0.12, abs=0.15)
    assert spectrum.kaplan_yorke[0] == pytest.approx(2.062, abs=0.02)


@pytest.mark.parametrize(("system", "count"), [("two-sines", 2), ("sine", 1)])
def test_regular_motions_have_exponents_of_zero(system, count):
    _, answer = analysed("lyapunov-spectrum", generate(system, 3000).series)
    spectrum = answer.point.spectrum
    assert spectrum.resolved == count
    assert spectrum.values[:count] == pytest.approx([0.0] * count, abs=0.002)
    assert within(spectrum.values[:count], spectrum.deviations[:count], 0.0).all()


def test_noise_has_no_spectrum():
    _, answer = analysed("lyapunov-spectrum", np.random.default_rng(1).normal(size=2000))
    assert answer.point.spectrum is None and "no spectrum" in answer.message


def test_small_measurement_noise_adds_no_positive_exponents():
    g = np.random.default_rng(2)
    x = generate("lorenz", 5000, period=0.05).series
    _, answer = analysed("lyapunov-spectrum", x + 0.01 * x.std() * g.normal(size=5000))
    spectrum = answer.point.spectrum
    rate = 1 / 0.05
    assert within(
        np.multiply(spectrum.values[:2], rate),
        np.multiply(spectrum.deviations[:2], rate),
        (0.906, 0),
    ).all()
    assert (
        sum(value > 2 * d for value, d in zip(spectrum.values, spectrum.deviations, strict=True))
        <= 1
    )


def test_exponents_have_the_unit_of_the_period():
    first, second = (
        ct.solve(AttractorAnalysis(scale * henon(600), period), "lyapunov-spectrum").plan.spectrum
        for scale, period in ((1.0, 1.0), (1e-3, 0.01))
    )
    assert np.multiply(second.values, 0.01) == pytest.approx(first.values, rel=1e-6)


# -- parts ---------------------------------------------------------------------------------------


def test_the_checks_equal_the_backend():
    for series, dimension in ((henon(800), 2), (generate("rossler", 1200, period=0.3).series, 3)):
        states = AttractorAnalysis(series).states(3, dimension)
        near = tangents(states, 5, 2, 12)
        for count in range(1, dimension + 1):
            ours, errors = near.exponents(near.frames, count)
            again, none = exponents(Sample(states, 5, 0), 2, 12, count)
            assert again == pytest.approx(ours, rel=1e-7, abs=1e-9)
            assert (errors > 0).all() and not none.any()


def test_a_linear_spiral_has_the_logarithms_of_its_moduli():
    """States x → A x with independent starts: every map is A, with the eigenvalues 0.9 and -0.5."""
    a = np.array([[0.2, 0.7], [0.55, 0.2]])
    moduli = np.sort(np.log(np.abs(np.linalg.eigvals(a))))[::-1]
    starts = np.random.default_rng(0).normal(size=(300, 2))
    states = np.concatenate([starts, starts @ a.T])
    near = tangents(states[:300], 0, 1, 8)
    near = near._replace(states=states, step=300)
    values, errors = near.exponents(np.tile(np.eye(2), (len(near.references), 1, 1)), 2)
    assert values == pytest.approx(moduli, abs=1e-9) and (errors < 1e-9).all()


def test_resolved_directions_of_a_surface_and_of_noise():
    g = np.random.default_rng(4)
    flat = g.random((3000, 2))
    curved = np.column_stack([flat, (flat**2).sum(axis=1)])
    assert resolved_directions(curved, 0, 1) == 2
    assert resolved_directions(g.random((3000, 3)), 0, 1) == 3
    noisy = np.column_stack([flat, 0.01 * g.normal(size=3000)])
    assert resolved_directions(noisy, 0, 1) == 2


# -- plans ---------------------------------------------------------------------------------------


def test_the_dimension_of_kaplan_and_yorke():
    def dimension(*values):
        return Spectrum(values, (0.1,) * len(values), 1, 4, 1).kaplan_yorke

    assert dimension(0.5, -1.0) == (1.5, pytest.approx(math.hypot(0.1, 0.05)))
    assert dimension(0.9, 0.0, -14.5)[0] == pytest.approx(2 + 0.9 / 14.5)
    assert dimension(0.3, 0.1) is None
    assert dimension(-0.3, -0.5) == (0.0, 0.0)


def test_a_plan_is_verified():
    model = AttractorAnalysis(henon(300))
    plan = ct.solve(model, "lyapunov-spectrum").plan
    assert AttractorEstimate.from_data(plan.to_data()) == plan
    data = plan.spectrum.data()
    for change in (
        {"values": [0.6, data["values"][1]]},
        {"neighbours": data["neighbours"] + 1},
        {"step": 2},
        {"step": 10**9},
        {"step": 298},
        {"values": [*data["values"], -9.0], "deviations": [*data["deviations"], 1.0]},
    ):
        wrong = AttractorEstimate(
            plan.delay, plan.dimension, plan.theiler, spectrum={**data, **change}
        )
        assert not model.verify(wrong).ok, change
    too_many = AttractorEstimate(1, 2, 1, spectrum={**data, "neighbours": 400})
    assert not model.verify(too_many).ok
    for change, message in (
        ({"values": [], "deviations": []}, "not empty"),
        ({"values": [-1.0, 1.0]}, "descending order"),
        ({"resolved": 3}, "resolved must be <= 2"),
        ({"deviations": [1.0]}, "deviations"),
    ):
        with pytest.raises(InvalidData, match=message):
            Spectrum.from_data({**data, **change})


def test_a_long_series_is_verified_by_a_part():
    model = generate("henon", 4000)
    plan = ct.solve(model, "lyapunov-spectrum").plan
    assert model.verify(plan).ok
    data = plan.spectrum.data()
    wrong = AttractorEstimate(1, 2, 1, spectrum={**data, "values": [0.9, -1.2]})
    assert not model.verify(wrong).ok


def test_spectra_are_compared():
    model = generate("henon", 500)
    plan, other = (
        ct.solve(model, "lyapunov-spectrum", backend_options={"neighbours": k}).plan
        for k in (9, 12)
    )
    pairs = zip(plan.spectrum.values, other.spectrum.values, strict=True)
    worst = max(abs(a - b) / max(abs(a), abs(b)) for a, b in pairs)
    assert 0 < model.distance(plan, other) <= worst + 1e-12
    slope = ct.solve(model, "rosenstein").plan
    first, largest = slope.exponent.value, plan.spectrum.values[0]
    assert model.distance(plan, slope) == pytest.approx(abs(first - largest) / max(first, largest))
    assert model.verify(plan).objective == pytest.approx(
        (min(abs(largest - 0.41922) / 0.41922, 1) + 2) / 3
    )


@pytest.mark.parametrize("name", strange())
def test_strange_series(name):
    model, answer = analysed("lyapunov-spectrum", strange()[name])
    plan = answer.point
    assert (plan.spectrum is None) == ("no spectrum" in answer.message)
    assert model.verify(plan).ok


def test_options_out_of_range():
    backend = find_backend("lyapunov-spectrum")
    model = AttractorAnalysis(henon(60))
    for options, message in (({"delay": 40, "dimension": 3}, "need more than 81 samples"),):
        with pytest.raises(InvalidData, match=message):
            backend.run(model, Request(options=backend.checked_options(options)))
    request = Request(options=backend.checked_options({"neighbours": 100}))
    assert "no spectrum" in backend.run(model, request).message
