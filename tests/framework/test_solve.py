"""The dispatcher: verification of every answer, limits, interrupts, isolation, options."""

import os
import signal
import threading
import time

import numpy as np
import pytest
from fakes import Brief, Fixed, Hanging, Killed, Patient, Raising
from listening import incumbents

import crosstrack as ct
from crosstrack.errors import (
    BackendBroken,
    BackendMissing,
    InvalidData,
    UnknownName,
    UnsupportedFormulation,
    UnsupportedOption,
)
from crosstrack.models import MixedIntegerProgram, Route
from crosstrack.solvers import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Solution,
    Termination,
    backend_states,
    find_backend,
    register_backend,
    relative_gap,
)


@pytest.fixture
def model():
    return ct.load("error-correction/example-1")


def test_auto_is_exact_and_verified(model):
    best = ct.solve(model)
    assert best.backend == "label-setting"
    assert best.termination == "optimal"
    assert best.plan.route == (0, 1, 2, 4)
    assert best.primal_bound == pytest.approx(4.5)
    assert best.gap == 0
    assert best.verification.ok
    assert set(best.seconds) >= {"build", "compile", "solve", "decode", "verify", "total"}


def test_a_plan_that_fails_verification_is_rejected(model):
    answer = ct.solve(model, Fixed(route=(0, 2, 4)))
    assert answer.termination == "rejected"
    assert answer.plan is None
    assert answer.primal_bound is None
    assert answer.dual_bound is None
    assert not answer.verification.ok
    assert "horizontal error at B" in answer.message
    assert answer.rejected_plan == {"route": [0, 2, 4], "ids": [1, 3, 5]}


@pytest.mark.parametrize("isolate", [False, True])
def test_a_point_without_a_plan_is_rejected(model, isolate):
    """A point that does not exist: the model rejects it, and no plan is returned."""
    answer = ct.solve(model, Fixed(route=(0, 99)), isolate=isolate)
    assert answer.termination == "rejected"
    assert answer.plan is None
    assert answer.plan_data is None
    assert not answer.verified
    assert answer.dual_bound is None
    assert "99" in answer.message


def test_a_claim_of_optimality_needs_its_bound(model):
    answer = ct.solve(model, Fixed(dual=4.0))
    assert answer.termination == "feasible"
    assert answer.gap == pytest.approx(0.5 / 4.5)
    assert "leaves a gap" in answer.message


def test_a_heuristic_proves_nothing(model):
    answer = ct.solve(model, Fixed(guarantee=Guarantee.HEURISTIC, dual=4.5))
    assert answer.dual_bound is None
    answer = ct.solve(model, Fixed(guarantee=Guarantee.HEURISTIC, route=None, claims="infeasible"))
    assert answer.termination == "no_solution"
    assert "cannot prove" in answer.message


def test_a_bug_of_a_backend_is_a_failed_answer(model):
    answer = ct.solve(model, Raising())
    assert answer.termination == "failed"
    assert "RuntimeError: the solver tripped" in answer.message


@pytest.mark.parametrize("back", [None, "optimal", (1, 2)])
def test_a_result_that_is_not_an_answer_is_named(model, monkeypatch, back):
    monkeypatch.setattr(Fixed, "run", lambda self, problem, request: back)
    answer = ct.solve(model, Fixed())
    assert answer.termination == "failed"
    assert f"run() must return an Answer, got {back!r}" in answer.message


def test_a_plan_claimed_but_not_given_fails(model):
    answer = ct.solve(model, Fixed(route=None))
    assert answer.termination == "failed"


@pytest.mark.parametrize("isolate", [False, True])
def test_time_limit_returns_the_incumbent(model, isolate):
    begin = time.perf_counter()
    answer = ct.solve(model, Patient(), time_limit=0.5, isolate=isolate)
    assert time.perf_counter() - begin < 8
    assert (answer.termination, answer.limit) == ("feasible", "time")
    assert answer.plan.route == (0, 1, 2, 4)
    assert answer.primal_bound == pytest.approx(4.5)
    assert [i.objective for i in answer.incumbents] == [1.0]


