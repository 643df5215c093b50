"""Isolation of the true map from policies: model, process and queries."""

import contextlib
import dataclasses
import gc
import signal
import sys
import threading

import cloudpickle
import numpy as np
import pytest
from unknown_grid.scenes import run
from unknown_grid.walks import Told

import crosstrack as ct
from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.instances.unknown_grid import draw_scenes, maze
from crosstrack.jit import OutOfTime
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns, World, world
from crosstrack.solvers import Answer, Termination, find_backend, register_backend
from crosstrack.solvers.contract import registry
from crosstrack.solvers.contract.registry import shares_process
from crosstrack.solvers.processes import pool
from crosstrack.solvers.unknown_grid.native import NavigationBackend
from crosstrack.solvers.unknown_grid.replanning import DStarLite, Replanning

pytestmark = pytest.mark.usefixtures("interpreted_workers")

cloudpickle.register_pickle_by_value(sys.modules[__name__])

ROWS, COLUMNS = 23, 29


@pytest.fixture
def model():
    """Return a scene that shows only the first cell at the start."""
    blocked = np.random.default_rng(23).random((1, ROWS, COLUMNS)) < 0.4
    blocked[0, 0, 0] = blocked[0, -1, -1] = False
    ends = [[0, 0]], [[ROWS - 1, COLUMNS - 1]]
    return UnknownGridNavigation(blocked, *ends, [ROWS, COLUMNS], view=(1, 1), name="secret")


class Spy(NavigationBackend):
    """Policy that searches its process for the map."""

    name = "spy"

    def policy(self, problem, scenes, request):
        raise AssertionError("it leads nobody")

    def run(self, problem, request):
        request.control.ask(np.array([[0.0, 1.0]]))  # the world has moved the vehicle, elsewhere
        found = []
        for name in ("blocked", "fewest_steps", "oracle"):
            with contextlib.suppress(HiddenData):
                thing = getattr(problem, name)
                if name != "blocked":
                    thing = thing()
                if name == "oracle":
                    thing = thing(np.array([[0.0, -1.0]]))
                found.append(f"read {name}")
        for thing in gc.get_objects():
            if type(thing) is World and not thing.problem.is_blinded:
                found.append("met a world")
            # Arrays themselves are not among what is collected, but what holds them is.
            for held in gc.get_referents(thing):
                if type(held) is np.ndarray and held.size == ROWS * COLUMNS:
                    found.append(f"met {held.dtype}")
        message = "; ".join(found) or "blind"
        point = NavigationRuns(("D",), ("gave up",))
        return Answer(Termination.FEASIBLE, point=point, message=message)


def test_a_policy_meets_no_map(model):
    found = ct.solve(model, Spy())
    assert found.message == "blind"
    assert found.primal_bound == model.steps + 1
    here = run(Spy(), model)
    # The search finds the map if it is present.
    assert "met a world" in here.message and "met bool" in here.message
    with pytest.raises(UnsupportedOption, match="hides data from backends"):
        ct.solve(model, Spy(), isolate=False)


class Sly(DStarLite):
    """Subclass of a backend that shares the process with the maps."""

    run = Spy.run


class Claiming(Spy):
    """Foreign backend that claims to share the process."""

    name = "claiming"
    shares_process = True


class Forged(DStarLite):
    """Subclass with the module and name of its base."""

    run = Spy.run


Forged.__module__, Forged.__qualname__ = DStarLite.__module__, DStarLite.__qualname__


def altered():
    """Return an instance of a backend that shares the process, with another method."""
    backend = DStarLite()
    backend.run = Spy().run
    return backend


class Hiding(dict):
    """Attributes of an instance that do not show."""

    def keys(self):
        return {}.keys()


def disguised():
    """Return an altered instance whose attributes do not show."""
    backend = DStarLite()
    backend.__dict__ = Hiding(run=Spy().run)
    return backend


def named():
    """Return an instance with an object of a user's class in place of its problem."""
    backend = DStarLite()
    backend.problem = type("Problem", (str,), {})("unknown-grid")
    return backend


def test_an_instance_with_objects_of_a_user_does_not_share_the_process():
    assert not shares_process(disguised()) and not shares_process(named())


@pytest.mark.parametrize("backend", [Sly(), Claiming(), altered()])
def test_foreign_code_does_not_share_the_process(model, backend):
    assert not shares_process(backend)
    assert ct.solve(model, backend).message == "blind"
    with pytest.raises(UnsupportedOption, match="hides data from backends"):
        ct.solve(model, backend, isolate=False)


