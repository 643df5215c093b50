"""Guesses that satisfy the dynamics, and guesses that continue from phase to phase."""

import itertools

import casadi
import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem


def cart(time=(0, 1), **ends):
    ocp = OptimalControlProblem("cart")
    phase = ocp.phase(time=time)
    x = phase.state("x", initial=0, **ends)
    v = phase.state("v", initial=1)
    u = phase.control("u", lower=-2, upper=2)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    return ocp, phase, x, v


def guess_of(ocp, k=0):
    return ocp.definition.phases[k].guess


@pytest.mark.parametrize(
    "control",
    [0.5, np.full(7, 0.5), lambda t: 0.5, casadi.MX(0.5)],
    ids=["value", "samples", "function", "expression"],
)
def test_a_flight_obeys_the_dynamics(control):
    ocp, phase, *_ = cart()
    phase.simulate(u=control)
    guess = guess_of(ocp)
    t = guess.fractions
    assert (guess.start, guess.end) == (0, 1)
    assert guess.states == pytest.approx(np.stack([t + t**2 / 4, 1 + t / 2], axis=1), abs=1e-5)
    assert guess.controls == pytest.approx(0.5)


def test_a_feedback_is_an_expression_of_states():
    ocp, phase, _, v = cart()
    phase.simulate(u=-3 * v + phase.time)
    guess = guess_of(ocp)
    speed, t = guess.states[:, 1], guess.fractions
    # The control is clipped to its bounds before it is integrated.
    assert guess.controls[:, 0] == pytest.approx(np.maximum(-3 * speed + t, -2), abs=1e-9)
    assert guess.controls[0, 0] == -2
    assert np.trapezoid(guess.controls[:, 0], t) == pytest.approx(speed[-1] - 1, abs=1e-4)


def test_a_free_end_is_where_the_final_value_is_nearest():
    ocp, phase, *_ = cart((0, (0.5, 9)), final=3)
    phase.simulate(u=0)
    assert guess_of(ocp).end == pytest.approx(3, abs=0.05)
    phase.simulate(time=[0, 2], u=0)
    assert guess_of(ocp).end == 2
    assert guess_of(ocp).states[-1] == pytest.approx([2, 1], abs=1e-6)


def test_a_flight_starts_where_the_state_is_guessed():
    ocp = OptimalControlProblem("decay")
    phase = ocp.phase(time=(0, 2))
    q = phase.state("q", 2, lower=0, upper=10)
    rate = ocp.parameter("rate", lower=0, upper=4, guess=0.5)
    phase.dynamics({q: -rate * q})
    ocp.minimise(rate)
    phase.guess(q=[8, 4])
    phase.simulate()
    guess = guess_of(ocp)
    wanted = np.outer(np.exp(-guess.fractions), [8, 4])
    assert guess.states == pytest.approx(wanted, abs=1e-4)
    # A later guess takes precedence.
    phase.guess(q=[7, 7])
    assert (guess_of(ocp).states == 7).all()


def test_a_flight_that_breaks_down_names_state_and_instant():
    ocp = OptimalControlProblem("escape")
    phase = ocp.phase("burst", time=(0, 2))
    x = phase.state("x", initial=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: x**2 + u})
    ocp.minimise(phase.final(x))
    phase.simulate(u=0)
    with pytest.raises(InvalidData, match=r"'burst' breaks down at t = 0.99999.*state 'x'"):
        ocp.build()
    phase.simulate(u=-1)
    assert guess_of(ocp).states == pytest.approx(1)


def test_a_flight_may_end_before_it_breaks_down():
    ocp = OptimalControlProblem("escape")
    phase = ocp.phase(time=(0, (0.1, 5)))
    x = phase.state("x", initial=1, final=4)
    phase.dynamics({x: x**2})
    ocp.minimise(phase.end)
    phase.simulate()
    assert guess_of(ocp).end == pytest.approx(0.75, abs=0.03)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"x": 1}, "phase 'phase 1' has the controls 'u'"),
        ({"u": [[1, 2], [3, 4]]}, "guess of 'u' must be one value"),
        ({"u": casadi.MX.sym("y", 2)}, "feedback of 'u' must have 1 entry, got 2"),
        ({"u": casadi.MX.sym("y")}, "the feedback uses 'y'"),
    ],
)
def test_simulate_rejects_invalid_arguments(values, message):
    ocp, phase, *_ = cart()

    def build():
        phase.simulate(**values)
        ocp.build()

    with pytest.raises(InvalidData, match=message):
        build()


def relay(last=6.0):
    ocp = OptimalControlProblem("relay")
    made = []
    for k, time in enumerate(((0, 1), (1, (2, 4)), ((2, 4), (4, 8)))):
        phase = ocp.phase(f"leg {k}", time=time)
        x = phase.state(
            "x", initial=0 if k == 0 else None, final=last if k == 2 else None, lower=-9, upper=9
        )
        u = phase.control("u", lower=-1, upper=1)
        phase.dynamics({x: u})
        made.append(phase)
    for first, second in itertools.pairwise(made):
        ocp.link(first, second)
    ocp.minimise(made[-1].end)
    return ocp, made


def test_guessed_lines_continue_through_linked_phases():
    ocp, _ = relay()
    guesses = [guess_of(ocp, k) for k in range(3)]
    assert [(g.start, g.end) for g in guesses] == [(0, 1), (1, 3), (3, 6)]
    # One line from 0 at time 0 to 6 at time 6.
    assert [g.states[:, 0].tolist() for g in guesses] == [[0, 1], [1, 3], [3, 6]]


def test_a_guess_is_carried_across_a_link():
    ocp, (first, second, _) = relay(last=None)
    first.guess(x=[0, 5])
    assert [guess_of(ocp, k).states[:, 0].tolist() for k in range(3)] == [[0, 5], [5, 5], [5, 5]]
    second.guess(x=[1, 2], time=[1, 4])
    assert [guess_of(ocp, k).states[:, 0].tolist() for k in range(3)] == [[0, 5], [1, 2], [2, 2]]
    assert [guess_of(ocp, k).start for k in range(3)] == [0, 1, 4]


def test_simulated_guesses_continue_through_linked_phases():
    ocp, phases = relay()
    for phase, u in zip(phases, (0.5, -1, 1), strict=True):
        phase.simulate(u=u)
    guesses = [guess_of(ocp, k) for k in range(3)]
    for one, other in itertools.pairwise(guesses):
        assert other.start == one.end
        assert other.states[0] == pytest.approx(one.states[-1], abs=1e-9)
    assert guesses[0].states[-1, 0] == pytest.approx(0.5)
    assert guesses[2].end == 8  # as far as it may, to be nearest to 6