def test_a_killed_worker_leaves_its_incumbent(model):
    answer = ct.solve(model, Killed(), isolate=True)
    assert "SIGKILL" in answer.message
    assert answer.plan.route == (0, 1, 2, 4)
    assert answer.termination == "feasible"
    assert answer.dual_bound is None
    lost = ct.solve(model, Killed(route=None), isolate=True)
    assert lost.termination == "failed"


@pytest.mark.parametrize("isolate", [False, True])
def test_incumbents_are_reported_in_the_callers_thread(model, isolate):
    heard = []
    ct.solve(
        model, Patient(), time_limit=0.3, isolate=isolate,
        on_event=incumbents(lambda i: heard.append((i.plan.route, threading.current_thread().name))),
    )  # fmt: skip
    assert [route for route, _ in heard] == [(0, 1, 2, 4)]


def test_a_brief_run_uses_the_callers_thread(model):
    backend, heard = Brief(), []
    answer = ct.solve(model, backend, time_limit=10, on_event=incumbents(heard.append))
    assert backend.thread is threading.current_thread()
    assert answer.termination == "optimal"
    assert [one.objective for one in heard] == [1.0] == [one.objective for one in answer.incumbents]


def test_a_brief_run_may_fail_or_be_interrupted(model):
    def press():
        os.kill(os.getpid(), signal.SIGINT)

    def trip():
        raise RuntimeError("the solver tripped")

    answer = ct.solve(model, Brief(press))
    assert (answer.limit, answer.plan.route) == ("interrupted", (0, 1, 2, 4))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    failed = ct.solve(model, Brief(trip))
    assert failed.limit is None
    assert "the solver tripped" in failed.message


@pytest.mark.parametrize("isolate", [False, True])
def test_a_listener_that_raises_ends_the_run(model, isolate):
    def listener(incumbent):
        raise ZeroDivisionError("mine")

    begin = time.perf_counter()
    with pytest.raises(ZeroDivisionError, match="mine"):
        ct.solve(model, Patient(), time_limit=60, isolate=isolate, on_event=incumbents(listener))
    assert time.perf_counter() - begin < 10
    deadline = time.perf_counter() + 5
    while any(t.name == "crosstrack-fixed" for t in threading.enumerate()):
        assert time.perf_counter() < deadline, "the backend runs on"
        time.sleep(0.05)


@pytest.mark.parametrize("isolate", [False, True])
def test_ctrl_c_keeps_the_incumbent(model, isolate):
    ct.solve(model, Fixed(), isolate=isolate)  # a worker that stands ready

    def press(incumbent):
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()

    answer = ct.solve(model, Patient(), time_limit=30, isolate=isolate, on_event=incumbents(press))
    assert answer.limit == "interrupted"
    assert answer.plan.route == (0, 1, 2, 4)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_time_limit_holds_for_a_backend_that_ignores_stops(model):
    from crosstrack.solvers import Worker
    from crosstrack.solvers.contract.job import Job

    with Worker() as worker:
        worker.solve(Job(model, "label-setting"))
        first = worker.pid
        begin = time.perf_counter()
        answer = worker.solve(Job(model, Hanging(), time_limit=0.5), grace=0.5)
        assert time.perf_counter() - begin < 5
        assert (answer.termination, answer.limit) == ("feasible", "time")
        assert "killed" in answer.message
        assert worker.solve(Job(model, "label-setting")).termination == "optimal"
        assert worker.pid not in (None, first)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"backend": "gurobbi"}, UnknownName, "did you mean 'gurobi'"),
        ({"backend": "label-setting", "threads": 2}, UnsupportedOption, "threads"),
        ({"backend": "labelling", "gap": 0.1}, UnsupportedOption, "gap"),
        ({"backend": "label-setting", "formulation": "paper"}, UnsupportedFormulation, "solves model 'error-correction' itself"),
        ({"backend": "label-setting", "formulation_options": {"big_m": 1}}, UnsupportedOption, "formulation_options"),
        ({"backend": "highs", "formulation": "pape"}, UnknownName, "did you mean 'paper'"),
        ({"backend": "highs", "formulation": "paper", "formulation_options": {"m": 1}}, UnsupportedOption, "no option 'm'"),
        ({"backend": "highs", "backend_options": {"speed": 1}}, UnsupportedOption, "no option 'speed'"),
        ({"backend": "highs", "time_limit": 0}, UnsupportedOption, "time_limit must be a number > 0"),
        ({"backend": "highs", "time_limit": "5"}, UnsupportedOption, "time_limit"),
        ({"backend": "highs", "gap": -1}, UnsupportedOption, "gap must be a number >= 0"),
        ({"backend": "highs", "seed": 1.5}, UnsupportedOption, "seed must be a whole number"),
        ({"backend": "highs", "starts": 3}, UnsupportedOption, "one start proves"),
        ({"backend": "labelling", "warm_start": Route((0, 1, 2, 4))}, UnsupportedOption, "no warm start"),
        ({"backend": "highs", "warm_start": Route((0, 2, 4))}, InvalidData, "warm_start is no plan"),
        ({"backend": 7}, InvalidData, "a name or a Backend"),
    ],
)  # fmt: skip
def test_unsupported_options_raise(model, options, error, words):
    with pytest.raises(error, match=words):
        ct.solve(model, **options)


