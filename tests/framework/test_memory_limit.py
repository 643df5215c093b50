"""One name and one unit for the memory limit in every verb that runs something."""

import sys

import pytest

import crosstrack as ct
from crosstrack.errors import UnsupportedOption, WorkerFailure
from crosstrack.solvers import Answer, Backend, Feature, Guarantee, Limit, Termination

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="memory is counted on Linux only")
#: MiB that a worker with NumPy does not reach, and the hungry backend does.
LIMIT = 700


class Hungry(Backend):
    """Reports a plan, and takes more and more memory."""

    name = "hungry"
    accepts = ct.models.ErrorCorrectionRouting
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT})
    summary = "takes memory"

    def run(self, problem, request):
        point = ct.solve(problem, "label-setting").plan
        request.control.incumbent(1.0, point)
        held = []
        while not request.control.stopped:
            held.append(b"x" * 2**26)
        return Answer(Termination.NO_SOLUTION, limit=request.control.reason)


@pytest.fixture(scope="module")
def model():
    return ct.load("error-correction/example-1")


def test_solve_keeps_the_incumbent_of_a_run_that_takes_too_much(model):
    answer = ct.solve(model, Hungry(), memory_limit=LIMIT, time_limit=60)
    assert answer.limit is Limit.MEMORY
    assert answer.plan is not None
    assert "MiB" in answer.message
    assert answer.options["memory_limit"] == LIMIT


def test_compare_and_front_take_the_limit(model):
    found = ct.compare([model], ["label-setting", Hungry()], memory_limit=LIMIT, time_limit=60)
    limits = [one.limit for one in found.verdicts[0].solutions]
    assert limits == [None, Limit.MEMORY]
    places = [[0, 0], [4, 0], [5, 5], [5, -5]]
    fleet = ct.models.FleetRouting(2, points=places, objective="sum")
    front = ct.front(fleet, "max", points=2, memory_limit=2048)
    assert front.points
    assert all(point.solution.options["memory_limit"] == 2048 for point in front.points)


def test_diagnose_takes_the_limit():
    model = ct.load("resource-routing/no-way")
    assert ct.diagnose(model, memory_limit=2048).feasible is False
    with pytest.raises(WorkerFailure, match="memory_limit is 64 MiB"):
        ct.diagnose(model, "highs", memory_limit=64)


@pytest.mark.parametrize("value", [0, -1, 4, 63.9, float("inf"), "1 GiB", True])
def test_a_limit_that_no_process_can_keep_is_refused(model, value):
    for verb in (ct.solve, lambda m, **how: ct.compare([m], ["two-stage"], **how)):
        with pytest.raises(UnsupportedOption, match="memory_limit"):
            verb(model, memory_limit=value)


def test_a_run_in_this_process_has_no_limit(model):
    with pytest.raises(UnsupportedOption, match="isolate=False"):
        ct.solve(model, memory_limit=1024, isolate=False)
