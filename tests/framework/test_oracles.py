"""Questions about hidden data: functions that are slow, raise or hang, and runs side by side."""

import contextlib
import os
import re
import signal
import sys
import threading
import time
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import cloudpickle
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.models import BlackBoxMinimisation, Model, Verification
from crosstrack.models.black_box import BlackBoxPoint
from crosstrack.models.fields import Real, declared
from crosstrack.solvers import (
    Answer,
    Backend,
    Control,
    Feature,
    Guarantee,
    Limit,
    Request,
    Termination,
    Worker,
)
from crosstrack.solvers.contract.job import Job

cloudpickle.register_pickle_by_value(sys.modules[__name__])

SQUARE = [[0, 1], [0, 1]]


def norm(x):
    return float(x @ x)


def box(function=norm, budget=20, **fields):
    """Return a black box of two variables."""
    return BlackBoxMinimisation(function, SQUARE, budget=budget, **fields)


# -- what models answer ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Open(Model[float]):
    """Model with a visible number and no oracle."""

    value: float = declared(Real())
    kind: ClassVar[str] = "test-open"

    def verify(self, plan, *, tolerance=1e-6):
        return Verification(abs(plan - self.value), ())

    def plan_to_data(self, plan):
        return float(plan)

    def plan_from_data(self, data):
        return float(data)


@dataclass(frozen=True, eq=False)
class Mute(Open):
    """Model with a hidden number and no oracle."""

    value: float = declared(Real(), hidden=True)
    kind: ClassVar[str] = "test-mute"


class Asks(Backend):
    """Asks once."""

    name = "asks"
    accepts = (Open, BlackBoxMinimisation)
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT, Feature.SEED})

    def run(self, problem, request):
        request.control.ask(np.full((1, 2), 0.5))
        raise AssertionError("it was answered")


@pytest.mark.parametrize(
    ("model", "isolate"), [(Open(1.0), False), (Open(1.0), True), (Mute(1.0), None)]
)
def test_a_model_without_an_oracle_answers_nothing(model, isolate):
    assert model.oracle() is None
    with pytest.raises(HiddenData, match="the model answers no questions during a run"):
        ct.solve(model, Asks(), isolate=isolate)


def test_stages_share_the_oracle_of_their_run():
    class Whole(Asks):
        def run(self, problem, request):
            with request.control.stage(None) as part, part.stage(None) as inner:
                return inner.ask(np.full((3, 2), 0.5))

    model = box(budget=5)
    control = Control(oracle=model.oracle())
    for left in (5, 2):
        asked = Request(control=control)
        if left < 3:
            with pytest.raises(InvalidData, match="3 evaluations asked for, 2 of 5 left"):
                Whole().run(model.blinded(), asked)
        else:
            np.testing.assert_allclose(Whole().run(model.blinded(), asked), np.full((3, 1), 0.5))


# -- functions that live in this process ------------------------------------------------------------------


def test_functions_that_cannot_be_pickled_raise():
    lock, seen = threading.Lock(), []

    def guarded(x):
        with lock:  # which cannot be pickled
            seen.append(os.getpid())
            return x @ x

    for function in (
        guarded,
        lambda x: guarded(x),
        type("Called", (), {"__call__": lambda _, x: guarded(x)})(),
    ):
        found = ct.solve(box(function), "random-search", seed=1)
        assert found.statistics["evaluations"] == 20 and found.verification.ok
    assert set(seen) == {os.getpid()}


def test_a_function_may_itself_solve():
    """The inner run has a process of its own."""
    inner = box(budget=10)

    def function(x):
        return ct.solve(inner, "random-search", seed=int(1000 * x[0])).primal_bound + x[1]

    found = ct.solve(box(function, budget=3), "random-search", seed=1)
    assert found.verification.ok and found.primal_bound > 0


def test_every_start_has_the_full_budget():
    calls = []
    model = box(lambda x: float(calls.append(1) or x @ x))
    found = ct.solve(model, "random-search", seed=5, starts=3)
    assert [one.seed for one in found.starts] == [5, 6, 7]
    assert [one.statistics["evaluations"] for one in found.starts] == [20] * 3
    assert len(calls) == 3 * (20 + 1), "each is verified"
    assert found.primal_bound == min(one.primal_bound for one in found.starts)
    with pytest.raises(UnsupportedOption, match="takes no seed"):
        ct.solve(model, "direct", starts=2)


def test_two_workers_ask_at_once():
    """Each waits for the other's question: one alone would wait for ever."""
    barrier = threading.Barrier(2)
    first = threading.Lock()
    met = set()

    def function(x):
        with first:
            new = threading.current_thread().name + str(threading.get_ident()) not in met
            met.add(threading.current_thread().name + str(threading.get_ident()))
        if new and len(met) <= 2:
            barrier.wait(60)
        return float(x @ x)

    compared = ct.compare(
        [box(function)], ["random-search", "direct"], workers=2, time_limit=60, seed=1
    )
    assert [one.statistics["evaluations"] for one in compared.solutions] == [20, 20]
    assert not barrier.broken
    alone = ct.solve(box(), "random-search", seed=1)
    assert compared.solutions[0].plan == alone.plan, "nobody had the other's answers"


# -- functions that raise, hang, or are given up -----------------------------------------------------------