def test_a_plan_may_come_as_a_solution_or_as_data(model):
    best = ct.solve(model)
    for plan in (best, best.plan, [0, 1, 2, 4], {"route": [0, 1, 2, 4]}):
        assert ct.verify(model, plan).objective == pytest.approx(4.5)
        assert ct.solve(model, "highs", warm_start=plan).termination == "optimal"
    assert ct.compare([model], ["highs"], warm_start=best).outcome == "AGREED"
    assert ct.compare([model], ["highs"], warm_start=[0, 1, 2, 4]).outcome == "AGREED"
    nothing = ct.solve(model, Fixed(route=None))
    with pytest.raises(InvalidData, match="there is no plan"):
        ct.verify(model, nothing)


def test_a_name_is_not_a_model():
    with pytest.raises(InvalidData, match="load it first"):
        ct.solve("error-correction/1")


def test_a_missing_package_raises_with_the_install_command(model):
    class Absent(Fixed):
        requires = ("no_such_solver",)
        extra = "absent"

    with pytest.raises(BackendMissing, match=r"pip install 'crosstrack\[absent\]'"):
        ct.solve(model, Absent())


def test_infeasible_is_proven():
    model = ct.load("error-correction/example-1")
    from dataclasses import replace

    tight = replace(model, theta=0.01)
    for backend in ("label-setting", "two-stage", "pulse", "dynamic-programming", "highs"):
        answer = ct.solve(tight, backend)
        assert answer.termination == "infeasible", backend
        assert answer.plan is None


def test_revisits_need_a_native_backend(model):
    from dataclasses import replace

    free = replace(model, revisits=True)
    assert ct.solve(free).termination == "optimal"
    with pytest.raises(UnsupportedFormulation, match="revisits"):
        ct.solve(free, "highs")


def test_warm_start_and_cutoff(model):
    plan = ct.solve(model).plan
    for formulation in ("paper", "arc-flow"):
        answer = ct.solve(model, "highs", formulation=formulation, warm_start=plan)
        assert answer.termination == "optimal"
        assert answer.primal_bound == pytest.approx(4.5)


def test_a_program_is_solved_like_a_model():
    program = MixedIntegerProgram(
        cost=[-5, -4, -3], matrix=[[2, 3, 1], [4, 1, 2]], row_lower=[None, None], row_upper=[5, 11],
        column_lower=[0, 0, 0], column_upper=[None, None, None], integral=[True, True, True],
    )  # fmt: skip
    answer = ct.solve(program)
    assert answer.backend == "highs"
    choices = [
        program.cost @ x
        for x in np.ndindex(3, 3, 6)
        if (program.matrix @ np.array(x) <= program.row_upper).all()
    ]
    assert answer.primal_bound == pytest.approx(min(choices))
    assert program.verify(np.round(answer.plan)).ok
    again = Solution.from_dict(answer.to_dict(), program)
    assert np.array_equal(again.plan, answer.plan)


