"""The command that trains what learns."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Any

import click

from .options import INTERRUPTED, NO_ANSWER, VERIFIED, as_json, only, pairs

__all__ = ["train"]


@click.command(short_help="Train a backend that learns, and write its weights.")
@click.argument("name", required=False)
@click.option("--list", "listed", is_flag=True, help="List what can be trained.")
@click.option("--output", metavar="FILE", help="The file of weights, which ends in .npz.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of all that is drawn.")
@click.option("--epochs", type=int, help="Epochs to train (default: the training's own number).")
@click.option("--time-limit", type=float, help="Seconds; the best weights so far are kept.")
@click.option("--resume", is_flag=True, help="Go on from the checkpoint beside FILE.")
@click.option(
    "--option",
    "options",
    multiple=True,
    metavar="KEY=VALUE",
    help="An option of the training's own; 'crosstrack train --list' shows them.",
)
@as_json
def train(
    name: str | None, listed: bool, output: str | None, options: Sequence[str], resume: bool, as_json: bool, **asked: Any
) -> int:  # fmt: skip
    """Train the backend NAME, and write its weights to FILE.

    A checkpoint beside FILE is written after each epoch. Ctrl-C and the time limit keep it, and the best
    weights so far.
    """
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, progress, show
    from ..solvers.training import Epoch, find_training, train as run

    if name is None or listed:
        _list(as_json)
        return VERIFIED
    training = find_training(name)
    if output is None:
        raise click.UsageError("train needs --output FILE")
    with progress(f"{name}:") as news:

        def tell(epoch: Epoch) -> None:
            news(f"epoch {epoch.number} of {epoch.epochs}, {_words(epoch.figures)}")

        done = run(
            training, output, examples=_examples(name), resume=resume, on_progress=tell,
            options=pairs(options, "--option"), **only(**asked),
        )  # fmt: skip
    if as_json:
        emit(done.to_dict())
    else:
        first = done.epochs - len(done.figures) + 1
        names = tuple(dict.fromkeys(key for one in done.figures for key in one))
        rows = [
            (str(first + k), *(f"{one[key]:.4g}" if key in one else "" for key in names))
            for k, one in enumerate(done.figures)
        ]
        if rows:
            show(table(name, ("epoch", *names), rows))
        ends = {
            "finished": "finished",
            "time": "stopped at the time limit",
            "interrupted": "interrupted",
        }
        where = "no weights yet" if done.path is None else f"weights: {done.path}"
        show(f"{ends[done.ended]} after {done.epochs} epochs and {done.seconds:.1f} s; {where}")
        if done.path is not None:
            use = training.use.format(name=name, path=shlex.quote(str(done.path)))
            show(f"crosstrack solve INSTANCE {use}")
    if done.ended == "interrupted":
        return INTERRUPTED
    return VERIFIED if done.path is not None else NO_ANSWER


def _list(as_json: bool) -> None:
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show
    from ..solvers.training import trainings

    found = list(trainings().values())
    if as_json:
        emit(
            [
                {
                    "training": one.name,
                    "summary": one.summary,
                    "epochs": one.epochs,
                    "minutes": one.minutes,
                    "extra": one.extra,
                    "options": {key: option.help for key, option in one.options.items()},
                }
                for one in found
            ]
        )
        return
    rows = [
        (one.name, one.summary, str(one.epochs), f"{one.minutes:g}", ", ".join(one.options))
        for one in found
    ]
    show(table("", ("training", "summary", "epochs", "minutes", "options"), rows))


def _examples(name: str) -> Any:
    """Return what draws the examples of a training: what its problem declares, if anything."""
    from .. import instances, solvers
    from ..models.problems import declared_in, resolve

    problem = {key: owner for owner, key, _ in declared_in(solvers.__name__, "TRAININGS")}[name]
    for owner, _, target in declared_in(instances.__name__, "EXAMPLES"):
        if owner == problem:
            return resolve(target)
    return None


def _words(figures: Any) -> str:
    return ", ".join(f"{key} {value:.4g}" for key, value in figures.items())
