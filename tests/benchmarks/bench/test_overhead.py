"""Overhead of a campaign and of its report, and speed-up by workers and a cluster.

Ratios are taken within one run: the same jobs with each kind of execution in turn; and reading, judging and the page
relative to parsing the records as JSON.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from benchmarks.ledger import Ledger

import crosstrack as ct
from crosstrack.solvers.bench import Campaign, Set, read_records, write_page
from crosstrack.solvers.bench.page import PICTURES
from crosstrack.solvers.processes.scheduling import Task

ROUNDS = 3
RECORDS = Path(__file__).parents[3] / "docs" / "campaign" / "records.jsonl"
#: Jobs of about one second each, with two backends: a worker serves one backend.
CAMPAIGN = Campaign(
    (
        Set(
            tuple(
                f"black-box/{name}"
                for name in ("rastrigin-10", "valley-5", "ackley-5", "sphere-100")
            ),
            ("cma-es", "differential-evolution"),
            seeds=(0, 1),
            time_limit=20,
        ),
    )
)


def seconds(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def test_campaign_beside_its_jobs(benchmark: Any, ledger: Ledger, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="a cluster needs Dask")
    found: dict[str, list[float]] = {}
    spent: list[float] = []

    def once() -> None:
        turn = len(spent)
        for name, more in ways.items():
            record = tmp_path / f"{name} {turn}.jsonl"
            begin = time.perf_counter()
            ct.bench(CAMPAIGN, record=record, **more)
            found.setdefault(name, []).append(time.perf_counter() - begin)
        one = read_records(tmp_path / f"1 worker {turn}.jsonl")
        spent.append(sum(s.seconds["total"] for s in one.solutions))

    benchmark.group = "campaigns"
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, scheduler_port=0
    ) as cluster:
        ways: dict[str, dict[str, Any]] = {
            "1 worker": {}, "2 workers": {"workers": 2}, "cluster of 2": {"cluster": cluster.scheduler_address},
        }  # fmt: skip
        benchmark.pedantic(once, rounds=ROUNDS)
    jobs = len(CAMPAIGN.tasks)
    base = found["1 worker"]
    ledger.starts.append(
        (f"campaign of {jobs} jobs: seconds beside the jobs' own, a job",
         f"{median((a - b) / jobs for a, b in zip(base, spent, strict=True)):.2f}")
    )  # fmt: skip
    for name in ("2 workers", "cluster of 2"):
        ratio = median(a / b for a, b in zip(found[name], base, strict=True))
        ledger.starts.append((f"campaign, {name} beside 1 worker", f"ratio {ratio:.2f}"))


def test_resume_and_report_beside_reading(benchmark: Any, ledger: Ledger, tmp_path: Path) -> None:
    found: dict[str, list[float]] = {"json": [], "read": [], "judge": [], "page": [], "drawn": []}

    def once() -> None:
        lines = RECORDS.read_text("utf-8").splitlines()
        found["json"].append(seconds(lambda: [json.loads(line) for line in lines]))
        begin = time.perf_counter()
        records = read_records(RECORDS)
        found["read"].append(time.perf_counter() - begin)
        found["judge"].append(seconds(lambda: (records.verdicts, records.standings)))
        found["page"].append(seconds(lambda: write_page(records, tmp_path / "page.html")))
        found["drawn"].append(
            seconds(lambda: write_page(records, tmp_path / "drawn.html", load=ct.load))
        )

    benchmark.group = "campaigns"
    benchmark.pedantic(once, rounds=ROUNDS)
    size = (tmp_path / "page.html").stat().st_size / 1e6
    answers = len(read_records(RECORDS).solutions)
    for name, words in {
        "read": "records read", "judge": "judged and ranked", "page": f"page of {size:.1f} MB, no pictures",
        "drawn": f"page with {PICTURES} pictures",
    }.items():  # fmt: skip
        ratio = median(a / b for a, b in zip(found[name], found["json"], strict=True))
        ledger.starts.append(
            (f"{answers} answers, {words}, beside json.loads", f"ratio {ratio:.1f}")
        )


def test_drawing_up_a_campaign_beside_loading_its_instances(benchmark: Any, ledger: Ledger) -> None:
    names = tuple(f"error-correction/{row}" for row in (1, 2, 3, 4, 5))
    found: dict[str, list[float]] = {"load": [], "tasks": []}

    def once() -> None:
        found["load"].append(seconds(lambda: [ct.load(name) for name in names]))
        tasks: list[Task] = []
        campaign = Campaign((Set(names, ("*",), time_limit=5),))
        found["tasks"].append(seconds(lambda: tasks.extend(campaign.tasks)))
        assert len(tasks) > 4 * len(names)

    benchmark.group = "campaigns"
    benchmark.pedantic(once, rounds=ROUNDS)
    ratio = median(a / b for a, b in zip(found["tasks"], found["load"], strict=True))
    ledger.starts.append(("campaign drawn up beside its instances loaded", f"ratio {ratio:.1f}"))
