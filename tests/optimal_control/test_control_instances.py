"""Catalogue of optimal control, and solutions of its entries."""

import functools
import json
import math
import pickle

import pytest
from control_values import DERIVED, ENTRIES, KIND, PRINTED
from derived_extremals import cart_pole

import crosstrack as ct
from crosstrack.instances import Provenance, optimal_control as oc
from crosstrack.models import Model


def test_names():
    assert set(ENTRIES) == set(DERIVED) | PRINTED
    assert len(ENTRIES) >= 35


@pytest.mark.parametrize("name", sorted(ENTRIES))
def test_entries(name):
    entry = ENTRIES[name]
    model = ct.load(entry.name)
    assert model.name == entry.name == f"{KIND}/{name}"
    assert model.kind == entry.model == KIND
    assert entry.provenance in (Provenance.PUBLIC, Provenance.OURS)
    assert entry.title and entry.paper and entry.note
    published = entry.published
    assert set(published) <= {"objective", "source", "analytic", "printed"}
    assert published["source"]
    assert math.isfinite(published["objective"])
    # JSON is exact, and building twice gives the same digest.
    again = Model.from_json(model.to_json())
    assert again.digest == model.digest == entry.build().digest
    assert type(again) is type(model)
    # The guess respects the bounds, and no control or duration is left without a size.
    for phase in model.definition.phases:
        assert phase.guess.start < phase.guess.end
        assert phase.start_lower <= phase.guess.start <= phase.start_upper
        assert phase.end_lower <= phase.guess.end <= phase.end_upper
        for what in ("states", "controls"):
            low, high = (phase.stacked(what, side) for side in ("lower", "upper"))
            table = getattr(phase.guess, what)
            assert ((table >= low - 1e-9) & (table <= high + 1e-9)).all()


def test_digests_differ():
    assert len({entry.build().digest for entry in ENTRIES.values()}) == len(ENTRIES)


@pytest.mark.parametrize(
    ("name", "printed", "digits"),
    [
        ("free-flying-robot", 7.9101, 4),
        ("goddard", -1.0128369, 7),
        ("hanging-chain", 5.06848, 5),
        ("linear-tangent-steering", 0.554570879, 8),
        ("orbit-raising", -1.5253, 4),
        ("rayleigh", 44.7209, 4),
        ("rayleigh-free", 29.376, 3),
        ("robot-arm", 9.1409, 4),
        ("zermelo", 5.46, 2),
    ],
)
def test_values_agree_with_the_literature(name, printed, digits):
    assert ENTRIES[name].published["objective"] == pytest.approx(printed, abs=0.6 * 10.0**-digits)


@pytest.mark.slow
def test_the_cart_has_two_local_optima():
    at_once = cart_pole((3.62, -52.0, 4.85, 4.29))
    assert at_once == pytest.approx(58.80766746, rel=1e-9)
    assert at_once > cart_pole() + 0.5
    assert "58.80766746" in ENTRIES["cart-pole"].note


def test_cross_range_in_degrees():
    value = ENTRIES["shuttle-reentry"].published["objective"]
    assert math.degrees(-value) == pytest.approx(34.1412, abs=5e-5)


def test_options():
    assert oc.bryson_denham(limit=0.2).digest == ENTRIES["bryson-denham-touch"].build().digest
    assert oc.rayleigh("mine", horizon=3, limited=False).name == "mine"
    # Further declarations are allowed.
    mine = oc.double_integrator("mine")
    mine.subject_to(mine.parameter("p", lower=0, upper=2), upper=1, name="p is at most 1")
    assert mine.digest != oc.double_integrator().digest


def test_every_export_exists():
    for name in oc.__all__:
        assert getattr(oc, name)().kind == KIND
    assert set(dir(oc)) == set(oc.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = oc.nothing


#: Discontinuous and singular controls are solved to 1e-5, all others to 1e-6.
JUMPING = {
    "aly-chan", "catalyst-mixing", "double-integrator", "double-integrator-fuel", "dubins",
    "free-flying-robot", "goddard", "harmonic-oscillator", "moon-lander", "quadrotor", "robot-arm",
}  # fmt: skip


#: Entries with a test of their own.
SLOW = {"free-flying-robot", "quadrotor"}
#: Solved in the fast tests: several controls, parameters and phases. Tests of the catalogue, of arcs, of refinement
#: and of the clock solve further entries.
FAST = {"decay-fit", "goddard-phases"}


@functools.cache
def solved(name, **options):
    """Return the answer to an entry, which several tests look at, and its published objective."""
    entry = ENTRIES[name]
    answer = ct.solve(entry.build(), tolerance=1e-6, time_limit=120, **options)
    wanted, digits = entry.published["objective"], 1e-5 if name in JUMPING else 1e-6
    return answer, pytest.approx(wanted, rel=digits, abs=digits)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in FAST else [pytest.mark.slow])
        for name in sorted(set(ENTRIES) - SLOW)
    ],
)
def test_solved(name):
    answer, wanted = solved(name)
    assert answer.verification.ok, str(answer.verification)
    assert answer.primal_bound == wanted
    assert_kept_by_encodings(ENTRIES[name].build(), answer)


def assert_kept_by_encodings(model, answer):
    """Assert that records and JSON data hold the plan, and that its program has a point for it."""
    data = answer.to_dict()
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert ct.Solution.from_dict(data, model).to_dict() == data
    stored = json.loads(json.dumps(model.plan_to_data(answer.plan), allow_nan=False))
    plan = model.plan_from_data(stored)
    assert model.plan_to_data(plan) == stored
    assert model.plan_to_data(pickle.loads(pickle.dumps(plan))) == stored
    written = model.formulate(answer.formulation).fitted(plan)
    point = written.encode(plan)
    assert written.program.verify(point, tolerance=1e-5).ok
    assert model.verify(written.decode(point), tolerance=1e-5).ok


@pytest.mark.slow
def test_quadrotor_by_gauss():
    answer, wanted = solved("quadrotor", formulation="gauss")
    assert answer.verification.ok, str(answer.verification)
    assert answer.primal_bound == wanted


@pytest.mark.slow
def test_eight_switches_are_resolved_or_rejected():
    """Check that eight switches of four jets are accepted only within the tolerance."""
    answer, wanted = solved("free-flying-robot", seed=0)
    if answer.termination == "locally_optimal":
        assert answer.verification.ok
        assert answer.primal_bound == wanted
    else:
        assert answer.termination == "rejected"
        assert answer.verification.violated


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["gauss", "hermite-simpson"])
@pytest.mark.parametrize("name", sorted(set(ENTRIES) - JUMPING))
def test_solved_by_other_formulations(name, formulation):
    answer, wanted = solved(name, formulation=formulation)
    assert answer.verification.ok, str(answer.verification)
    assert answer.primal_bound == wanted


def test_estimates_the_parameter():
    plan = solved("decay-fit")[0].plan
    assert plan.parameters["rate"] == pytest.approx([0.546581496745], rel=1e-7)


def test_the_switches_of_the_moon_lander():
    """Free fall for (√17 - 2) / 1.5, then full thrust."""
    plan = ct.solve(ENTRIES["moon-lander"].build(), tolerance=1e-6, seed=0).plan
    fall = (math.sqrt(17) - 2) / 1.5
    assert plan.end == pytest.approx(fall + math.sqrt(17) / 1.5, abs=1e-5)
    assert plan["thrust"](fall - 0.01) == pytest.approx(0, abs=1e-3)
    assert plan["thrust"](fall + 0.01) == pytest.approx(3, abs=1e-3)