@pytest.mark.parametrize(
    ("raised", "text"),
    [
        (ZeroDivisionError("oops"), r"function raised ZeroDivisionError: oops, at \[0\."),
        (SystemExit(3), "SystemExit: 3"),
    ],
)
def test_an_exception_of_a_function_ends_its_run_only(raised, text):
    calls = []

    def fragile(x, sound=0):
        calls.append(1)
        if len(calls) == sound + 1:
            raise raised
        return 1.0

    with pytest.raises(InvalidData, match=text):
        ct.solve(box(fragile), "random-search", seed=1)
    assert ct.solve(box(), "random-search", seed=1).verification.ok
    calls.clear()
    (row,) = ct.compare([box(fragile)], ["random-search"], time_limit=60).solutions
    assert row.termination == "failed" and "InvalidData" in row.message
    calls.clear()
    found = ct.solve(box(partial(fragile, sound=5)), "random-search", seed=1)
    assert found.termination == "feasible" and found.verification.ok, "what came before is kept"
    assert re.search(text, found.message) and 1 <= found.statistics["evaluations"] <= 5


class Slow:
    """Function that hangs at one call until it is released, and then may raise."""

    def __init__(self, hangs_at, raises=False):
        self.hangs_at, self.raises = hangs_at, raises
        self.calls, self.hangs, self.released = 0, threading.Event(), threading.Event()
        self.ended = threading.Event()

    def __call__(self, x):
        self.calls += 1
        if self.calls == self.hangs_at:
            self.hangs.set()
            assert self.released.wait(100)
            self.ended.set()
            if self.raises:
                raise RuntimeError("too late for anybody")
        return float(x @ x)


def test_a_time_limit_holds_while_a_function_hangs():
    """The incumbent is returned within the patience; later results are discarded."""
    slow = Slow(5, raises=True)
    begin = time.monotonic()
    try:
        found = ct.solve(box(slow), "random-search", seed=3, time_limit=1.0)
        spent = time.monotonic() - begin
        assert slow.hangs.is_set() and not slow.ended.is_set()
        assert found.limit is Limit.TIME and found.termination is Termination.FEASIBLE
        # Those before the question that hung, which asked for the fifth with none or some before it.
        values = list(map(norm, np.random.default_rng(3).random((4, 2))))
        assert found.primal_bound in [min(values[:k]) for k in range(1, 5)]
        assert spent < 1.0 + 10.0 + 10.0, "the limit, the grace, and what a busy machine takes"
    finally:
        slow.released.set()
    assert slow.ended.wait(20)
    again = ct.solve(box(), "random-search", seed=3)
    assert again.statistics["evaluations"] == 20
    assert again.plan == ct.solve(box(norm), "random-search", seed=3).plan


def test_an_interrupt_while_a_function_hangs_keeps_what_is_known():
    slow = Slow(5)
    answers = []
    with Worker() as worker:
        job = Job(box(slow), "random-search", seed=3).resolved()
        thread = threading.Thread(target=lambda: answers.append(worker.solve(job)))
        thread.start()
        assert slow.hangs.wait(60)
        worker.interrupt()
        thread.join(30)
        assert not thread.is_alive()
        (found,) = answers
        assert found.limit is Limit.INTERRUPTED and found.verification.ok
        # The same worker, in a new process, continues before the function has returned.
        after = worker.solve(Job(box(), "random-search", seed=3).resolved())
        assert after.statistics["evaluations"] == 20
        slow.released.set()
        assert slow.ended.wait(20)


class Dies(Asks):
    """Asks, reports, and is killed."""

    name = "dies"

    def run(self, problem, request):
        value = request.control.ask(np.full((1, 2), 0.5))[0, 0]
        request.control.incumbent(value, BlackBoxPoint((0.5, 0.5)))
        time.sleep(0.3)  # until it is heard
        os.kill(os.getpid(), signal.SIGKILL)


class Leaves(Asks):
    """Returns while a thread of its own continues to ask."""

    name = "leaves"

    def run(self, problem, request):
        ask = request.control.ask

        def go_on():
            # The run ends meanwhile, or the channel with it.
            with contextlib.suppress(HiddenData, EOFError, OSError):
                while True:
                    ask(np.zeros((1, 2)))

        ask(np.full((1, 2), 0.5))
        threading.Thread(target=go_on, daemon=True).start()
        while not request.control.oracle._lock.locked():  # until it has asked
            time.sleep(0.01)
        return Answer(Termination.FEASIBLE, point=BlackBoxPoint((0.5, 0.5)))


class Fails(Leaves):
    """The same, but it fails."""

    name = "fails"

    def run(self, problem, request):
        super().run(problem, request)
        raise InvalidData("on purpose")


def test_a_worker_that_is_killed_costs_its_run_alone():
    with Worker() as worker:
        found = worker.solve(Job(box(), Dies()).resolved())
        assert "SIGKILL" in found.message
        assert found.primal_bound == 0.5, "its last point is verified"
        after = worker.solve(Job(box(), "random-search", seed=3).resolved())
        assert after.statistics["evaluations"] == 20


@pytest.mark.parametrize("backend", [Leaves(), Fails()])
def test_an_abandoned_thread_gets_no_answers_and_costs_no_budget(backend):
    """Its question hangs while the next run asks, and is answered after it."""
    wanted = ct.solve(box(), "random-search", seed=3).plan
    slow = Slow(2)
    with Worker() as worker:
        job = Job(box(slow), backend).resolved()
        if backend.name == "fails":
            with pytest.raises(InvalidData, match="on purpose"):
                worker.solve(job)
        else:
            assert worker.solve(job).primal_bound == 0.5
        assert slow.hangs.wait(60)
        calls = []
        model = box(lambda x: float(calls.append(1) or x @ x))
        after = worker.solve(Job(model, "random-search", seed=3, time_limit=30.0).resolved())
        assert after.plan == wanted and after.statistics["evaluations"] == 20
        assert len(calls) == 21
        slow.released.set()
        assert slow.ended.wait(20)
        assert worker.solve(Job(model, "random-search", seed=3).resolved()).plan == wanted
