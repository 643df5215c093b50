"""Plans and bounds of runs that are cut short, and consistency of bounds with plans."""

import json
import os
import signal
import time
from itertools import pairwise

import pytest
from commands import run
from fakes import Fixed, Killed, Raising

import crosstrack as ct
from crosstrack.models import ErrorCorrectionRouting, Route
from crosstrack.models.verification import Verification
from crosstrack.solvers import Guarantee
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.contract.solution import without_rounding

ROUTE = Route((0, 1, 2, 4))
ROW_7 = (0, 89, 264, 159, 232, 101, 174, 227, 213, 222, 242, 274, 308, 207, 102, 326)


@pytest.fixture
def model():
    return ct.load("error-correction/example-1")


class Proving(Fixed):
    """Proves bounds and dies, or hears nothing any more."""

    def run(self, problem, request):
        for bound in (3.0, 4.0, None, float("inf"), 3.5):
            request.control.prove(bound)
        time.sleep(0.2)
        if self.claims == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        while True:
            time.sleep(0.05)

    def patience(self, kind):
        return 0.3


@pytest.mark.parametrize(("how", "limit"), [("dies", None), ("hangs", "time")])
def test_a_run_cut_short_keeps_its_bound_and_its_warm_start(model, how, limit):
    left = ct.solve(model, Proving(claims=how), time_limit=0.6, warm_start=ROUTE, isolate=True)
    assert (left.termination, left.limit, left.plan) == ("feasible", limit, ROUTE)
    assert (left.primal_bound, left.dual_bound) == (pytest.approx(4.5), 4.0)
    assert "the plan is the warm start" in left.message


@pytest.mark.parametrize(("bound", "ends"), [(4.5, "optimal"), (4.4, "feasible")])
def test_a_start_that_the_bound_meets_is_optimal(model, bound, ends):
    nothing = Fixed(route=None, claims="no_solution", dual=bound)
    found = ct.solve(model, nothing, warm_start=ROUTE)
    assert (found.termination, found.plan) == (ends, ROUTE)
    assert ct.solve(model, nothing).termination == "no_solution"


def test_a_plan_that_the_floor_meets_is_optimal_whatever_the_solver_knows():
    model = ct.load(
        "error-correction/7"
    )  # over the arcs that its best route leaves possible, no way is shorter
    start = Route(ROW_7)
    found = ct.solve(model, "highs", formulation="paper", time_limit=1e-3, warm_start=start)
    assert (found.termination, found.limit, found.gap) == ("optimal", None, 0.0)


def test_a_heuristic_cut_short_proves_nothing(model):
    backend = Proving(claims="dies", guarantee=Guarantee.HEURISTIC)
    assert ct.solve(model, backend, isolate=True).dual_bound is None


def test_only_a_run_without_a_plan_returns_its_start(model):
    failed = ct.solve(model, Raising(), warm_start=ROUTE)
    assert (failed.termination, failed.plan) == ("feasible", ROUTE)
    assert "the solver tripped" in failed.message
    assert ct.solve(model, Raising()).termination == "failed"
    none = Fixed(route=None, claims="infeasible")
    assert ct.solve(model, none, warm_start=ROUTE).termination == "infeasible"
    rejected = ct.solve(model, Fixed(route=(0, 2, 4)), warm_start=ROUTE)
    assert (rejected.termination, rejected.plan) == ("rejected", None)
    assert ct.solve(model, Killed(), isolate=True, warm_start=ROUTE).plan == ROUTE


def test_a_stage_passes_its_bounds_on_in_the_units_of_the_whole():
    whole, heard = Control(), []
    with whole.stage(None, None, lambda bound: heard.append(2 * bound)) as part:
        for bound in (1.0, 0.5, 3.0, float("nan")):
            part.prove(bound)
    assert heard == [2.0, 6.0]
    assert whole.bound is None


@pytest.mark.parametrize("share", [1e-16, 1e-12, 1e-9, 5e-7])
def test_a_bound_is_not_above_its_plan_by_rounding(model, share):
    answer = ct.solve(model, Fixed(dual=4.5 * (1 + share)))
    assert answer.termination == "optimal"
    assert answer.dual_bound == answer.primal_bound
    assert answer.gap == 0


def test_a_bound_that_contradicts_its_plan_is_reported(model):
    wrong = ct.solve(model, Fixed(dual=4.5 * (1 + 1e-5)))
    assert wrong.dual_bound == 4.5 * (1 + 1e-5)
    verdict = ct.compare([model], ["label-setting", Fixed(dual=4.51)])
    assert "CONTRADICTION" in str(verdict)


def test_the_rounding_allowance_has_a_scale_and_a_ceiling():
    def cut(dual, objective, tolerance=1e-6, scale=1.0):
        return without_rounding(dual, Verification(objective, (), scale=scale), tolerance)

    assert cut(1e6 + 0.5, 1e6) == 1e6
    assert cut(1e6 + 2.0, 1e6) == 1e6 + 2.0
    assert cut(1e6 + 2.0, 1e6, tolerance=0.1) == 1e6 + 2.0
    assert cut(1e6 + 0.5, 1e6, tolerance=1e-9) == 1e6 + 0.5
    assert cut(2e-8, 1e-8) == 2e-8
    assert cut(5e-10, -5e-10) == -5e-10
    assert cut(3e-4, 0.0, scale=1e6) == 0.0
    assert cut(-1.0, 1.0) == -1.0


def test_solutions_print_the_corrections_of_a_route(model):
    answer = ct.solve(model)
    assert "objective 4.5 (2 corrections)" in str(answer)
    assert "plan: 0-1-2-4 (2 corrections)" in answer.summary()
    assert ErrorCorrectionRouting.remark(Route((0, 1, 4))) == "1 correction"
    assert "(" not in str(ct.solve(ct.load("grid-path/one-cell"))).partition("objective")[2]


def test_details_show_every_stop_with_its_errors_and_what_is_allowed(model, tmp_path):
    rows = model.details(ROUTE)
    assert [row["kind"] for row in rows] == ["A", "horizontal", "vertical", "B"]
    assert rows[0]["limit of vertical"] is None
    assert rows[1]["horizontal after"] == rows[2]["vertical after"] == 0.0
    assert rows[2]["limit of vertical"] == model.alpha1
    assert rows[2]["limit of horizontal"] == model.alpha2
    assert rows[3]["limit of horizontal"] == model.theta
    assert rows[-1]["distance (m)"] == pytest.approx(4.5)
    for before, after in pairwise(rows):
        leg = after["distance (m)"] - before["distance (m)"]
        grown = before["vertical after"] + model.vertical_rate * leg
        assert after["vertical"] == pytest.approx(grown)
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps(model.plan_to_data(ROUTE)))
    name = "error-correction/example-1"
    assert json.loads(run("check", name, plan, "--details", "--json").stdout)["details"] == rows
    assert "details" not in json.loads(run("check", name, plan, "--json").stdout)
    shown = run("solve", name, "--in-process", "--details").stdout
    assert "horizontal after" in shown
    assert "horizontal after" not in run("solve", name, "--in-process").stdout
