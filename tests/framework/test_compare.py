"""The cross-check: verdicts, workers that die or hang, campaigns that are interrupted and resumed."""

import json
import os
import resource
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from commands import run
from fakes import Counting, Fixed, Hanging, Killed, Raising
from listening import solutions

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedOption
from crosstrack.models import Check, Verification
from crosstrack.solvers import Guarantee, Solution, Termination
from crosstrack.solvers.contract.verdict import judge


@pytest.fixture
def model():
    return ct.load("error-correction/example-1")


#: Guarantees by the first letter of a backend in the cases below.
GUARANTEES = {
    "a": Guarantee.EXACT,
    "b": Guarantee.EXACT,
    "h": Guarantee.HEURISTIC,
    "r": Guarantee.RELAXATION,
}


def answer(backend, primal=None, dual=None, termination="optimal", worst=0.0, spread=0.0):
    """An answer as the dispatcher makes it, for the logic of verdicts alone."""
    check = Check("vertical error at B", "18", worst, "error", 1e-6, "point 4", 1e-9)
    return Solution(
        model="error-correction", instance="i", digest="d", backend=backend,
        termination=Termination(termination), primal_bound=primal, dual_bound=dual,
        plan=None if primal is None else object(), stored_plan=None if primal is None else {},
        verification=None if primal is None else Verification(primal, (check,), spread),
        options={"gap": 1e-6, "tolerance": 1e-6}, guarantee=GUARANTEES[backend[0]],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("answers", "outcome", "words"),
    [
        ([answer("a", 10, 10), answer("b", 10, 10)], "AGREED", "optimum 10: plan by a, b; bound by a, b"),
        ([answer("h", 10, None, "feasible"), answer("a", None, 10, "no_solution")], "AGREED", "plan by h; bound by a"),
        ([answer("a", 10, 10)], "AGREED", "optimum 10"),
        ([answer("a", 10, 10), answer("b", 10 + 1e-6, 10)], "AGREED", "optimum 10"),
        ([answer("a", 11, 11), answer("h", 10, None, "feasible")], "CONTRADICTION", "a claims .* 11, but h has"),
        ([answer("a", 10, 10), answer("b", 12, 12)], "CONTRADICTION", "b claims .* 12, but a has"),
        ([answer("a", 10, 10), answer("b", termination="infeasible")], "CONTRADICTION", "b claims infeasible, but a"),
        ([answer("a", 10, 12)], "CONTRADICTION", "a claims .* 12, but a has"),
        ([answer("a", termination="infeasible"), answer("b", termination="infeasible")], "AGREED", "infeasible, proven by a, b"),
        ([answer("a", 10, 8, "feasible")], "INCONCLUSIVE", "no proof that they meet"),
        ([answer("h", 10, None, "feasible")], "INCONCLUSIVE", "no exact bound"),
        ([answer("a", termination="no_solution")], "INCONCLUSIVE", "no verified plan"),
        ([answer("h", termination="infeasible")], "INCONCLUSIVE", "no verified plan"),
        # Bounds of heuristics are not bounds, and a plan within tolerance contradicts no claim.
        ([answer("a", 10, 10), answer("h", 12, 12)], "AGREED", "bound by a"),
        ([answer("a", 10, 10), answer("b", 9.6, 9.6, worst=5e-7)], "AGREED", "plan by a"),
        ([answer("a", termination="infeasible"), answer("b", 9.6, 9.6, worst=5e-7)], "AGREED", "infeasible"),
        ([answer("b", 9.6, 9.6, worst=5e-7)], "INCONCLUSIVE", "depend on a tolerance"),
        # A relaxation proves what an exact backend does, but not that a model is unbounded.
        ([answer("h", 10, None, "feasible"), answer("r", None, 10, "no_solution")], "AGREED", "bound by r"),
        ([answer("h", 10, None, "feasible"), answer("r", None, 11, "no_solution")], "CONTRADICTION", "r claims"),
        ([answer("r", termination="infeasible")], "AGREED", "infeasible, proven by r"),
        ([answer("r", termination="unbounded")], "INCONCLUSIVE", "no verified plan"),
        # A sampled objective contradicts no claim within its spread.
        ([answer("h", 9.9, None, "feasible", spread=0.2), answer("a", None, 10, "no_solution")], "AGREED", "bound by a"),
        ([answer("h", 9.7, None, "feasible", spread=0.2), answer("a", None, 10, "no_solution")], "CONTRADICTION", "a claims"),
    ],
)  # fmt: skip
def test_verdict_is_interval_logic(answers, outcome, words):
    verdict = judge("i", answers)
    assert verdict.outcome == outcome, verdict.evidence
    import re

    assert re.search(words, verdict.evidence), verdict.evidence
    if any(s.verification and s.verification.within_tolerance for s in answers):
        assert any(
            "within_tolerance" in note and "vertical error at B" in note for note in verdict.notes
        )


