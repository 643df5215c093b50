"""Campaign files and their running: the same records on one process, several and a cluster."""

import json
import os
import signal
import sys
import time
from collections import deque

import cloudpickle
import numpy as np
import pytest
from fakes import Fixed

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import Route
from crosstrack.solvers import Answer, Guarantee, Limit, Termination
from crosstrack.solvers.bench import Campaign, Progress, Set, read_records
from crosstrack.solvers.isolation import Worker
from crosstrack.solvers.job import Job
from crosstrack.solvers.scheduling import Task, run_by_threads

cloudpickle.register_pickle_by_value(sys.modules[__name__])

SMALL = """
title = "small"
instances = ["error-correction/example-1", "minimum-snap/square"]
backends = ["label-setting", "two-stage", "highs", "banded"]
time_limit = 60
seeds = [0, 7]
"""


def written(tmp_path, text, name="campaign.toml"):
    file = tmp_path / name
    file.write_text(text)
    return file


# -- the file ----------------------------------------------------------------------------------------


def test_a_file_makes_the_jobs_that_it_names(tmp_path):
    campaign = Campaign.read(written(tmp_path, SMALL))
    assert campaign.title == "small"
    found = [(t.job.model.name, t.job.backend.name, t.job.seed) for t in campaign.tasks]
    assert found == [
        ("error-correction/example-1", "label-setting", 0),
        ("error-correction/example-1", "two-stage", 0),
        ("error-correction/example-1", "highs", 0),
        ("error-correction/example-1", "highs", 7),
        ("minimum-snap/square", "highs", 0),
        ("minimum-snap/square", "highs", 7),
        ("minimum-snap/square", "banded", 0),
    ]
    assert all(task.job.time_limit == 60 and task.warm_up for task in campaign.tasks)


def test_sets_take_what_stands_above_them(tmp_path):
    text = """
    time_limit = 2
    repeats = 3
    seeds = [4]
    [[set]]
    instances = ["minimum-snap/square"]
    backends = ["clarabel"]
    exclude = [["*", "highs"]]
    [[set]]
    instances = ["minimum-snap/square"]
    backends = ["h*", "auto", "clarabel:hermite"]
    time_limit = 5
    repeats = 1
    backend_options.highs = {presolve = "off"}
    """
    tasks = Campaign.read(written(tmp_path, text)).tasks
    head = [(t.job.backend.name, t.job.time_limit, t.job.repeat) for t in tasks[:3]]
    assert head == [("clarabel", 2, 0), ("clarabel", 2, 1), ("clarabel", 2, 2)]
    assert len({task.job.key() for task in tasks}) == len(tasks)
    rest = [(t.job.backend.name, t.job.formulation, t.job.time_limit) for t in tasks[3:]]
    assert rest == [("highs", None, 5), ("banded", None, 5), ("clarabel", "hermite", 5)]
    assert tasks[3].job.backend_options["presolve"] == "off"


def test_formulations_run_one_after_the_other_where_programs_are_taken():
    part = Set(
        ("minimum-snap/square",), ("banded", "clarabel"), formulations=("legendre", "hermite")
    )
    tasks = Campaign((part,)).tasks
    found = [(t.job.backend.name, t.job.formulation) for t in tasks]
    assert found == [("banded", None), ("clarabel", "legendre"), ("clarabel", "hermite")]
    assert len({(t.row, t.column, t.turn) for t in tasks}) == len(tasks)  # no answer hides another


