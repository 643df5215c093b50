"""Commands for campaigns: ``bench`` runs one, ``report`` shows its records."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import LIMITS, as_json, only, options, verdict_code

if TYPE_CHECKING:
    from ..models.model import Model
    from ..solvers.bench.records import Records

__all__ = ["bench", "report"]


@click.command(short_help="Run a campaign: many instances, backends, seeds.")
@click.argument("campaign", metavar="CAMPAIGN.toml")
@click.option(
    "--record",
    required=True,
    metavar="FILE",
    help="Append each answer to FILE when it arrives, one JSON line per answer.",
)
@options("resume")
@click.option("--retry", is_flag=True, help="With --resume, run failed jobs again.")
@options("workers", *(name for name in LIMITS if name != "warm_start"))
@click.option("--cluster", metavar="ADDRESS", help="A Dask scheduler, such as tcp://host:8786.")
@click.option("--report", "page", metavar="FILE", help="Write a page of the records (html).")
@as_json
def bench(
    campaign: str, record: str, resume: bool, retry: bool, workers: int, cluster: str | None, page: str | None, as_json: bool,
    **limits: Any,
) -> int:  # fmt: skip
    """Run the jobs of CAMPAIGN.toml, one worker process per job, and compare the answers."""
    from ..files import writable
    from ..solvers.bench import Campaign, running
    from ..solvers.report.terminal import progress, say

    plan = Campaign.read(campaign)
    target = None if page is None else apart(writable(page, (".html",)), record, campaign)
    with progress(f"{campaign}:") as news:
        records = running.bench(
            plan,
            record=record,
            resume=resume,
            retry=retry,
            workers=workers,
            cluster=cluster,
            on_event=lambda event: news(str(event.progress)),
            **only(**limits),
        )
    if target is not None and records.solutions:
        from ..solvers.bench.page import write_page

        # Use the campaign's own instances, so that a name in the record opens no file.
        load = {task.job.model.name: task.job.model for task in plan.tasks}.__getitem__
        again = shlex.join(["crosstrack", "bench", campaign, "--record", "again.jsonl"])
        say(f"report: {write_page(records, target, title=records.title, command=again, load=load)}")
    return _print_records(records, as_json)


@click.command(short_help="Show the records of a campaign as a page.")
@click.argument("record", metavar="RECORD.jsonl")
@click.option("--output", required=True, metavar="FILE", help="Where to write the page (html).")
@click.option("--title", default="", help="Title of the page (default: the record's name).")
@click.option(
    "--backends",
    metavar="NAMES",
    help="Restrict to these backends, separated by commas, and to the instances that all of them ran on.",
)
@click.option(
    "--pictures",
    type=click.IntRange(0),
    default=20,
    show_default=True,
    help="Largest number of pictures of plans, about 0.1 s each.",
)
@as_json
def report(
    record: str, output: str, title: str, backends: str | None, pictures: int, as_json: bool
) -> int:
    """Write a self-contained page that shows RECORD.jsonl."""
    from ..files import writable
    from ..instances.catalogue import entry
    from ..solvers.bench.page import write_page
    from ..solvers.bench.records import read_records
    from ..solvers.report.terminal import say

    target = apart(writable(output, (".html",)), record)
    records = read_records(record, title=title)
    if backends is not None:
        records = records.among(*(name.strip() for name in backends.split(",")))

    def load(name: str) -> Model[Any]:
        return entry(name).build()  # a name in the record opens no file

    page = write_page(records, target, title=records.title, load=load, pictures=pictures)
    say(f"report: {page}")
    return _print_records(records, as_json)


def apart(page: Path, *files: str) -> Path:
    """Return the path of the page, or raise if it is one of the input files."""
    from ..errors import InvalidData

    for file in files:
        if page.resolve() == Path(file).resolve():
            raise InvalidData(f"the page would replace {file}: name another file", field="output")
    return page


def _print_records(records: Records, as_json: bool) -> int:
    """Print a summary of the records and return the exit code."""
    from ..solvers.report.terminal import emit, show

    if as_json:
        emit(records.to_dict())
    else:
        show(*records.parts())
    return verdict_code(records.outcome, records.interrupted)
