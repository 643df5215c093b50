"""The contract of models and backends: hidden data, budgets, stages, relaxations, repeats, agreement."""

import gc
import hashlib
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import cloudpickle
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import HiddenData, InvalidData, UnsupportedOption
from crosstrack.models import Check, Model, Verification
from crosstrack.models.fields import Array, Real, declared
from crosstrack.models.formulation import Formulation
from crosstrack.models.programs import MixedIntegerProgram, ProgramBuilder
from crosstrack.solvers import (
    Answer,
    Backend,
    Control,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from crosstrack.solvers.contract import registry
from crosstrack.solvers.contract.registry import shares_process
from crosstrack.solvers.contract.selection import recommended
from crosstrack.solvers.contract.stopping import Evaluations, Progress, Stalled, Target
from crosstrack.solvers.processes import pool

cloudpickle.register_pickle_by_value(sys.modules[__name__])


@dataclass(frozen=True, eq=False)
class Guess(Model[float]):
    """Estimate a number from noisy measurements; the true one is hidden."""

    measured: np.ndarray = declared(Array(("n",)))
    truth: float = declared(Real(), hidden=True)

    kind: ClassVar[str] = "test-guess"
    agreement: ClassVar[float | None] = 0.1

    def verify(self, plan, *, tolerance=1e-6):
        scenes = [np.random.default_rng(seed).normal(0, 1e-3) for seed in self.scene_seeds(8)]
        errors = [abs(plan - self.truth + noise) for noise in scenes]
        spread = 2 * float(np.std(errors)) / np.sqrt(len(errors))
        check = Check(
            "error below 10", "", max(abs(plan - self.truth) - 10, 0.0), "", tolerance, ""
        )
        return Verification(float(np.mean(errors)), (check,), spread)

    def plan_to_data(self, plan):
        return float(plan)

    def plan_from_data(self, data):
        return float(data)

    def distance(self, plan, other):
        return abs(plan - other)


GUESS = Guess([1.0, 2.0, 3.0], 2.25, name="guess")


class Mean(Backend):
    """Returns the mean of the measurements plus an offset."""

    accepts = Guess
    guarantee = Guarantee.HEURISTIC
    deterministic = True

    def __init__(self, name="mean", offset=0.0):
        self.name, self.offset = name, offset

    def run(self, problem, request):
        return Answer(Termination.FEASIBLE, point=float(problem.measured.mean()) + self.offset)


class Spy(Mean):
    """Looks for the hidden number wherever its process can reach, and answers with it."""

    def run(self, problem, request):
        for name in ("truth", "_truth"):
            if hasattr(problem, name):
                return Answer(Termination.FEASIBLE, point=getattr(problem, name))
        frame = sys._getframe()
        while frame is not None:
            for value in frame.f_locals.values():
                held = getattr(value, "model", value)
                if isinstance(held, Model) and "truth" in vars(held):
                    return Answer(Termination.FEASIBLE, point=held.truth)
            frame = frame.f_back
        for thing in gc.get_objects():
            if isinstance(thing, dict) and thing.get("truth") == 2.25:
                return Answer(Termination.FEASIBLE, point=2.25)
        return Answer(Termination.FEASIBLE, point=float(problem.measured.mean()), message="blind")


def test_hidden_data_is_used_in_verification_only():
    view = GUESS.blinded()
    assert view.is_blinded and not GUESS.is_blinded
    assert view.digest == GUESS.digest
    with pytest.raises(HiddenData, match="truth of model 'test-guess' is hidden"):
        view.truth  # noqa: B018
    with pytest.raises(HiddenData):
        view.to_json()
    again = cloudpickle.loads(cloudpickle.dumps(view))
    assert again.is_blinded and again.digest == GUESS.digest
    assert b"truth" not in cloudpickle.dumps({k: v for k, v in vars(view).items() if k != "digest"})


def test_backends_cannot_read_hidden_data():
    found = ct.solve(GUESS, Spy("spy"))
    assert found.message == "blind"
    assert found.plan == 2.0
    assert found.primal_bound == pytest.approx(0.25, abs=0.01), "verified against the truth"
    compared = ct.compare([GUESS], [Spy("spy")], time_limit=20)
    assert compared.solutions[0].message == "blind"
    with pytest.raises(UnsupportedOption, match="hides data from backends"):
        ct.solve(GUESS, Spy("spy"), isolate=False)


class Reference(Mean):
    """Receives the hidden number and returns it."""

    sees_hidden = True
    guarantee = Guarantee.EXACT

    def run(self, problem, request):
        return Answer(Termination.FEASIBLE, point=problem.truth)


def test_a_reference_receives_hidden_data():
    for isolate in (None, False, True):
        found = ct.solve(GUESS, Reference("reference"), isolate=isolate)
        assert found.plan == 2.25
    compared = ct.compare([GUESS], [Reference("reference"), Mean()], time_limit=20)
    assert [one.plan for one in compared.solutions] == [2.25, 2.0]


@pytest.mark.parametrize(
    ("name", "backend"),
    [
        ("sideslip/short", "kalman-filter"),
        ("attractor/henon", "mutual-information"),
        ("unknown-grid/u-trap", "d-star-lite"),
    ],
)
def test_a_run_beside_the_hidden_data_equals_one_in_a_worker(name, backend, monkeypatch):
    model = ct.load(name)
    apart = ct.solve(model, backend, isolate=True)
    monkeypatch.setattr(pool, "in_worker", lambda *_, **__: pytest.fail("a worker started"))
    here = ct.solve(model, backend)
    assert model.plan_to_data(here.plan) == model.plan_to_data(apart.plan)
    assert (here.termination, here.primal_bound) == (apart.termination, apart.primal_bound)
    kinds = {key: type(value) for key, value in apart.statistics.items()}
    assert {key: type(value) for key, value in here.statistics.items()} == kinds


def test_native_algorithms_that_share_the_process_with_hidden_data():
    problems = {"sideslip": True, "attractor": True, "unknown_grid": True, "black_box": True}
    for entry in registry.installed():
        backend = entry.load() if entry.problem in problems else None
        if backend is not None and not backend.sees_hidden:
            assert shares_process(backend) is problems[entry.problem], backend.name


def test_auto_is_never_a_reference_that_sees_hidden_data():
    for name in ("unknown-grid/u-trap", "sideslip/lane-change"):
        assert not recommended(ct.load(name)).sees_hidden


class Witnessed(Guess):
    """Knows what was asked of it in a run."""

    def oracle(self):
        return Witness()


class Witness:
    def __init__(self):
        self.asked = []

    def __call__(self, questions):
        self.asked += questions[:, 0].tolist()
        return questions

    def contradiction(self, plan):
        return "" if plan in self.asked else f"{plan:g} was never asked for"


class Asker(Mean):
    def run(self, problem, request):
        request.control.ask(np.array([[2.5]]))
        return Answer(Termination.FEASIBLE, point=2.5 + self.offset)


def test_a_plan_that_the_run_did_not_execute_is_rejected():
    model = Witnessed([1.0, 2.0], 2.25)
    assert ct.solve(model, Asker("asker")).plan == 2.5
    refused = ct.solve(model, Asker("asker", -0.25))
    assert refused.termination == Termination.REJECTED and refused.plan is None
    assert refused.rejected_plan == 2.25
    assert "2.25 was never asked for" in refused.message


def test_a_warm_start_of_a_model_with_hidden_data_is_verified_by_the_caller():
    class Warm(Mean):
        features = frozenset({Feature.WARM_START})

        def run(self, problem, request):
            return Answer(Termination.FEASIBLE, point=request.warm_start)

    assert ct.solve(GUESS, Warm("warm"), warm_start=2.5).plan == 2.5
    with pytest.raises(InvalidData, match="warm_start is no plan"):
        ct.solve(GUESS, Warm("warm"), warm_start=99.0)


def test_plans_agree_if_no_backend_proves_a_bound():
    near = ct.compare([GUESS], [Mean("one"), Mean("two", 0.05)], time_limit=20)
    assert near.outcome == "AGREED"
    assert "agreement, not optimality" in near.verdicts[0].evidence
    far = ct.compare([GUESS], [Mean("one"), Mean("two", 0.5)], time_limit=20)
    assert far.outcome == "INCONCLUSIVE"
    assert "differ by 0.5" in far.verdicts[0].evidence
    alone = ct.compare([GUESS], [Mean("one")], time_limit=20)
    assert alone.outcome == "INCONCLUSIVE"


def test_scenes_follow_from_the_digest():
    assert GUESS.scene_seeds(3) == Guess([1.0, 2.0, 3.0], 2.25).scene_seeds(3)
    assert GUESS.scene_seeds(3) != Guess([1.0, 2.0, 3.5], 2.25).scene_seeds(3)
    checked = GUESS.verify(2.0)
    assert checked.spread > 0
    assert Verification.from_dict(checked.to_dict()).spread == checked.spread


# -- relaxations ---------------------------------------------------------------------------------------


def knapsack(capacity=5.0):
    """Return a knapsack whose optimum is -9 and whose linear relaxation is -9.5."""
    build = ProgramBuilder()
    take = build.columns("item taken", 3, upper=1, cost=[-5, -4, -3], integral=True)
    build.rows("weight", 1, (0, take, [2, 3, 1]), upper=capacity)
    return build.build(name="knapsack")


class Relaxed(Backend):
    """The linear relaxation of a mixed-integer program, by HiGHS."""

    name = "relaxed"
    accepts = MixedIntegerProgram
    guarantee = Guarantee.RELAXATION
    features = frozenset({Feature.DUAL_BOUND})

    def run(self, problem, request):
        from crosstrack.solvers import find_backend

        answer = find_backend("highs").run(problem.relaxed(), request)
        return Answer(
            answer.termination,
            None,
            answer.point,
            answer.primal_bound,
            answer.dual_bound,
            answer.duals,
        )


def test_the_bound_of_a_relaxation_counts():
    program = knapsack(4.0)
    found = ct.solve(program, Relaxed())
    assert found.plan is None, "its point is no plan"
    assert found.termination == "no_solution"
    assert found.dual_bound == pytest.approx(-8 - 4 / 3)
    verdict = ct.compare([program], ["highs", Relaxed()], time_limit=20)
    assert verdict.outcome == "AGREED"
    assert verdict.solutions[1].dual_bound == pytest.approx(-8 - 4 / 3)


def test_a_relaxation_that_is_infeasible_proves_the_model_infeasible():
    found = ct.solve(knapsack(-1.0), Relaxed())
    assert found.termination == "infeasible"
    assert ct.compare([knapsack(-1.0)], [Relaxed()], time_limit=20).outcome == "AGREED"


def test_an_exact_backend_proves_nothing_of_a_model_by_an_approximation():
    class Coarse(Formulation):
        name = "coarse"
        program_type = MixedIntegerProgram
        relaxes = False

        def build(self):
            return knapsack(0.0)

        def encode(self, plan):
            return np.zeros(3)

        def decode(self, point):
            return 2.0

    class Approximated(Guess):
        formulations: ClassVar[dict] = {"coarse": Coarse}
        default_formulation = "coarse"
        kind = "test-approximated"

    found = ct.solve(Approximated([1.0, 2.0], 2.25), "highs", isolate=True)
    assert found.plan == 2.0
    assert found.dual_bound is None
    assert found.termination == "feasible"


# -- budgets, criteria, stages -------------------------------------------------------------------------


class Counting(Mean):
    """Tries one number after another, each an evaluation."""

    features = frozenset({Feature.EVALUATIONS, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.SEED})
    deterministic = False

    def __init__(self, name="counting", pause=0.0):
        super().__init__(name)
        self.pause = pause

    def run(self, problem, request):
        generator = np.random.default_rng(request.seed)
        best, plan = np.inf, None
        while request.control.evaluated():
            time.sleep(self.pause)
            tried = float(generator.uniform(0, 4))
            value = abs(tried - float(problem.measured.mean()))
            if value < best:
                best, plan = value, tried
                request.control.incumbent(value, tried)
        return Answer(
            Termination.NO_SOLUTION if plan is None else Termination.FEASIBLE,
            request.control.reason,
            plan,
            statistics={"evaluations": request.control.evaluations},
        )


def test_evaluations_and_target_end_a_run():
    counted = ct.solve(GUESS, Counting(), evaluations=50, seed=3)
    assert counted.limit is Limit.EVALUATIONS
    assert counted.statistics["evaluations"] == 50
    assert counted.plan == ct.solve(GUESS, Counting(), evaluations=50, seed=3).plan
    aimed = ct.solve(GUESS, Counting(), target=0.05, evaluations=100_000, seed=3)
    assert aimed.limit is Limit.TARGET
    assert aimed.incumbents[-1].objective <= 0.05
    assert aimed.options["target"] == 0.05 and aimed.options["evaluations"] == 100_000


def test_any_criterion_ends_a_run():
    found = ct.solve(GUESS, Counting(pause=0.01), stop=Stalled(0.4), time_limit=20, seed=1)
    assert found.limit is Limit.STALLED
    assert found.seconds["total"] < 15
    assert "Stalled" in found.options["stop"]


@pytest.mark.parametrize("option", [{"evaluations": 0}, {"target": "low"}, {"stop": 3.0}])
def test_bad_budgets_are_refused(option):
    with pytest.raises(UnsupportedOption, match=next(iter(option)).capitalize()[1:]):
        ct.solve(GUESS, Counting(), **option)


@pytest.mark.parametrize("option", [{"evaluations": 5}, {"target": 1.0}, {"stop": Stalled(1.0)}])
def test_a_budget_that_a_backend_does_not_know_is_refused(option):
    with pytest.raises(UnsupportedOption, match=f"does not support {next(iter(option))}="):
        ct.solve(GUESS, Mean(), **option)


def test_criteria_compose():
    either = Evaluations(10) | Target(1.0)
    both = Evaluations(10) & Target(1.0)
    for evaluations, best, first, second in (
        (5, 2.0, None, None),
        (10, 2.0, Limit.EVALUATIONS, None),
        (5, 1.0, Limit.TARGET, None),
        (10, 1.0, Limit.EVALUATIONS, Limit.TARGET),
    ):
        progress = Progress(0.0, evaluations, best, 0.0)
        assert either.reached(progress) is first
        assert both.reached(progress) is second


def test_a_stage_runs_under_the_clock_the_flag_and_the_seeds_of_its_run():
    seen = []

    class Stage(Mean):
        features = frozenset({Feature.SEED, Feature.INCUMBENTS})

        def run(self, problem, request):
            seen.append((request.seed, request.time_limit, request.tolerance))
            request.control.incumbent(1.0, 5.0)
            return Answer(Termination.FEASIBLE, point=5.0)

    for _ in range(2):
        request = Request(time_limit=30.0, seed=7, tolerance=1e-4, control=Control())
        request.control.arm(30.0)
        for limit in (None, 1.0):
            request.within(Stage(), GUESS, time_limit=limit, lift=lambda f, x: (f + 1, x + 1))
        request.control.disarm()
    assert seen[0][0] == seen[2][0] and seen[1][0] == seen[3][0], "same seed, same stages"
    assert seen[0][0] != seen[1][0], "each stage has a seed of its own"
    assert seen[1][1] == 1.0 and 29 < seen[0][1] <= 30
    assert seen[0][2] == 1e-4
    _, objective, point, _ = request.control.events.get()
    assert (objective, point) == (2.0, 6.0), "incumbents are reported as the run's own"
    request.control.stop(Limit.INTERRUPTED)
    ended = request.within(Stage(), GUESS)
    assert ended.termination is Termination.NO_SOLUTION and ended.limit is Limit.INTERRUPTED
    assert len(seen) == 4, "a stopped run begins no stage"


def test_stages_share_the_evaluations_of_their_run():
    request = Request(control=Control(Evaluations(30)))
    first = request.within(Counting(), GUESS, seed=1)
    assert first.statistics["evaluations"] == 30
    assert first.limit is Limit.EVALUATIONS
    second = request.within(Counting(), GUESS, seed=2)
    assert second.termination is Termination.NO_SOLUTION
    assert second.limit is Limit.EVALUATIONS


def test_a_target_ends_the_starts_that_would_follow():
    found = ct.solve(GUESS, Counting(), target=10.0, starts=4, seed=1, evaluations=5)
    assert found.limit is Limit.TARGET
    assert len(found.starts) == 1


def test_stopping_a_run_stops_its_stages():
    control = Control()
    with control.stage(60.0) as part, part.stage(None) as inner:
        control.stop(Limit.INTERRUPTED)
        assert part.stopped and inner.stopped and inner.reason is Limit.INTERRUPTED
        part.evaluated(3)
    assert control.evaluations == 3


def test_another_deadline_replaces_the_first():
    control = Control()
    control.arm(0.05)
    control.arm(60.0)
    time.sleep(0.1)
    assert not control.stopped
    control.disarm()


# -- repeats, files ------------------------------------------------------------------------------------


def test_repeats_give_quartiles_over_seeds():
    compared = ct.compare(
        [GUESS], [Counting(), Mean()], evaluations=20, repeats=5, seed=10, time_limit=20
    )
    (verdict,) = compared.verdicts
    runs = [s for s in verdict.solutions if s.backend == "counting"]
    assert [s.seed for s in runs] == [10, 11, 12, 13, 14]
    assert len(verdict.solutions) == 6, "what draws nothing runs once"
    (spread,) = verdict.spreads
    values = sorted(s.primal_bound for s in runs)
    assert (spread.runs, spread.successes, spread.success_rate) == (5, 5, 1.0)
    assert spread.objective == (values[1], values[2], values[3])
    assert verdict.to_dict()["repeats"][0]["objective"] == spread.objective
    assert "5 of 5" in str(compared)
    with pytest.raises(UnsupportedOption, match="repeats"):
        ct.compare([GUESS], [Mean()], repeats=0)


def test_a_file_that_the_answer_depends_on_is_recorded(tmp_path):
    class Learned(Mean):
        options: ClassVar[dict] = {"weights": Option(None, "A file of weights.", str, file=True)}

        def run(self, problem, request):
            text = Path(request.options["weights"]).read_text()
            return Answer(Termination.FEASIBLE, point=float(text))

    weights = tmp_path / "weights.txt"
    weights.write_text("2.0")
    asked = {"backend_options": {"weights": str(weights)}}
    found = ct.solve(GUESS, Learned("learned"), **asked)
    assert found.plan == 2.0
    assert found.options["files"] == {"weights": hashlib.sha256(b"2.0").hexdigest()}
    with pytest.raises(UnsupportedOption, match="does not exist"):
        ct.solve(GUESS, Learned("learned"), backend_options={"weights": "nowhere"})