def test_files_below_the_campaign_are_instances_too(tmp_path):
    model = ct.load("error-correction/example-1")
    (tmp_path / "mine").mkdir()
    from crosstrack.instances.storage import write_model

    write_model(model.renamed("own"), tmp_path / "mine" / "own.json")
    text = 'instances = ["mine/*.json"]\nbackends = ["two-stage"]'
    (task,) = Campaign.read(written(tmp_path, text)).tasks
    assert task.job.model.name == "own"
    (tmp_path / "mine" / "other.json").symlink_to("/etc/hostname")
    with pytest.raises(InvalidData, match="leads out of"):
        assert Campaign.read(tmp_path / "campaign.toml").tasks


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("instances = [", "no TOML"),
        ("time_limit = 5", "'instances' is missing"),
        ('instances = "error-correction/7"', "instances must be a list"),
        ("instances = []", "instances must be a list of at least 1"),
        (
            'instances = ["a"]\ntime_limits = 5',
            "unknown key 'time_limits', did you mean 'time_limit'",
        ),
        ('instances = ["a"]\ntime_limit = 0', "time_limit must be > 0 s"),
        ('instances = ["a"]\nrepeats = 1.5', "repeats must be a whole number"),
        ('instances = ["a"]\nseeds = [-1]', r"seeds\[0\] must be >= 0"),
        ('instances = ["a"]\ntolerance = 2', "tolerance must be <= 1"),
        ('instances = ["a"]\nwarm_up = 1', "warm_up must be true or false"),
        ('instances = ["a"]\nbackends = ["higs"]', "did you mean 'highs'"),
        ('instances = ["a"]\nexclude = ["b"]', "pair of globs"),
        ('instances = ["a"]\nset = 3', r"tables \[\[set\]\]"),
        ('instances = ["a"]\n[backend_options.nobody]\nx = 1', "nobody"),
    ],
)
def test_a_bad_file_says_what_is_wrong(tmp_path, text, words):
    file = written(tmp_path, text)
    with pytest.raises(InvalidData, match=words) as caught:
        Campaign.read(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('instances = ["eror-correction/7"]', "matches nothing"),
        ('instances = ["../*.json"]', "below the campaign's folder"),
        ('instances = ["/etc/*.json"]', "below the campaign's folder"),
        (
            'instances = ["error-correction/7"]\nbackends = ["banded"]',
            "'banded' accepts none of the instances",
        ),
        (
            'instances = ["error-correction/7"]\nformulations = ["papers"]',
            "none of the instances has 'papers', did you mean 'paper'",
        ),
        ('instances = ["."]', "no pattern of files"),
        ('instances = ["./"]', "no pattern of files"),
        ('instances = ["./**x.json"]', "no pattern of files"),
        ('instances = ["error-correction/7"]\nrepeats = 100_000_000', "1000000 jobs at most"),
    ],
)
def test_what_a_campaign_cannot_run_is_said_before_it_starts(tmp_path, text, words):
    record = tmp_path / "r.jsonl"
    with pytest.raises(InvalidData, match=words):
        ct.bench(written(tmp_path, text), record=record)
    assert not record.exists()


# -- running -----------------------------------------------------------------------------------------


def plain(path):
    """Return the records by key, without what another run may change."""
    found = {}
    for line in path.read_text().splitlines():
        data = json.loads(line)
        for name in ("seconds", "environment"):
            assert data.pop(name)
        data["statistics"] = {k: v for k, v in data["statistics"].items() if "seconds" not in k}
        for one in data["incumbents"]:
            one.pop("seconds")
        found[data["key"]] = data
    return found


def test_one_worker_two_and_a_cluster_give_the_same_records(tmp_path):
    distributed = pytest.importorskip("distributed", reason="a cluster needs Dask")
    file = written(tmp_path, SMALL)
    heard = []
    records = ct.bench(
        file, record=tmp_path / "one.jsonl", on_progress=lambda news: heard.append(str(news))
    )
    assert records.outcome == "AGREED" and len(records.solutions) == 7
    assert heard[-1].startswith("7 of 7 done")
    where = records.solutions[0].environment
    assert where["processors"] >= 1 and where["warm"] and where["python"] and where["backend"]
    ct.bench(file, record=tmp_path / "two.jsonl", workers=2)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, scheduler_port=0
    ) as cluster:
        ct.bench(file, record=tmp_path / "dask.jsonl", cluster=cluster.scheduler_address)
    one = plain(tmp_path / "one.jsonl")
    assert len(one) == 7
    assert one == plain(tmp_path / "two.jsonl") == plain(tmp_path / "dask.jsonl")
    assert read_records(tmp_path / "two.jsonl").outcome == "AGREED"