def test_a_forged_class_does_not_share_the_process(model):
    assert shares_process(DStarLite()) and not shares_process(Forged())
    with pytest.raises(UnsupportedOption, match="hides data from backends"):
        ct.solve(model, Forged(), isolate=False)


def test_a_registered_backend_does_not_share_the_process(model, monkeypatch):
    monkeypatch.setattr(registry, "_session", [])
    register_backend(Claiming)
    assert ct.solve(model, "claiming").message == "blind"


@pytest.mark.parametrize("name", ["d-star-lite", "current-view", "baseline-2"])
def test_a_run_in_this_process_equals_one_in_a_worker(name, monkeypatch):
    model = draw_scenes("mixed", scenes=5, seed=4)
    apart = ct.solve(model, name, isolate=True)
    monkeypatch.setattr(pool, "in_worker", lambda *_, **__: pytest.fail("a worker started"))
    here = ct.solve(model, name)
    assert here.plan == apart.plan and here.primal_bound == apart.primal_bound
    assert here.verification == apart.verification
    skipped = "ms a decision"
    counts = [{k: v for k, v in each.statistics.items() if k != skipped} for each in (here, apart)]
    assert counts[0] == counts[1]


def test_a_plan_in_this_process_must_match_the_executed_actions(monkeypatch):
    model = UnknownGridNavigation.drawn(["S.@T", "...."], view=(3, 3))
    said = NavigationRuns(("DRRRU",), ("reached",))

    def lie(self, problem, request):
        request.control.ask(np.array([[0.0, 3.0]]))
        return Answer(Termination.FEASIBLE, point=said)

    monkeypatch.setattr(DStarLite, "run", lie)  # a defect of crosstrack itself
    found = ct.solve(model, DStarLite(), isolate=False)
    assert found.termination == "rejected"
    assert "actions of scene 0 are not those that the run took" in found.message


@pytest.fixture
def compiled():
    """Compile the kernels before times are measured."""
    ct.solve(UnknownGridNavigation.drawn(["S.T"], view=(3, 3)), "a-star-replanning")


@pytest.mark.usefixtures("compiled")
def test_limits_of_a_run_in_this_process():
    model = maze(401, 401, 3, view=(3, 3), steps=10**6)
    found = ct.solve(model, "a-star-replanning", time_limit=0.5)
    assert found.limit == "time" and found.plan.outcomes == ("gave up",)
    assert found.verification.ok
    assert found.seconds["total"] < 3
    small = UnknownGridNavigation.drawn(["S.@T", "...."], view=(3, 3))
    apart = ct.solve(small, "d-star-lite", memory_limit=2000)
    assert apart.plan == ct.solve(small, "d-star-lite").plan
    with pytest.raises(UnsupportedOption, match="memory_limit is kept in a worker"):
        ct.solve(small, "d-star-lite", memory_limit=2000, isolate=False)


def test_a_run_out_of_time_keeps_its_executed_actions(monkeypatch):
    """An interpreted or uncompiled kernel ends with an exception."""
    model = UnknownGridNavigation.drawn(["S...T", "....."], view=(3, 3))
    decide = Replanning.decide

    def late(self, looks):
        if looks.positions[0, 1] == 2:
            raise OutOfTime
        return decide(self, looks)

    monkeypatch.setattr(Replanning, "decide", late)
    found = ct.solve(model, "a-star-replanning")
    assert found.limit == "time" and found.verification.ok
    assert found.plan.actions == ("RR",) and found.plan.outcomes == ("gave up",)


@pytest.mark.parametrize("last", [0, 1, 2])
def test_a_run_whose_simulator_is_out_of_time_is_verified(last, monkeypatch):
    """The line of sight is a kernel, too."""
    model = UnknownGridNavigation.drawn(["S.T", "..."], ["S..", "..T"], view=(3, 3), occlusion=True)
    sense = world.sense

    def late(model, tracks, scenes, taken, *further):
        if (taken > last).any():
            raise OutOfTime
        return sense(model, tracks, scenes, taken, *further)

    monkeypatch.setattr(world, "sense", late)
    found = ct.solve(model, "d-star-lite")
    assert found.termination == "feasible", found.message
    assert found.plan.actions[1] == "DRR"[:last] and found.plan.outcomes[1] == "gave up"
    assert found.limit == "time"


