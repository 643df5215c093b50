"""Error messages of invalid declarations and files."""

import copy
import math
from types import SimpleNamespace

import casadi
import pytest
from control_declared import INF, NAN, everything, open_problem, rest_to_rest

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedOption
from crosstrack.models import Model, OptimalControlProblem


def phase_with(**options):
    return lambda d: OptimalControlProblem().phase(**options)


def state_with(*arguments, **options):
    return lambda d: d.phase.state(*arguments, **options)


def second_phase(d, time=(1, 2), size=1):
    """Declare another phase with a state x."""
    phase = d.ocp.phase("second", time=time)
    x = phase.state("x", size)
    return SimpleNamespace(phase=phase, x=x)


def after_dynamics(do):
    """Return a declaration of the dynamics followed by `do`."""

    def declared(d):
        d.phase.dynamics({d.x: d.v, d.v: d.u})
        do(d)

    return declared


REFUSED = {
    # Times.
    "unbounded end": (phase_with(time=(0, None)), ["end of phase 'phase 1' is free", "(lower, upper)"]),
    "half unbounded end": (phase_with(time=(0, (1, INF))), ["end of phase 'phase 1' is free between 1 and inf", "finite"]),
    "open end": (phase_with(time=(0, (None, None))), ["free between -inf and inf", "finite bounds"]),
    "infinite start": (phase_with(time=(-INF, 1)), ["start of phase 'phase 1'", "finite", "-inf"]),
    "backwards": (phase_with(time=(1, 0)), ["must go forward", "start 1", "end 0"]),
    "no length": (phase_with(time=(1, 1)), ["must go forward"]),
    "backwards range": (phase_with(time=(0, (2, 1))), ["end of phase 'phase 1'", "lower 2 exceeds upper 1"]),
    "one time": (phase_with(time=5), ["must be (start, end)", "5"]),
    "three times": (phase_with(time=(0, 1, 2)), ["must be (start, end)"]),
    "range of three": (phase_with(time=(0, (1, 2, 3))), ["a number or (lower, upper)", "(1, 2, 3)"]),
    "time as text": (phase_with(time=(0, "1")), ["end of phase", "number", "'1'"]),
    "time as truth": (phase_with(time=(0, True)), ["end of phase", "number", "True"]),
    "NaN time": (phase_with(time=(0, NAN)), ["end of phase", "nan"]),
    "symbol as time": (phase_with(time=(0, casadi.MX.sym("T"))), ["end of phase", "MX(T)"]),
    "unit of time": (phase_with(unit=3), ["unit of phase 'phase 1' must be a string", "3"]),
    "equation": (phase_with(equation=3), ["equation of phase 'phase 1' must be a string"]),
    # Names and sizes.
    "no name": (state_with(""), ["a state must have a name", "''"]),
    "number as name": (state_with(3), ["name", "3"]),
    "brackets": (state_with("q[0]"), ["without brackets", "'q[0]'"]),
    "same state": (state_with("x"), ["state 'x' is declared already"]),
    "control like state": (lambda d: d.phase.control("x"), ["control 'x' is declared already"]),
    "same phase": (lambda d: d.ocp.phase("phase 1"), ["phase 'phase 1' is declared already"]),
    "same parameter": (lambda d: (d.ocp.parameter("p"), d.ocp.parameter("p")), ["parameter 'p' is declared already"]),
    "size 0": (state_with("q", 0), ["size of 'q'", "from 1 to", "got 0"]),
    "size -1": (state_with("q", -1), ["size of 'q'", "got -1"]),
    "size 2.0": (state_with("q", 2.0), ["whole number", "2.0"]),
    "size true": (state_with("q", True), ["whole number", "True"]),
    "endless size": (state_with("q", 10**9), ["size of 'q'", "1000000000"]),
    "no parameter": (lambda d: d.ocp.parameter("p", 0), ["size of 'p'"]),
    "unit of a state": (state_with("q", unit=3), ["unit of 'q' must be a string", "3"]),
    "name of a problem": (lambda d: OptimalControlProblem(3), ["name must be a string", "3"]),
    # Values.
    "ambiguous tuple": (state_with("q", 2, initial=(0, 1)), ["two values or a range", "write a list", "(0, 1)"]),
    "lower above upper": (state_with("q", lower=2, upper=1), ["bounds of 'q'", "lower 2 exceeds upper 1"]),
    "initial outside": (state_with("q", initial=3, upper=1), ["initial value of 'q'", "[-inf, 1]", "got 3"]),
    "final range outside": (state_with("q", final=(2, 3), upper=1), ["final value of 'q'", "got 2 to 3"]),
    "backwards initial": (state_with("q", initial=(2, 1)), ["initial value of 'q'", "lower 2 exceeds upper 1"]),
    "NaN initial": (state_with("q", initial=NAN), ["initial value of 'q'", "nan"]),
    "infinite initial": (state_with("q", initial=INF), ["initial value of 'q' must be finite", "inf"]),
    "initial from infinity": (state_with("q", initial=(INF, INF)), ["lower end of initial value of 'q'", "inf"]),
    "text": (state_with("q", initial="0"), ["initial value of 'q' must be a number", "'0'"]),
    "text in a list": (state_with("q", 2, lower=[0, "1"]), ["lower bound of 'q'", "'1'"]),
    "truth": (state_with("q", lower=True), ["lower bound of 'q'", "True"]),
    "truth in a list": (state_with("q", 2, lower=[0.0, True]), ["lower bound of 'q'", "True"]),
    "None in a list": (state_with("q", 2, lower=[0.0, None]), ["lower bound of 'q'", "None"]),
    "complex": (state_with("q", initial=1j), ["initial value of 'q'", "1j"]),
    "symbol as bound": (lambda d: d.phase.state("q", upper=d.x), ["upper bound of 'q'", "MX(x)"]),
    "lower at infinity": (state_with("q", lower=INF), ["lower bound of 'q' must be finite or -inf"]),
    "upper at -infinity": (state_with("q", upper=-INF), ["upper bound of 'q' must be finite or inf"]),
    "too many": (state_with("q", 2, lower=[0, 1, 2]), ["lower bound of 'q'", "a number or 2", "(3,)"]),
    "a table": (state_with("q", 2, lower=[[0, 1]]), ["lower bound of 'q'", "(1, 2)"]),
    "tuple of one": (state_with("q", initial=(1,)), ["number or a range (lower, upper)", "(1,)"]),
    "tuple of three": (state_with("q", initial=(1, 2, 3)), ["number or a range (lower, upper)", "(1, 2, 3)"]),
    "scale 0": (state_with("q", scale=0), ["scale of 'q'", "> 0", "got 0"]),
    "scale -1": (state_with("q", 2, scale=[1, -1]), ["scale of 'q'", "> 0"]),
    "infinite scale": (state_with("q", scale=INF), ["scale of 'q' must be finite"]),
    "control bounds": (lambda d: d.phase.control("w", lower=2, upper=1), ["bounds of 'w'", "lower 2 exceeds upper 1"]),
    "parameter bounds": (lambda d: d.ocp.parameter("p", lower=2, upper=1), ["bounds of 'p'", "lower 2 exceeds upper 1"]),
    "parameter guess outside": (lambda d: d.ocp.parameter("p", guess=5, upper=1), ["guess of 'p'", "[-inf, 1]", "got 5"]),
    "infinite parameter guess": (lambda d: d.ocp.parameter("p", guess=INF), ["guess of 'p' must be finite", "inf"]),
    "parameter guess as text": (lambda d: d.ocp.parameter("p", guess="5"), ["guess of 'p'", "'5'"]),
    # Dynamics.
    "state without dynamics": (lambda d: (d.phase.dynamics({d.x: d.v}), d.ocp.minimise(1)), ["phase 'phase 1'", "no dynamics for state 'v'"]),
    "dynamics of a stranger": (lambda d: d.phase.dynamics({"z": d.v}), ["dynamics of 'z'", "states 'x', 'v'"]),
    "dynamics of a control": (lambda d: d.phase.dynamics({d.u: d.v}), ["dynamics of 'u'", "states 'x', 'v'"]),
    "dynamics of an entry": (lambda d: d.phase.dynamics({d.phase.state("q", 2)[0]: 1}), ["dynamics of 'q[0]'", "states"]),
    "dynamics twice": (lambda d: (d.phase.dynamics({d.x: d.v}), d.phase.dynamics({"x": 0})), ["dynamics of 'x' are declared already"]),
    "dynamics twice at once": (lambda d: d.phase.dynamics({d.x: d.v, "x": 0}), ["dynamics of 'x' are declared already"]),
    "no mapping": (lambda d: d.phase.dynamics([d.v, d.u]), ["must map states to their rates"]),
    "rate too long": (lambda d: d.phase.dynamics({d.x: [d.v, d.u]}), ["dynamics of 'x' must have 1 entry", "got 2"]),
    "rate too short": (lambda d: d.phase.dynamics({d.phase.state("q", 3): [d.v, d.u]}), ["dynamics of 'q' must have 3 entries", "got 2"]),
    "symbol as rate of a vector": (lambda d: d.phase.dynamics({d.phase.state("q", 3): d.v}), ["dynamics of 'q' must have 3 entries", "got 1"]),
    "rate as text": (lambda d: d.phase.dynamics({d.x: "v"}), ["dynamics of 'x'", "CasADi expression", "'v'"]),
    "rate None": (lambda d: d.phase.dynamics({d.x: None}), ["dynamics of 'x'", "None"]),
    "rate true": (lambda d: d.phase.dynamics({d.x: True}), ["dynamics of 'x'", "True"]),
    "rate NaN": (lambda d: d.phase.dynamics({d.x: NAN}), ["dynamics of 'x'", "nan"]),
    "NaN in a rate": (lambda d: (d.phase.dynamics({d.x: d.v * NAN, d.v: d.u}), d.ocp.minimise(1)), ["rate", "nan"]),
    "SX rate": (lambda d: d.phase.dynamics({d.x: casadi.SX.sym("a")}), ["dynamics of 'x'", "(MX)", "SX(a)"]),
    "symbol from nowhere": (lambda d: (d.phase.dynamics({d.x: d.v, d.v: casadi.MX.sym("a")}), d.ocp.minimise(1)), ["phase 'phase 1'", "rate", "'a'", "no state, control, time or parameter"]),
    "symbol of another problem": (lambda d: (d.phase.dynamics({d.x: d.v, d.v: rest_to_rest().u}), d.ocp.minimise(1)), ["rate uses 'u'", "of this phase"]),
    "key of another problem": (lambda d: d.phase.dynamics({rest_to_rest().x: d.v}), ["dynamics of 'x'", "another phase's or problem's"]),
    "integral as a rate": (lambda d: (d.phase.dynamics({d.x: d.v, d.v: d.phase.integral(d.x)}), d.ocp.minimise(1)), ["rate uses 'integral 1 of phase 1'"]),
    # Constraints.
    "path without bounds": (lambda d: d.phase.path(d.x), ["path constraint 'path 1' needs a bound", "x <= 1"]),
    "path that is always so": (lambda d: d.phase.path(d.x**2 >= 0), ["needs a bound", "the constant"]),
    "bounds twice": (lambda d: d.phase.path(d.x <= 1, upper=2), ["a relation has its bounds in itself"]),
    "equals and upper": (lambda d: d.phase.path(d.x, equals=1, upper=2), ["give equals, or lower and upper"]),
    "equals infinity": (lambda d: d.phase.path(d.x, equals=INF), ["lower bound of 'path 1'", "inf"]),
    "relation to infinity": (lambda d: d.phase.path(d.x >= INF), ["relation needs finite numbers"]),
    "equal to infinity": (lambda d: d.phase.path(d.x == INF), ["relation needs finite numbers"]),
    "relation to NaN": (lambda d: d.phase.path(d.x <= NAN), ["path constraint 'path 1'", "nan"]),
    "unequal": (lambda d: d.phase.path(d.x != 1), ["a relation is <=, >= or =="]),
    "and": (lambda d: d.phase.path(casadi.logic_and(d.x <= 1, d.x >= 0)), ["a relation is <=, >= or =="]),
    "path true": (lambda d: d.phase.path(True), ["path constraint 'path 1'", "True"]),
    "path as text": (lambda d: d.phase.path("x <= 1"), ["CasADi expression", "'x <= 1'"]),
    "empty path": (lambda d: d.phase.path(casadi.MX(0, 1), upper=1), ["1 entry at least"]),
    "too many bounds": (lambda d: d.phase.path(d.x, upper=[1, 2]), ["upper bound of 'path 1'", "(2,)"]),
    "path bounds crossed": (lambda d: d.phase.path(d.x, lower=2, upper=1), ["bounds of 'path 1'", "lower 2 exceeds upper 1"]),
    "same path": (lambda d: (d.phase.path(d.x <= 1, name="a"), d.phase.path(d.x <= 2, name="a")), ["path constraint 'a' is declared already"]),
    "path and boundary of one name": (lambda d: (d.phase.path(d.x <= 1, name="a"), d.ocp.subject_to(d.phase.final(d.x) <= 2, name="a")), ["boundary constraint 'a' is declared already"]),
    "boundary and path of one name": (lambda d: (d.ocp.subject_to(d.phase.final(d.x) <= 2, name="a"), d.phase.path(d.x <= 1, name="a")), ["path constraint 'a' is declared already"]),
    "invariant and path of one name": (lambda d: (d.phase.invariant("a", d.x), d.phase.path(d.x <= 1, name="a")), ["path constraint 'a' is declared already"]),
    "name of the program's own": (lambda d: d.phase.path(d.x <= 1, name="dynamics of x"), ["cannot be called 'dynamics of x'"]),
    "name of a check": (lambda d: d.ocp.subject_to(d.phase.final(d.x) <= 1, name="objective"), ["cannot be called 'objective'"]),
    "name of a time": (state_with("end time"), ["a state cannot be called 'end time'"]),
    "path scale": (lambda d: d.phase.path(d.x <= 1, scale=0), ["scale of 'path 1'", "> 0"]),
    "path equation": (lambda d: d.phase.path(d.x <= 1, equation=7), ["equation of 'path 1' must be a string", "7"]),
    "path of the end": (after_dynamics(lambda d: (d.phase.path(d.x <= d.phase.end), d.ocp.minimise(1))), ["path uses 'tf of phase 1'"]),
    "boundary without bounds": (lambda d: d.ocp.subject_to(d.phase.final(d.x)), ["boundary constraint 'boundary 1' needs a bound"]),
    "boundary of a course": (after_dynamics(lambda d: (d.ocp.subject_to(d.x <= 1), d.ocp.minimise(1))), ["boundary uses 'x'", "phase.final(…)"]),
    "boundary of a stranger": (after_dynamics(lambda d: (d.ocp.subject_to(rest_to_rest().phase.end <= 1), d.ocp.minimise(1))), ["boundary uses 'tf of phase 1'", "declared nowhere"]),
    "invariant of a control": (lambda d: d.phase.invariant("i", d.x * d.u), ["invariant 'i' uses the control 'u'"]),
    "invariant without a name": (lambda d: d.phase.invariant("", d.x), ["an invariant must have a name"]),
    # Ends, objectives.
    "control at the end": (lambda d: d.phase.final(d.u), ["control 'u' has no value at the ends"]),
    "control at the start": (lambda d: d.phase.initial(d.x + d.u), ["control 'u' has no value at the ends"]),
    "text at the end": (lambda d: d.phase.final("x"), ["at the ends", "'x'"]),
    "two integrands": (lambda d: d.phase.integral([d.x, d.v]), ["an integrand must be one number", "got 2"]),
    "integral of an end": (after_dynamics(lambda d: d.ocp.minimise(d.phase.integral(d.phase.final(d.x)))), ["integrand uses 'x(tf)'"]),
    "raw state as objective": (after_dynamics(lambda d: d.ocp.minimise(d.x)), ["objective uses 'x'", "phase 'phase 1'", "phase.integral(…)"]),
    "time as objective": (after_dynamics(lambda d: d.ocp.minimise(d.phase.time)), ["objective uses 't of phase 1'", "phase.final(…)"]),
    "objective of another problem": (after_dynamics(lambda d: d.ocp.minimise(rest_to_rest().phase.end)), ["objective uses 'tf of phase 1'", "declared nowhere"]),
    "two objectives": (lambda d: d.ocp.minimise([d.phase.start, d.phase.end]), ["the objective must be one number", "got 2"]),
    "objective as text": (lambda d: d.ocp.minimise("u**2"), ["objective", "CasADi expression", "'u**2'"]),
    "objective NaN": (lambda d: d.ocp.minimise(NAN), ["objective", "nan"]),
    "unit of the objective": (lambda d: d.ocp.minimise(1, unit=3), ["unit of the objective", "3"]),
    "no objective": (after_dynamics(lambda d: None), ["no objective", "minimise(…)"]),
    "no phase": (lambda d: OptimalControlProblem().definition, ["no phase", "phase(…)"]),
    "no state": (lambda d: (d.ocp.phase("idle"), after_dynamics(lambda d: d.ocp.minimise(1))(d)), ["phase 'idle' has no state"]),
    # Links.
    "link to a number": (lambda d: d.ocp.link(d.phase, 3), ["link: 3 is no phase"]),
    "link to itself": (lambda d: d.ocp.link(d.phase, d.phase), ["a phase cannot follow itself"]),
    "link to another problem": (lambda d: d.ocp.link(d.phase, rest_to_rest().phase), ["phase 'phase 1' is no phase of this problem"]),
    "link without states": (lambda d: d.ocp.link(d.phase, d.ocp.phase("b", time=(1, 2))), ["no state has the same name", "subject_to"]),
    "link of a stranger": (lambda d: d.ocp.link(d.phase, second_phase(d).phase, "v"), ["state 'v' must be in both phases"]),
    "link of other sizes": (lambda d: d.ocp.link(d.phase, second_phase(d, size=2).phase), ["state 'x' has 1 entry in the first and 2"]),
    "link twice": (lambda d: [d.ocp.link(d.phase, b.phase) for b in [second_phase(d)] * 2], ["'x goes on from phase 1 to second' is declared already"]),
    "link over a gap": (lambda d: d.ocp.link(d.phase, second_phase(d, time=(3, 4)).phase), ["time ends in [1, 1] and begins in [3, 3]"]),
    "link of other values": (lambda d: (lambda b: (b.state("v", initial=5), d.ocp.link(d.phase, b)))(d.ocp.phase("b", time=(1, 2))), ["state 'v' ends in [0, 0] and begins in [5, 5]"]),
    "state of another phase": (after_dynamics(lambda d: (second_phase(d).phase.dynamics({"x": d.v}), d.ocp.minimise(1))), ["phase 'second'", "rate uses 'v'"]),
    "key of another phase": (lambda d: second_phase(d).phase.dynamics({d.x: 1}), ["dynamics of 'x'", "another phase's", "'second'"]),
    # Guesses.
    "guess of a stranger": (lambda d: d.phase.guess(z=1), ["guess of 'z'", "'x', 'v', 'u'"]),
    "guess of one sample": (lambda d: d.phase.guess(x=[1]), ["guess of 'x'", "(samples, 1)", "(1,)"]),
    "guess of wrong width": (lambda d: d.phase.guess(x=[[1, 2], [3, 4]]), ["guess of 'x'", "(2, 2)"]),
    "guess without samples": (lambda d: d.phase.guess(x=[]), ["guess of 'x'", "(0,)"]),
    "guess NaN": (lambda d: d.phase.guess(x=[0, NAN]), ["guess of 'x'", "nan"]),
    "guess inf": (lambda d: d.phase.guess(x=[0, INF]), ["guess of 'x' must be finite", "inf"]),
    "guess None": (lambda d: d.phase.guess(x=None), ["guess of 'x' must be numbers", "None"]),
    "guess as text": (lambda d: d.phase.guess(x="a"), ["guess of 'x' must be numbers", "'a'"]),
    "guess as texts": (lambda d: d.phase.guess(x=["1", "2"]), ["guess of 'x' must be numbers"]),
    "guess of a symbol": (lambda d: d.phase.guess(x=d.x), ["guess of 'x' must be numbers", "MX(x)"]),
    "guess of other length": (lambda d: d.phase.guess(time=[0, 1], x=[1, 2, 3]), ["guess of 'x' has 3 samples for 2 times"]),
    "guess back in time": (lambda d: d.phase.guess(time=[1, 0], x=[1, 2]), ["finite, increasing times", "[1, 0]"]),
    "guess at infinity": (lambda d: d.phase.guess(time=[0, INF], x=[1, 2]), ["finite, increasing times", "inf"]),
    "guess at noon": (lambda d: d.phase.guess(time="noon", x=1), ["increasing times", "'noon'"]),
    "guess at one time": (lambda d: d.phase.guess(time=3), ["increasing times", "3"]),
    "guess beyond the end": (lambda d: d.phase.guess(time=[0, 5], x=[1, 2]), ["must end in [1, 1]", "got 5"]),
    "guess before the start": (lambda d: d.phase.guess(time=[-2, 1], x=[1, 2]), ["must begin in [0, 0]", "got -2"]),
    "function of wrong size": (after_dynamics(lambda d: (d.phase.guess(x=lambda t: [t, t]), d.ocp.minimise(1))), ["guess of 'x' must return 1 finite number", "t = 0"]),
    "function that gives NaN": (after_dynamics(lambda d: (d.phase.guess(x=lambda t: NAN), d.ocp.minimise(1))), ["guess of 'x' must return 1 finite number", "nan"]),
    "function that gives text": (after_dynamics(lambda d: (d.phase.guess(x=str), d.ocp.minimise(1))), ["guess of 'x' must return 1 finite number", "'0.0'"]),
    "function that fails": (after_dynamics(lambda d: (d.phase.guess(x=lambda t: 1 / t), d.ocp.minimise(1))), ["guess of 'x' fails at t = 0", "ZeroDivisionError"]),
    "guess of nothing": (lambda d: d.phase.guess(5), ["must be a plan or a solution", "5"]),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_is_named(name):
    declare, words = REFUSED[name]
    part = open_problem()

    def used():
        declare(part)
        return part.ocp.definition

    with pytest.raises(InvalidData) as caught:
        used()
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert caught.value.field
    assert "casadi.py" not in message and "prototypes" not in message


def test_rejects_a_guess_with_other_names(answer):
    part = OptimalControlProblem().phase()
    part.state("height")
    with pytest.raises(InvalidData, match="the plan has 'x', 'v', 'u', none of which"):
        part.guess(answer)


def test_rejects_a_guess_from_a_solution_without_a_plan(answer):
    from dataclasses import replace

    with pytest.raises(InvalidData, match="must be a plan or a solution that has one"):
        rest_to_rest().phase.guess(replace(answer, plan=None))


def bad_definitions():
    def put(*path):
        *inner, last, value = path

        def change(data):
            at = data["definition"]
            for key in inner:
                at = at[key]
            if value is ...:
                del at[last]
            else:
                at[last] = value

        return change

    one = ("phases", 0)
    state = (*one, "states", 0)
    return [
        (lambda d: d.update(definition=None), ["definition must be an object", "got None"]),
        (lambda d: d.clear(), ["key 'definition' is missing in the data of model 'optimal-control'"]),
        (lambda d: d.update(definition=3), ["definition must be an object", "got 3"]),
        (lambda d: d.update(extra=3), ["unknown key 'extra'", "definition"]),
        (put("phases", None), ["phases must be a list", "None"]),
        (put("phases", []), ["phases must hold 1 phase"]),
        (put("phases", ...), ["key 'phases' is missing in the data of a definition"]),
        (put("extra", 1), ["unknown key 'extra' in the data of a definition"]),
        (put("parameters", 3), ["parameters must be a list", "3"]),
        (put("parameters", []), ["p of the function has 1 entries, 0 are declared"]),
        (put("boundaries", []), ["boundary of the function has"]),
        (put("endpoint", "nonsense"), ["endpoint is stored as CasADi's own text", "trusted=True"]),
        (put("endpoint", 3), ["endpoint must be a casadi.Function", "3"]),
        (put(*one, "states", []), ["phase 'first' has no state"]),
        (put(*one, "states", 3), ["states must be a list"]),
        (put(*one, "controls", []), ["u of the function has 1 entries, 0 are declared"]),
        (put(*one, "paths", []), ["path of the function has 1 entries, 0 are declared"]),
        (put(*one, "integrals", 3), ["integrand of the function has", "3 are declared"]),
        (put(*one, "integrals", -1), ["integrals must be >= 0"]),
        (put(*one, "name", "second"), ["phases: 'second' stands twice"]),
        (put(*one, "start_lower", 5), ["start", "lower 5 exceeds upper 0"]),
        (put(*one, "start_lower", None), ["start_lower must be a number", "None"]),
        (put(*one, "end_upper", 0.5), ["end", "lower 1 exceeds upper 0.5"]),
        (put(*one, "function", 3), ["function must be a casadi.Function"]),
        (put(*one, "guess", "fractions", [0, 0]), ["fractions"]),
        (put(*one, "guess", "end", -1), ["end of a guess must be after its start"]),
        (put(*one, "guess", "states", [[0], [0]]), ["guess of phase 'first' has 1 columns for 2 states"]),
        (put(*state, "name", "u"), ["phase 'first': 'u' stands twice"]),
        (put(*state, "name", "q[0]"), ["without brackets"]),
        (put(*state, "lower", [30, 30]), ["bounds of 'x'", "lower 30 exceeds upper 20"]),
        (put(*state, "lower", [1]), ["upper has 2 entries where lower has 1"]),
        (put(*state, "lower", ["a", 1]), ["lower[0] must be a number", "'a'"]),
        (put(*state, "scale", [0, 1]), ["scale of 'x' must be > 0"]),
        (put(*state, "unit", 3), ["unit must be a string"]),
    ]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), bad_definitions())