def test_solution_json_round_trip(model):
    answer = ct.solve(model, "highs", seed=3, time_limit=10)
    again = Solution.from_dict(answer.to_dict(), model)
    assert again.to_dict() == answer.to_dict()
    assert again.plan == answer.plan
    data = answer.to_dict()
    keys = ("model", "instance", "backend", "formulation", "termination", "limit", "primal_bound", "dual_bound",
            "gap", "plan", "verification", "seconds")  # fmt: skip
    assert next(iter(data)) == "model"
    assert set(keys) <= set(data)
    assert {"ok", "objective", "checks"} <= set(data["verification"])
    assert {"name", "equation", "worst", "unit", "tolerance", "where", "ok"} <= set(
        data["verification"]["checks"][0]
    )
    from dataclasses import replace

    with pytest.raises(InvalidData, match="digest"):
        Solution.from_dict(data, replace(model, theta=0.31))


def test_gap_formula():
    assert relative_gap(110.0, 100.0) == pytest.approx(10 / 110)
    assert relative_gap(-100.0, -110.0) == pytest.approx(10 / 110)
    assert relative_gap(100.0, 101.0) == 0
    assert relative_gap(0.0, 0.0) == 0
    assert relative_gap(None, 1.0) is None
    assert relative_gap(1.0, -np.inf) is None


def test_multistart_keeps_all(model):
    class Drawing(Fixed):
        guarantee = Guarantee.HEURISTIC
        features = frozenset({Feature.SEED})

        def __init__(self):
            self.name = "drawing"

        def run(self, problem, request):
            route = (0, 1, 2, 4) if request.seed == 7 else None
            return Answer(
                Termination.FEASIBLE if route else Termination.NO_SOLUTION,
                point=route and Route(route),
            )

    answer = ct.solve(model, Drawing(), seed=5, starts=4, isolate=False)
    assert [start.seed for start in answer.starts] == [5, 6, 7, 8]
    assert [start.plan is not None for start in answer.starts] == [False, False, True, False]
    assert answer.plan.route == (0, 1, 2, 4)


def test_session_backends_are_found_by_name(model):
    @register_backend
    class Mine(Fixed):
        def __init__(self):
            super().__init__(name="mine-of-this-test")

    assert isinstance(find_backend("mine-of-this-test"), Mine)
    assert ct.solve(model, "mine-of-this-test").termination == "optimal"
    assert "mine-of-this-test" in [state.name for state in backend_states()]


def test_a_name_belongs_to_what_the_backend_accepts(model, monkeypatch):
    """`greedy` of the documentation replaced the backend of guided paths."""
    from crosstrack.solvers.contract import registry

    monkeypatch.setattr(registry, "_session", [])
    register_backend(Fixed("greedy"))
    assert ct.solve(model, "greedy").termination == "optimal"
    assert ct.solve(ct.load("guided-path/example-5"), "greedy").plan is not None
    again = Fixed("greedy", guarantee=Guarantee.HEURISTIC)
    register_backend(again)
    assert find_backend("greedy", model) is again, "a cell of a notebook that runs twice"
    assert len([state for state in backend_states() if state.name == "greedy"]) == 2
    with pytest.raises(InvalidData, match="belongs to each of the problems"):
        find_backend("greedy")


@pytest.mark.parametrize("name", ["label-setting", "two-stage"])
def test_a_name_that_is_taken_for_the_same_models_is_refused(name, model):
    with pytest.raises(InvalidData, match=f"'{name}' is taken for 'error-correction' by"):
        register_backend(Fixed(name))
    assert not isinstance(find_backend(name, model), Fixed)


def test_exceptions_cross_the_process(model):
    class Refusing(Fixed):
        def run(self, problem, request):
            raise BackendBroken("no licence for 7 rows")

    for isolate in (False, True):
        with pytest.raises(BackendBroken, match="no licence for 7 rows"):
            ct.solve(model, Refusing(), isolate=isolate)


def test_backend_is_abstract():
    with pytest.raises(TypeError):
        Backend()