@pytest.mark.usefixtures("compiled")
def test_ctrl_c_stops_a_run_in_this_process():
    model = maze(401, 401, 3, view=(3, 3), steps=10**6)
    timer = threading.Timer(1.0, signal.raise_signal, [signal.SIGINT])
    timer.start()
    found = ct.solve(model, "a-star-replanning")
    timer.cancel()
    assert found.limit == "interrupted" and found.verification.ok


def test_the_view_of_a_model_holds_no_map(model):
    view = cloudpickle.loads(cloudpickle.dumps(model.blinded()))
    plan = NavigationRuns(("",), ("gave up",))
    asks = (
        lambda: view.blocked, view.fewest_steps, lambda: view.verify(plan), lambda: view.score(plan),
        lambda: view.replays(plan), view.to_json,
    )  # fmt: skip
    for ask in asks:
        with pytest.raises(HiddenData, match="blocked of model 'unknown-grid' is hidden"):
            ask()
    assert view.describe() == model.describe() and view.digest == model.digest
    secret = model.blocked.tobytes()
    assert secret in cloudpickle.dumps(model)
    assert secret not in cloudpickle.dumps(model.blinded())
    for known in (view.starts, view.targets, view.shape, view.view, view.steps, view.uav):
        assert known is not None


def test_an_answer_says_nothing_of_cells_that_are_not_shown(model):
    """Walks cannot distinguish two maps that differ in one unseen cell."""
    other = model.blocked.copy()
    other[0, 5, 5] = not other[0, 5, 5]
    shown = UnknownGridNavigation(
        other, model.starts, model.targets, model.shape, view=model.view, steps=model.steps
    )
    one, two = World(model), World(shown)
    for action in (-1, 1, 3, 1, 3, 1, 0, 2, 2, 0, -1):
        question = np.array([[0.0, action]])
        np.testing.assert_array_equal(one(question), two(question))
    assert np.abs(one.positions - 5).max() > 1, "it would have been seen from beside"


class Greedy(Told):
    """Policy with invalid queries: another scene, an unknown action, or a step after the end."""

    name = "greedy"

    def __init__(self, *questions):
        super().__init__("")
        self.questions = questions

    def run(self, problem, request):
        for question in self.questions:
            request.control.ask(np.array([question], float))
        raise AssertionError("it was answered")


@pytest.mark.parametrize(
    ("questions", "message"),
    [
        ([(1, -1)], "scene must be 0 … 0, got 1"),
        ([(0, 0)] * 41, "the run of scene 0 has ended"),
    ],
)
def test_rejects_invalid_queries_of_a_policy(model, questions, message):
    with pytest.raises(InvalidData, match=message):
        ct.solve(model, Greedy(*questions))


class Liar(Told):
    """Policy that returns actions it did not execute."""

    name = "liar"

    def __init__(self, *said, outcome="reached"):
        super().__init__("RR")
        self.said, self.outcome = said, outcome

    def run(self, problem, request):
        answer = super().run(problem, request)
        point = NavigationRuns(self.said, (self.outcome,) * len(self.said))
        return dataclasses.replace(answer, point=point)


@pytest.mark.parametrize(
    ("said", "outcome", "termination"),
    [
        ("RR", "gave up", "feasible"),
        ("DRRRU", "reached", "rejected"),  # a way, but not the one that was gone
        ("R", "gave up", "rejected"),
        ("", "no way", "rejected"),
        ("RR", "reached", "rejected"),
    ],
)
def test_a_plan_must_match_the_executed_actions(said, outcome, termination):
    model = UnknownGridNavigation.drawn(["S.@T", "...."], view=(3, 3))
    found = ct.solve(model, Liar(said, outcome=outcome))
    assert found.termination == termination, found.message
    assert (found.plan is None) is (termination == "rejected")
    if said != "RR":
        assert "actions of scene 0 are not those that the run took" in found.message


def test_the_reference_alone_sees_the_map(model):
    names = [
        one.name for one in ct.backends() if one.accepts == model.kind and one.state != "broken"
    ]
    assert [name for name in names if find_backend(name).sees_hidden] == ["oracle"]
    rows = ct.compare([model], ["oracle", "d-star-lite"], workers=2).solutions
    assert [one.termination for one in rows] == ["optimal", "feasible"]
    assert rows[0].dual_bound == rows[0].primal_bound <= rows[1].primal_bound
