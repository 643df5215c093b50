"""The commands of campaigns: bench runs one, report shows its records."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import INTERRUPTED, NO_ANSWER, VERIFIED, VIOLATED, as_json

if TYPE_CHECKING:
    from ..models.model import Model
    from ..solvers.bench.records import Records
    from ..solvers.bench.running import Progress

__all__ = ["bench", "report"]


@click.command(short_help="Run a campaign: many instances, backends, seeds.")
@click.argument("campaign", metavar="CAMPAIGN.toml")
@click.option(
    "--record",
    required=True,
    metavar="FILE",
    help="Append every answer to FILE at once, one JSON line each.",
)
@click.option("--resume", is_flag=True, help="Go on with FILE, running only what it lacks.")
@click.option("--retry", is_flag=True, help="With --resume, run what failed again as well.")
@click.option("--workers", type=int, default=1, show_default=True, help="Jobs at the same time.")
@click.option("--cluster", metavar="ADDRESS", help="A Dask scheduler, such as tcp://host:8786.")
@click.option("--report", "page", metavar="FILE", help="Write a page about the records (html).")
@as_json
def bench(
    campaign: str, record: str, resume: bool, retry: bool, workers: int, cluster: str | None, page: str | None, as_json: bool
) -> int:  # fmt: skip
    """Run the jobs of CAMPAIGN.toml, each in a process of its own, and judge the answers."""
    from ..files import writable
    from ..solvers.bench import Campaign, running
    from ..solvers.report.terminal import progress, say

    asked = Campaign.read(campaign)
    target = None if page is None else apart(writable(page, (".html",)), record, campaign)
    with progress(f"{campaign}:") as news:

        def told(found: Progress) -> None:
            news(str(found))

        found = running.bench(
            asked,
            record=record,
            resume=resume,
            retry=retry,
            workers=workers,
            cluster=cluster,
            on_progress=told,
        )
    if target is not None and found.solutions:
        from ..solvers.bench.page import write_page

        # The campaign's own instances: what a record names opens no file.
        load = {task.job.model.name: task.job.model for task in asked.tasks}.__getitem__
        again = shlex.join(["crosstrack", "bench", campaign, "--record", "again.jsonl"])
        say(f"report: {write_page(found, target, title=found.title, command=again, load=load)}")
    return _shown(found, as_json)


@click.command(short_help="Show the records of a campaign as a page.")
@click.argument("record", metavar="RECORD.jsonl")
@click.option("--output", required=True, metavar="FILE", help="Where to write the page (html).")
@click.option("--title", default="", help="Its title (default: the record's name).")
@click.option(
    "--backends",
    metavar="NAMES",
    help="Only these, separated by commas, on the instances that all of them ran on.",
)
@as_json
def report(record: str, output: str, title: str, backends: str | None, as_json: bool) -> int:
    """Write one page that shows RECORD.jsonl, and needs nothing beside it."""
    from ..files import writable
    from ..instances.catalogue import entry
    from ..solvers.bench.page import write_page
    from ..solvers.bench.records import read_records
    from ..solvers.report.terminal import say

    target = apart(writable(output, (".html",)), record)
    found = read_records(record, title=title)
    if backends is not None:
        found = found.among(*(name.strip() for name in backends.split(",")))

    def load(name: str) -> Model[Any]:
        return entry(name).build()  # what a record names opens no file

    say(f"report: {write_page(found, target, title=found.title, load=load)}")
    return _shown(found, as_json)


def apart(page: Path, *files: str) -> Path:
    """Return the path of a page, which must not be one of the files that it is made of."""
    from ..errors import InvalidData

    for file in files:
        if page.resolve() == Path(file).resolve():
            raise InvalidData(f"the page would replace {file}: name another file", field="output")
    return page


def _shown(found: Records, as_json: bool) -> int:
    """Print what the records amount to; return the exit code."""
    from ..solvers.report.terminal import emit, show

    if as_json:
        emit(found.to_dict())
    else:
        show(*found.parts())
    if found.interrupted:
        return INTERRUPTED
    return {"AGREED": VERIFIED, "CONTRADICTION": VIOLATED}.get(str(found.outcome), NO_ANSWER)