@pytest.mark.parametrize(
    ("default", "other", "words"),
    [(10.4, 10.0, ""), (10.6, 10.0, "the default backend label-setting has 10.6, 6 % worse than h"),
     (0.2, 1e-3, "worse than h"), (9.0, 10.0, "")],
)  # fmt: skip
def test_the_verdict_names_a_default_that_is_clearly_worse(default, other, words, model):
    """The plan was 32 times as long, and the verdict was INCONCLUSIVE without a word."""
    own = replace(answer("a", default, None, "feasible"), backend="label-setting")
    verdict = judge("i", [own, answer("h", other, None, "feasible")], model)
    assert verdict.outcome == "INCONCLUSIVE"
    assert ("default backend" in verdict.evidence) == bool(words)
    assert words in verdict.evidence


def test_backends_agree_and_the_table_shows_it(model):
    result = ct.compare(
        [model], ["label-setting", "two-stage", "highs", "highs:paper", "labelling"], time_limit=30
    )
    assert result.outcome == "AGREED"
    assert len(result.solutions) == 5
    text = str(result)
    for word in ("AGREED", "label-setting", "highs : paper", "4.500", "verification"):
        assert word in text, text


def test_contradiction_names_both(model):
    result = ct.compare(
        [model], ["label-setting", Fixed("liar", dual=5.0, claims="feasible")], time_limit=20
    )
    assert result.outcome == "CONTRADICTION"
    assert "liar" in result.verdicts[0].evidence
    assert "label-setting" in result.verdicts[0].evidence


def test_bad_backends_cost_their_own_rows_only(model):
    backends = [
        "label-setting", Killed("killed"), Hanging("hanging"), Raising("raising"),
        Fixed("wrong", route=(0, 2, 4)), Killed("dead", route=None), "gone",
    ]  # fmt: skip
    with pytest.raises(UnknownName):
        ct.compare([model], backends, time_limit=0.5)
    begin = time.perf_counter()
    result = ct.compare(
        [model, replace(model, name="again")], backends[:-1], time_limit=1.5, grace=1.5, workers=2
    )
    assert time.perf_counter() - begin < 60
    for verdict in result.verdicts:
        rows = {s.backend: s for s in verdict.solutions}
        assert rows["label-setting"].termination == "optimal"
        assert rows["killed"].termination == "feasible"
        assert "SIGKILL" in rows["killed"].message
        assert rows["dead"].termination == "failed"
        assert (rows["hanging"].termination, rows["hanging"].limit) == ("feasible", "time")
        assert rows["raising"].termination == "failed"
        assert rows["wrong"].termination == "rejected"
        assert verdict.outcome == "AGREED"
    assert result.verdicts[1].instance == "again"


def test_a_refusal_is_a_row(model):
    free = replace(model, revisits=True)
    result = ct.compare(free, ["label-setting", "highs"], time_limit=20)
    assert result.outcome == "AGREED"
    assert result.solutions[1].termination == "failed"
    assert "revisits" in result.solutions[1].message


def test_common_options_reach_the_backends_that_support_them(model):
    result = ct.compare(model, ["labelling", "highs"], gap=1e-4, threads=1, seed=4, time_limit=20)
    labelling, highs = result.solutions
    assert highs.options["gap"] == 1e-4
    assert highs.seed == 4
    assert highs.options["threads"] == 1
    assert labelling.termination in ("feasible", "no_solution")


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"backends": []}, InvalidData),
        ({"backend_options": {"scip": {}}}, UnknownName),
        ({"backend_options": {"highs": {"nonsense": 1}}}, UnsupportedOption),
        ({"workers": 0}, UnsupportedOption),
        ({"resume": True}, UnsupportedOption),
        ({"warm_start": [None, None]}, InvalidData),
        ({"time_limit": -1}, UnsupportedOption),
    ],
)
def test_bad_calls_raise_before_anything_runs(model, changes, error):
    with pytest.raises(error):
        ct.compare([model], **{"backends": ["highs"], **changes})


