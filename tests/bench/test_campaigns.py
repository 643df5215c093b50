"""Campaign files and their running: the same records on one process, several and a cluster."""

import codecs
import json
import math
import os
import signal
import sys
import time
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import cloudpickle
import numpy as np
import pytest
from fakes import Fixed
from listening import progress

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import Route
from crosstrack.solvers import Answer, Guarantee, Limit, Termination
from crosstrack.solvers.bench import Campaign, Progress, Set, read_records
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.processes.isolation import Worker
from crosstrack.solvers.processes.scheduling import Task, run_by_threads
from crosstrack.solvers.run.recording import LEFT_OUT, Record

pytestmark = pytest.mark.usefixtures("interpreted_workers")

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


def test_sets_inherit_the_keys_above_them(tmp_path):
    text = """
    time_limit = 2
    repeats = 3
    seeds = [4]
    [[set]]
    instances = ["minimum-snap/square"]
    backends = ["clarabel", "highs"]
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


def test_formulations_run_one_after_the_other_for_program_backends():
    part = Set(
        ("minimum-snap/square",), ("banded", "clarabel"), formulations=("legendre", "hermite")
    )
    tasks = Campaign((part,)).tasks
    found = [(t.job.backend.name, t.job.formulation) for t in tasks]
    assert found == [("banded", None), ("clarabel", "legendre"), ("clarabel", "hermite")]
    assert len({(t.row, t.column, t.turn) for t in tasks}) == len(tasks)  # no answer hides another


def test_a_formulation_applies_to_program_backends_only_and_runs_once():
    def found(*backends, **options):
        tasks = Campaign((Set(("error-correction/7",), backends, **options),)).tasks
        return [(t.job.backend.name, t.job.formulation) for t in tasks]

    assert found("highs", "highs:arc-flow", "two-stage") == [("highs", None), ("two-stage", None)]
    every = found("*:paper")
    assert ("highs", "paper") in every and {how for _, how in every} == {"paper"}
    both = {"formulations": ("arc-flow", "paper"), "exclude": [("*", "highs:arc-flow")]}
    assert found("highs", "two-stage", **both) == [("highs", "paper"), ("two-stage", None)]
    assert found("highs", "scipy", exclude=[("*", "highs:arc-flow")]) == [("scipy", None)]


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
def test_the_error_of_a_bad_file_names_the_fault(tmp_path, text, words):
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
        ('instances = ["."]', "not a file pattern"),
        ('instances = ["./"]', "not a file pattern"),
        ('instances = ["./**x.json"]', "not a file pattern"),
        ('instances = ["error-correction/7"]\nrepeats = 100_000_000', "at most 1000000 jobs"),
        (
            'instances = ["error-correction/7"]\nbackends = ["two-stage:nonsense"]',
            r"campaign.toml: backends: 'two-stage:nonsense' accepts none",
        ),
        (
            'instances = ["error-correction/7"]\nbackends = ["highs"]\nexclude = [["*", "highs:papers"]]',
            r"exclude: \['\*', 'highs:papers'\] excludes nothing that would run",
        ),
        (
            'instances = ["error-correction/7"]\nbackends = ["highs"]\nexclude = [["*", "h*"]]',
            "everything is excluded",
        ),
    ],
)
def test_an_invalid_campaign_raises_before_it_starts(tmp_path, text, words):
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


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """A campaign, its records by one worker, and what was heard of its progress."""
    folder, heard = tmp_path_factory.mktemp("alone"), []
    file = written(folder, SMALL)
    records = ct.bench(
        file, record=folder / "one.jsonl", on_event=progress(lambda news: heard.append(str(news)))
    )
    return file, records, plain(folder / "one.jsonl"), heard


def test_one_worker_and_two_give_the_same_records(alone, tmp_path):
    file, records, one, heard = alone
    assert records.outcome == "AGREED" and len(records.solutions) == len(one) == 7
    assert heard[-1].startswith("7 of 7 done")
    where = records.solutions[0].environment
    assert where["processors"] >= 1 and where["warm"] and where["python"] and where["backend"]
    ct.bench(file, record=tmp_path / "two.jsonl", workers=2)
    assert one == plain(tmp_path / "two.jsonl")
    assert read_records(tmp_path / "two.jsonl").outcome == "AGREED"


def test_an_interrupted_campaign_continues(alone, tmp_path):
    file, _, whole, _ = alone
    record = tmp_path / "r.jsonl"
    lines = (file.parent / "one.jsonl").read_bytes().splitlines(keepends=True)
    record.write_bytes(b"".join(lines[:4]) + lines[4][:50])
    assert len(read_records(record).solutions) == 4
    with pytest.raises(InvalidData, match="resume it"):
        ct.bench(file, record=record)
    heard = []
    ct.bench(
        file,
        record=record,
        resume=True,
        on_event=progress(lambda n: heard.append((n.done, n.total))),
    )
    assert heard[-1] == (3, 3)
    assert plain(record) == whole


class Dying(Fixed):
    """Is killed from outside while a file has fewer marks than required."""

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


def test_a_cluster_gives_the_same_records_with_a_worker_killed_and_shows_what_runs(alone, tmp_path):
    distributed = pytest.importorskip("distributed", reason="a cluster needs Dask")
    few = SMALL.replace(', "minimum-snap/square"', "").replace(', "banded"', "")
    one = {key: row for key, row in alone[2].items() if row["model"] == "error-correction"}
    killed, shown = [], []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, scheduler_port=0
    ) as cluster:

        def kill(news):
            shown.append((news.workers, len(news.running)))
            if news.running and not killed:
                killed.append(cluster.workers[0].process.pid)
                os.kill(killed[0], signal.SIGKILL)

        ct.bench(
            written(tmp_path, few),
            record=tmp_path / "dask.jsonl",
            cluster=cluster.scheduler_address,
            on_event=progress(kill),
        )
    assert killed and len(one) == 4 and one == plain(tmp_path / "dask.jsonl")
    assert shown[0] == (2, 1) and (2, 2) in shown and max(n for _, n in shown) == 2


def test_jobs_lost_by_a_broken_executor_run_in_the_next_campaign(tmp_path):
    file, record = written(tmp_path, SMALL), tmp_path / "record.jsonl"

    def kill(news):
        assert news.workers == 2 and len(news.running) <= 2
        if news.done == 2:
            for process in list(pool._processes.values()):
                process.kill()

    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        found = ct.bench(file, record=record, pool=pool, on_event=progress(kill))
    lost = [one for one in found.solutions if one.message.startswith("executor: BrokenProcess")]
    kept = plain(record)
    assert lost and len(found.solutions) == 7 and len(kept) == 7 - len(lost)
    again = ct.bench(file, record=record, resume=True)
    assert again.outcome == "AGREED" and len(plain(record)) == 7


class Hungry(Fixed):
    """Reports a plan, and takes more and more memory; a chatty one reports without a pause."""

    chatty = False

    def run(self, problem, request):
        request.control.incumbent(9.0, Route((0, 1, 2, 4)))
        held = []
        for _ in range(100):
            held.append(np.ones(4_000_000))
            until = time.monotonic() + 0.05
            while self.chatty and time.monotonic() < until:
                request.control.incumbent(9.0, Route((0, 1, 2, 4)))
                time.sleep(1e-3)
            time.sleep(max(until - time.monotonic(), 0.0))
        return Answer(Termination.OPTIMAL, point=Route(self.route))


@pytest.mark.skipif(sys.platform != "linux", reason="memory is counted on Linux only")
@pytest.mark.parametrize("chatty", [False, True])
def test_a_job_that_takes_too_much_memory_is_killed_and_keeps_its_plan(chatty):
    model = ct.load("error-correction/example-1")
    hungry = Hungry("hungry")
    hungry.chatty = chatty
    with Worker() as worker:
        found = worker.solve(Job(model, hungry, memory_limit=512, time_limit=60))
        assert found.limit is Limit.MEMORY and found.termination is Termination.FEASIBLE
        assert found.plan is not None and "memory_limit is 512 MiB" in found.message
        assert found.options["memory_limit"] == 512
        right = worker.solve(Job(model, Fixed(guarantee=Guarantee.HEURISTIC), memory_limit=8192))
        assert right.plan is not None and right.limit is None
    with pytest.raises(UnsupportedOption, match="memory_limit"):
        Job(model, "two-stage", memory_limit=-1)
    with pytest.raises(UnsupportedOption, match="in MiB and must be at least 64"):
        Job(model, "two-stage", memory_limit=4)  # GiB in earlier versions


def test_the_time_left_is_a_bound_until_jobs_have_ended():
    model = ct.load("error-correction/example-1")
    tasks = {k: Task(0, 0, k, Job(model, Fixed(), time_limit=10.0)) for k in range(6)}
    news = Progress(2, total=6, waiting=tasks)
    assert news.left == (30.0, True) and "30 s left at the limits" in str(news)
    news.spent["fixed", model.kind] = [1.0, 2.0, 9.0]
    assert news.left == (6.0, False) and "about 6 s left" in str(news)
    for task in tasks.values():
        task.job = Job(model, Fixed("other"))
    assert news.left == (None, True) and "left" not in str(news)


def test_failed_jobs_run_again_with_retry(tmp_path):
    campaign = Campaign((Set(("error-correction/example-1",), ("label-setting", "two-stage")),))
    record = tmp_path / "r.jsonl"
    ct.bench(campaign, record=record)
    rows = [json.loads(line) for line in record.read_text().splitlines()]
    out = {"termination": "failed", "plan": None, "primal_bound": None, "verification": None}
    record.write_text("".join(json.dumps(row) + "\n" for row in (rows[0], {**rows[1], **out})))
    ended = [
        str(one.termination) for one in ct.bench(campaign, record=record, resume=True).solutions
    ]
    assert ended == ["optimal", "failed"] and len(record.read_text().splitlines()) == 2
    with pytest.raises(UnsupportedOption, match="retry needs resume"):
        ct.bench(campaign, record=record, retry=True)
    again = ct.bench(campaign, record=record, resume=True, retry=True).solutions
    assert [str(one.termination) for one in again] == ["optimal", "optimal"]
    assert len(record.read_text().splitlines()) == 3  # nothing is rewritten
    assert [str(one.termination) for one in read_records(record).solutions] == [
        "optimal",
        "optimal",
    ]


def test_progress_is_reported_by_one_thread_at_a_time(tmp_path):
    inside, heard = [], []

    def told(news):
        inside.append(None)
        heard.append((len(inside), str(news)))
        time.sleep(0.02)
        inside.pop()

    campaign = Campaign(
        (Set(("error-correction/example-1",), ("label-setting", "two-stage", "pulse")),)
    )
    ct.bench(campaign, record=tmp_path / "r.jsonl", workers=3, on_event=progress(told))
    assert len(heard) == 6 and {number for number, _ in heard} == {1}


def test_bad_options_are_refused(tmp_path):
    file = written(tmp_path, SMALL)
    with pytest.raises(UnsupportedOption, match="workers"):
        ct.bench(file, record=tmp_path / "r.jsonl", workers=0)
    with pytest.raises(UnsupportedOption, match="excludes pool"):
        ct.bench(file, record=tmp_path / "r.jsonl", cluster="tcp://a:1", pool=object())
    with pytest.raises(UnsupportedOption, match="pool must be a"):
        ct.bench(file, record=tmp_path / "r.jsonl", pool=3)
    with pytest.raises(InvalidData, match="campaign"):
        ct.bench(3, record=tmp_path / "r.jsonl")


def test_a_line_that_is_no_answer_is_named(tmp_path):
    file = tmp_path / "r.jsonl"
    file.write_text('{"instance": 3}\n{}\n')
    with pytest.raises(InvalidData, match="line 1"):
        read_records(file)


# -- external records, numbers and answers ---------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    ['{"precious": 1}', "words", "3\n", '{"model": "x"}\n', "[" * 100_000 + "\n", '{"key": NaN}\n', '{"key": 3}\n'],
)  # fmt: skip
def test_a_file_that_is_not_a_record_is_refused_and_unchanged(tmp_path, content):
    record = tmp_path / "r.jsonl"
    record.write_text(content)
    with pytest.raises(InvalidData, match=r"r.jsonl, line 1: not a line of a campaign"):
        ct.bench(written(tmp_path, SMALL), record=record, resume=True)
    assert record.read_text() == content


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [
        ("seconds", {"total": "soon"}, r"seconds.total must be a number"),
        ("seconds", {"solve": [1.0]}, r"seconds.solve must be a number"),
        ("options", {"time_limit": "a while"}, r"options.time_limit must be a number"),
        ("options", {"tolerance": {}}, r"options.tolerance must be a number"),
        ("options", {"repeat": 1.5}, r"options.repeat must be a whole number"),
    ],
)
def test_an_invalid_number_is_named(alone, tmp_path, part, value, words):
    line = json.loads((alone[0].parent / "one.jsonl").read_text().splitlines()[0])
    (tmp_path / "r.jsonl").write_text(json.dumps({**line, part: {**line[part], **value}}))
    with pytest.raises(InvalidData, match=rf"r.jsonl, line 1: .*{words}"):
        read_records(tmp_path / "r.jsonl")


def test_a_record_truncated_at_any_byte_continues(alone, tmp_path):
    """A line that was cut off is dropped; a whole one that lacks its end is kept."""
    file, _, one, _ = alone
    whole = (
        (file.parent / "one.jsonl")
        .read_bytes()
        .replace(b'"message": ""', '"message": "é"'.encode())
    )
    lines = whole.splitlines(keepends=True)
    accent = len(lines[0]) - len(lines[0].split("é".encode())[1]) - 1
    record = tmp_path / "r.jsonl"
    for cut in (0, 1, 5, 12, accent, len(lines[0]) - 1, len(lines[0]), len(lines[0]) + 40):
        record.write_bytes(whole[:cut])
        kept = read_records(record).solutions
        assert len(kept) == (cut >= len(lines[0]) - 1), cut
        with Record(record, resume=True) as book:
            assert len(book._done) == len(kept)
        assert record.read_bytes() == (lines[0] if kept else b""), cut
    with Record(record, resume=True):
        pass
    record.write_bytes(codecs.BOM_UTF8 + whole)
    assert len(read_records(record).solutions) == len(one)


class Rubbish(Fixed):
    """Reports invalid numbers, and answers with content that JSON cannot represent."""

    def run(self, problem, request):
        for value in (math.nan, math.inf, -math.inf, 9.0):
            request.control.incumbent(value, Route((0, 1, 2, 4)))
        return Answer(Termination.FEASIBLE, point=Route(self.route), statistics=self.counts)


@pytest.mark.parametrize(
    ("counts", "fails"),
    [({}, False), ({"a": [math.nan]}, True), ({"a": {1, 2}}, False), ({"a": object()}, False)],
)
def test_an_answer_that_json_cannot_hold_costs_its_own_row(tmp_path, counts, fails):
    model = ct.load("error-correction/example-1")
    backend = Rubbish("rubbish", guarantee=Guarantee.HEURISTIC)
    backend.counts = counts
    record = tmp_path / "r.jsonl"
    found = ct.compare(model, [backend, "label-setting"], record=record)
    rubbish, right = found.solutions
    assert right.termination is Termination.OPTIMAL
    assert len(read_records(record).solutions) == 2
    assert (rubbish.termination is Termination.FAILED) == fails
    if fails:
        assert "cannot be written as JSON" in rubbish.message
    else:
        assert [one.objective for one in rubbish.incumbents] == [9.0]


def test_jobs_in_two_sets_run_once(tmp_path):
    text = SMALL.replace("[0, 7]", "[0, 7, 0]") + "[[set]]\n[[set]]\n"
    once, twice = (Campaign.read(written(tmp_path, one)) for one in (SMALL, text))
    assert [t.job.key() for t in once.tasks] == [t.job.key() for t in twice.tasks]


@pytest.mark.parametrize(
    "text", [f"time_limit = {'9' * 5000}", f'instances = ["./{"a" * 5000}.json"]']
)
def test_numbers_and_names_beyond_all_bounds_are_refused(tmp_path, text):
    whole = text if "instances" in text else 'instances = ["error-correction/1"]\n' + text
    with pytest.raises(InvalidData, match=r"campaign\.toml|no pattern") as caught:
        assert not Campaign.read(written(tmp_path, whole)).tasks
    assert len(str(caught.value)) < 500


def test_records_without_plans_continue(alone, tmp_path):
    file, _, one, _ = alone
    record = tmp_path / "r.jsonl"
    rows = [
        {
            **data,
            "plan": data["plan"] and LEFT_OUT,
            "seconds": {},
            "environment": {},
            "incumbents": [],
        }
        for data in one.values()
    ]
    record.write_text("".join(json.dumps(row) + "\n" for row in rows))
    before = record.read_bytes()
    found = ct.bench(file, record=record, resume=True)
    assert found.outcome == "AGREED" and len(found.solutions) == 7 and record.read_bytes() == before
    assert {s.stored_plan for s in found.solutions} == {LEFT_OUT}
