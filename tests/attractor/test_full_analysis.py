"""The whole analysis: its parts equal those of their backends, and missing parts are reported."""

import numpy as np
import pytest
from attractor.known import analysed, arma, henon, strange

import crosstrack as ct
from crosstrack import jit
from crosstrack.errors import UnsupportedOption
from crosstrack.models import AttractorAnalysis
from crosstrack.models.attractor import Judgement
from crosstrack.models.attractor.plan import Method
from crosstrack.solvers import Control, Limit, Termination
from crosstrack.solvers.attractor import full_analysis, native, prediction


def test_all_parts_of_a_map():
    model, answer = analysed("full-analysis", henon(1000))
    plan = answer.point
    assert (plan.delay, plan.dimension) == (1, 2)
    assert plan.exponent.value == pytest.approx(0.419, abs=0.05)
    assert plan.correlation.value == pytest.approx(1.21, abs=0.08)
    assert plan.surrogates.judgement is Judgement.CHAOTIC
    assert answer.termination is Termination.FEASIBLE and answer.limit is None
    assert not answer.message
    assert model.verify(plan).ok


def test_each_part_is_that_of_its_backend():
    x = henon(400)
    _, answer = analysed("full-analysis", x)
    plan = answer.point
    for name, part in (("rosenstein", "exponent"), ("correlation-dimension", "correlation")):
        _, other = analysed(name, x)
        assert getattr(other.point, part).data() == getattr(plan, part).data()
    _, other = analysed("surrogates", x)
    assert other.point.surrogates.data() == plan.surrogates.data()
    assert other.point.exponent.data() == plan.exponent.data()


def test_the_methods_are_options():
    x = henon(300)
    _, answer = analysed("full-analysis", henon(600), exponent_method="kantz")
    assert answer.point.exponent.method is Method.KANTZ
    for method in ("autocorrelation", "c-c", "improved-c-c"):
        _, own = analysed(method, x)
        _, answer = analysed("full-analysis", x, delay_method=method)
        assert answer.point.delay == own.point.delay
    _, own = analysed("c-c", x)
    _, answer = analysed("full-analysis", x, delay_method="c-c", dimension_method="c-c")
    assert (answer.point.delay, answer.point.dimension) == (own.point.delay, own.point.dimension)
    _, own = analysed("false-neighbours", x)
    _, answer = analysed("full-analysis", x, dimension_method="false-neighbours")
    assert answer.point.dimension == own.point.dimension
    # Options that are given are not chosen automatically.
    _, answer = analysed(
        "full-analysis", x, delay=2, dimension=3, theiler=7, dimension_method="c-c"
    )
    assert (answer.point.delay, answer.point.dimension, answer.point.theiler) == (2, 3, 7)
    with pytest.raises(UnsupportedOption):
        analysed("full-analysis", x, exponent_method="wolf")


def test_noise_has_none_and_says_so():
    model, answer = analysed("full-analysis", arma(1000, (1.8, -0.9), seed=1))
    plan = answer.point
    assert plan.surrogates.judgement is Judgement.NOISE
    assert "no exponent" in answer.message and "linear noise explains" in answer.message
    assert model.verify(plan).ok


@pytest.mark.parametrize("name", strange())
def test_strange_series_are_analysed(name):
    model, answer = analysed("full-analysis", strange()[name])
    plan = answer.point
    assert plan.surrogates is not None
    assert (plan.exponent is None) == ("no exponent" in answer.message)
    assert (plan.correlation is None) == ("no correlation dimension" in answer.message)
    assert all(np.isfinite(value) for value in answer.statistics.values())
    assert model.verify(plan).ok
    if name not in ("huge", "tiny", "far off"):  # which are a map
        assert plan.surrogates.judgement is not Judgement.CHAOTIC


def test_a_run_that_is_stopped_keeps_the_embedding(monkeypatch):
    """The embedding is computed once. It was computed again after the limit, which took 10,000 samples 0.6 s of CPU."""
    calls = []
    monkeypatch.setattr(
        native, "embed", lambda *parts, real=native.embed: calls.append(parts) or real(*parts)
    )
    for module in (full_analysis, prediction):
        monkeypatch.setattr(module, "embed", native.embed)
    control = Control()
    control.stop(Limit.TIME)
    model, answer = analysed("full-analysis", henon(300), control=control)
    plan = answer.point
    assert answer.termination is Termination.FEASIBLE and answer.limit is Limit.TIME
    assert plan.exponent is plan.correlation is plan.surrogates is None
    assert answer.message.count("stopped") == 3
    assert model.verify(plan).ok
    assert len(calls) == 1


def test_a_run_whose_interpreted_loops_are_ended_has_an_embedding(monkeypatch):
    """10,000 samples had no estimate at a limit of 5 s if nothing was compiled."""

    def ended(*arguments):
        raise jit.OutOfTime

    monkeypatch.setattr(prediction, "nearest_states", ended)
    model, answer = analysed("full-analysis", henon(300))
    assert answer.termination is Termination.FEASIBLE
    assert "stopped" in answer.message
    assert model.verify(answer.point).ok


def test_later_parts_are_left_out_at_a_time_limit(monkeypatch):
    """The time is up after the exponent."""
    from crosstrack.solvers.attractor.exponents import Rosenstein

    control, run = Control(), Rosenstein.run

    def slow(self, problem, request):
        answer = run(self, problem, request)
        control.stop(Limit.TIME)
        return answer

    monkeypatch.setattr(Rosenstein, "run", slow)
    _, answer = analysed("full-analysis", henon(300), control=control)
    plan = answer.point
    assert plan.exponent is not None and plan.correlation is plan.surrogates is None
    assert answer.limit is Limit.TIME


def test_it_is_what_solve_takes():
    solution = ct.solve(AttractorAnalysis(henon(200), true_exponent=0.419), seed=3)
    assert solution.backend == "full-analysis"
    assert solution.plan.surrogates is not None
    assert solution.verification.ok


@pytest.mark.slow
def test_a_million_samples():
    _, answer = analysed("full-analysis", henon(10**6))
    assert answer.point.exponent.value == pytest.approx(0.419, abs=0.03)
    assert answer.point.surrogates.judgement is Judgement.CHAOTIC