def campaign(tmp_path, model):
    models = [replace(model, name=f"m{k}", theta=0.3 + k / 1000) for k in range(3)]
    backends = [Counting(tmp_path / "runs", name=name) for name in ("one", "two")]
    return models, backends


def test_campaign_resumes_with_nothing_lost_and_nothing_twice(tmp_path, model):
    models, backends = campaign(tmp_path, model)
    record = tmp_path / "record.jsonl"
    first = ct.compare(models[:2], backends, record=record, time_limit=20)
    assert len(record.read_text().splitlines()) == 4
    with pytest.raises(InvalidData, match="exists"):
        ct.compare(models, backends, record=record, time_limit=20)
    # A power cut in the middle of a line: the half line is dropped, the rest is kept.
    whole = record.read_text()
    record.write_text(whole + '{"model": "error-corr')
    second = ct.compare(models, backends, record=record, resume=True, time_limit=20)
    lines = [json.loads(line) for line in record.read_text().splitlines()]
    assert len(lines) == 6
    assert len({line["key"] for line in lines}) == 6
    assert record.read_text().startswith(whole)
    assert len((tmp_path / "runs").read_text().splitlines()) == 6
    assert len(second.solutions) == 6
    assert [s.primal_bound for s in second.solutions][:4] == [
        s.primal_bound for s in first.solutions
    ]
    assert second.outcome == first.outcome == "AGREED"
    # Another option is another job.
    ct.compare(models[0], backends[:1], record=record, resume=True, time_limit=21)
    assert len((tmp_path / "runs").read_text().splitlines()) == 7


def test_damaged_record_is_refused_and_kept(tmp_path, model):
    record = tmp_path / "record.jsonl"
    record.write_text("no json\n")
    with pytest.raises(InvalidData, match="line 1"):
        ct.compare(model, [Fixed()], record=record, resume=True)
    assert record.read_text() == "no json\n"
    with pytest.raises(InvalidData, match="folder does not exist"):
        ct.compare(model, [Fixed()], record=tmp_path / "no" / "record.jsonl")


def test_two_campaigns_do_not_share_a_record(tmp_path, model):
    """One in this process, one in another. The lock of a dead process is not effective."""
    record = tmp_path / "record.jsonl"
    script = f"""
import os
from crosstrack.solvers.run.recording import Record
held = Record({str(record)!r}).__enter__()
print("mine", flush=True)
input()
os.kill(os.getpid(), 9)
"""
    holder = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout.readline() == "mine\n"
        with pytest.raises(InvalidData, match=r"record\.jsonl is in use by another campaign"):
            ct.compare(model, [Fixed()], record=record, resume=True)
        refused = run(
            "compare", "error-correction/example-1", "--jsonl", record, "--resume", code=2
        )
        assert "is in use" in refused.stderr
        holder.communicate("die\n", timeout=60)
    assert record.read_bytes() == b""

    def again(solution):
        with pytest.raises(InvalidData, match="in use"):
            ct.compare(model, [Fixed()], record=record, resume=True)

    ct.compare(model, [Fixed()], record=record, on_event=solutions(again))
    assert len(record.read_text().splitlines()) == 1
    assert ct.compare(model, [Fixed()], record=record, resume=True).outcome == "AGREED"


def test_a_record_is_a_regular_file(model):
    with pytest.raises(InvalidData, match="is not a regular file"):
        ct.compare(model, [Fixed()], record="/dev/null")