def test_a_campaign_goes_on_where_it_was_cut_off(tmp_path):
    file, record = written(tmp_path, SMALL), tmp_path / "r.jsonl"
    ct.bench(file, record=record, workers=2)
    whole = plain(record)
    lines = record.read_bytes().splitlines(keepends=True)
    record.write_bytes(b"".join(lines[:4]) + lines[4][:50])
    assert len(read_records(record).solutions) == 4
    with pytest.raises(InvalidData, match="resume it"):
        ct.bench(file, record=record)
    heard = []
    ct.bench(
        file, record=record, resume=True, on_progress=lambda n: heard.append((n.done, n.total))
    )
    assert heard[-1] == (3, 3)
    assert plain(record) == whole


class Dying(Fixed):
    """Is killed by somebody else, as long as a file does not hold enough marks."""

    features = Fixed.features

    def __init__(self, marks, times):
        super().__init__("dying")
        self.marks, self.times = marks, times

    def run(self, problem, request):
        with self.marks.open("a") as file:
            file.write("x")
        if self.marks.stat().st_size <= self.times:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().run(problem, request)


@pytest.mark.parametrize(("times", "ends"), [(1, "optimal"), (9, "failed")])
def test_a_job_whose_process_was_killed_is_run_once_more(tmp_path, times, ends):
    marks = tmp_path / "marks"
    model = ct.load("error-correction/example-1")
    tasks, found = deque([Task(0, 0, 0, Job(model, Dying(marks, times)))]), []
    run_by_threads(tasks, 1, 10.0, lambda task, solution: found.append(solution))
    assert found[0].termination == ends
    assert marks.stat().st_size == 2
    if ends == "failed":
        assert "signal 9" in found[0].message


class Hungry(Fixed):
    """Reports a plan, and takes more and more memory."""

    def run(self, problem, request):
        request.control.incumbent(9.0, Route((0, 1, 2, 4)))
        held = []
        for _ in range(100):
            held.append(np.ones(4_000_000))
            time.sleep(0.05)
        return Answer(Termination.OPTIMAL, point=Route(self.route))


@pytest.mark.skipif(sys.platform != "linux", reason="memory is counted on Linux only")
def test_a_job_that_takes_too_much_memory_is_killed_and_keeps_its_plan():
    model = ct.load("error-correction/example-1")
    with Worker() as worker:
        found = worker.solve(Job(model, Hungry("hungry"), memory_limit=0.5, time_limit=60))
        assert found.limit is Limit.MEMORY and found.termination is Termination.FEASIBLE
        assert found.plan is not None and "GiB allowed" in found.message
        assert found.options["memory_limit"] == 0.5
        right = worker.solve(Job(model, Fixed(guarantee=Guarantee.HEURISTIC), memory_limit=8.0))
        assert right.plan is not None and right.limit is None
    with pytest.raises(UnsupportedOption, match="memory_limit"):
        Job(model, "two-stage", memory_limit=-1)


def test_the_time_left_is_a_bound_until_jobs_have_ended():
    model = ct.load("error-correction/example-1")
    tasks = {k: Task(0, 0, k, Job(model, Fixed(), time_limit=10.0)) for k in range(6)}
    news = Progress(2, total=6, waiting=tasks)
    assert news.left == (30.0, True) and "at most 30 s left" in str(news)
    news.spent["fixed", model.kind] = [1.0, 2.0, 9.0]
    assert news.left == (6.0, False) and "about 6 s left" in str(news)
    for task in tasks.values():
        task.job = Job(model, Fixed("other"))
    assert news.left == (None, True) and "left" not in str(news)


def test_bad_options_are_refused(tmp_path):
    file = written(tmp_path, SMALL)
    with pytest.raises(UnsupportedOption, match="workers"):
        ct.bench(file, record=tmp_path / "r.jsonl", workers=0)
    with pytest.raises(UnsupportedOption, match="pool beside"):
        ct.bench(file, record=tmp_path / "r.jsonl", cluster="tcp://a:1", pool=object())
    with pytest.raises(InvalidData, match="campaign"):
        ct.bench(3, record=tmp_path / "r.jsonl")


def test_a_line_that_is_no_answer_is_named(tmp_path):
    file = tmp_path / "r.jsonl"
    file.write_text('{"instance": 3}\n{}\n')
    with pytest.raises(InvalidData, match="line 1"):
        read_records(file)