def test_rejects_invalid_files(change, words):
    data = copy.deepcopy(everything(20).to_dict())
    change(data["data"])
    with pytest.raises(InvalidData) as caught:
        Model.from_dict(data)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"formulation": "simpson"}, ["'simpson'", "optimal-control"]),
        ({"formulation_options": {"nodes": 3}}, ["no option 'nodes'", "intervals"]),
        ({"backend": "highs"}, ["highs"]),
    ],
)
def test_names_unavailable_options(options, words):
    with pytest.raises(
        (UnknownName, UnsupportedOption, ct.errors.UnsupportedFormulation)
    ) as caught:
        ct.solve(rest_to_rest().ocp, **options)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (lambda x, u: math.sin(x), "numpy.sin"),
        (lambda x, u: float(x + u), "numpy.sin"),
        (lambda x, u: u if x > 0 else -u, "if_else"),
        (lambda x, u: max(x, u), "fmax"),
        (lambda x, u: u * (x > 0 and u > 0), "logic_and"),
        (lambda x, u: u * (0 < x < 1), "logic_and"),
        (lambda x, u: u if x in (1, 2) else x, "if_else"),
    ],
)
def test_using_a_symbol_as_a_number_names_the_alternative(expression, words):
    """Check that the error explains the symbol instead of CasADi's internals."""
    ocp = OptimalControlProblem("symbols")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u")
    with pytest.raises(InvalidData, match=words):
        phase.dynamics({x: expression(x, u)})
    assert bool(casadi.MX(1) > 0)
    assert float(casadi.MX(2.5)) == 2.5