def test_a_full_disk_is_reported_and_keeps_earlier_lines(model, tmp_path):
    """Nothing stays of the line that did not fit."""
    record = tmp_path / "record.jsonl"
    ct.compare(model, [Fixed()], record=record)
    whole = record.read_bytes()
    most = len(whole) + 100
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        with pytest.raises(InvalidData, match=r"cannot be written: .*File too large"):
            ct.compare(model, [Fixed(), Fixed("b")], record=record, resume=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert record.read_bytes() == whole
    ct.compare(model, [Fixed(), Fixed("b")], record=record, resume=True)
    assert len(record.read_text().splitlines()) == 2


def test_an_interrupted_campaign_continues(tmp_path):
    """Ctrl-C in a script on standard input: finished rows are kept, the rest runs at the resume."""
    script = textwrap.dedent(
        f"""
        import sys, time
        from dataclasses import replace
        import crosstrack as ct
        from crosstrack.models import Route
        from crosstrack.solvers import Answer, Backend, Feature, Guarantee, Termination

        class Slow(Backend):
            accepts = ct.models.ErrorCorrectionRouting
            guarantee = Guarantee.EXACT
            features = frozenset({{Feature.INTERRUPT}})
            name = "slow"

            def run(self, problem, request):
                open({str(tmp_path / "runs")!r}, "a").write(problem.name + "\\n")
                end = time.time() + 0.25
                while time.time() < end and not request.control.stopped:
                    time.sleep(0.01)
                if request.control.stopped:
                    return Answer(Termination.NO_SOLUTION, request.control.reason)
                return Answer(Termination.OPTIMAL, point=Route((0, 1, 2, 4)))

        model = ct.load("error-correction/example-1")
        models = [replace(model, name=f"m{{k}}", theta=0.3 + k / 1000) for k in range(8)]
        print("start", flush=True)
        result = ct.compare(models, [Slow()], record={str(tmp_path / "record.jsonl")!r}, resume=True, time_limit=20)
        print(len(result.solutions), result.interrupted, result.outcome, flush=True)
        """
    )

    def run(interrupt):
        process = subprocess.Popen(
            [sys.executable, "-"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        process.stdin.write(script)
        process.stdin.close()
        assert process.stdout.readline() == "start\n", process.stderr.read()
        if interrupt:
            record = tmp_path / "record.jsonl"
            while not record.exists() or len(record.read_text().splitlines()) < 2:
                time.sleep(0.02)
            os.kill(process.pid, signal.SIGINT)
        output = process.stdout.read()
        process.wait(timeout=60)
        assert process.returncode == 0, process.stderr.read()
        process.stdout.close()
        process.stderr.close()
        return output.split()

    count, interrupted, _ = run(interrupt=True)
    assert interrupted == "True"
    done = len((tmp_path / "record.jsonl").read_text().splitlines())
    assert 1 <= done < 8
    assert int(count) >= done
    count, interrupted, outcome = run(interrupt=False)
    assert (count, interrupted, outcome) == ("8", "False", "AGREED")
    lines = (tmp_path / "record.jsonl").read_text().splitlines()
    assert len(lines) == 8
    runs = (tmp_path / "runs").read_text().split()
    finished_first = [json.loads(line)["instance"] for line in lines[:done]]
    assert all(runs.count(name) == 1 for name in finished_first)


def test_any_executor_launches_the_workers(model):
    with ThreadPoolExecutor(2) as pool:
        result = ct.compare(
            [model], ["label-setting", Fixed(), Killed(route=None)], pool=pool, time_limit=20
        )
    assert result.outcome == "AGREED"
    assert result.solutions[2].termination == "failed"


def test_dask_launches_the_workers(model):
    """Dask's worker processes are daemonic: multiprocessing could not start children there."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        result = ct.compare(
            [model], ["label-setting", "highs"], pool=client.get_executor(), time_limit=30
        )
    assert result.outcome == "AGREED"
    assert len(result.solutions) == 2


def test_a_job_that_cannot_reach_a_worker_is_a_row(model):
    class Stuck(Fixed):
        def __reduce__(self):
            raise TypeError("this one does not travel")

    class Lost(Fixed):
        def __reduce__(self):
            return (__import__, ("no_such_module_anywhere",))

    result = ct.compare(model, ["label-setting", Stuck("stuck"), Lost("lost")], time_limit=20)
    assert result.outcome == "AGREED"
    assert "does not travel" in result.solutions[1].message
    assert "no_such_module_anywhere" in result.solutions[2].message


def test_guarantees_decide_which_bounds_count(model):
    loud = Fixed("loud", dual=99.0, guarantee=Guarantee.HEURISTIC, claims="feasible")
    result = ct.compare([model], ["label-setting", loud], time_limit=20)
    assert result.outcome == "AGREED"


def test_no_worker_outlives_its_parent(tmp_path):
    script = textwrap.dedent(
        """
        import os, crosstrack as ct
        from crosstrack.solvers import Worker
        from crosstrack.solvers.contract.job import Job
        worker = Worker()
        worker.solve(Job(ct.load("error-correction/example-1"), "label-setting"))
        print(worker.pid, flush=True)
        os.kill(os.getpid(), 9)
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=120
    )
    pid = int(done.stdout)
    for _ in range(100):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            break
        # A zombie process may remain in the table without running.
        if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":
            break
        time.sleep(0.1)
    else:
        pytest.fail("the worker lives on")
