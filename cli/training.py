"""Command that trains a backend."""

from __future__ import annotations

import shlex
from typing import Any

import click

from .options import INTERRUPTED, NO_ANSWER, VERIFIED, as_json, only, options

__all__ = ["train"]


@click.command(short_help="Train a backend that learns, and write its weights.")
@click.argument("name", required=False)
@click.option("--list", "listed", is_flag=True, help="List the available trainings.")
@click.option("--output", metavar="FILE", help="File of the weights, which ends in .npz.")
@click.option("--epochs", type=int, help="Number of epochs (default: that of the training).")
@options(
    seed={"default": 0, "show_default": True, "help": "Seed of the random numbers."},
    time_limit="Time limit in seconds; the best weights are kept.",
    resume="Continue from the checkpoint next to FILE.",
    backend_options="An option of the training; 'crosstrack train --list' shows them.",
)
@as_json
def train(
    name: str | None, listed: bool, output: str | None, backend_options: dict[str, Any], as_json: bool, **limits: Any
) -> int:  # fmt: skip
    """Train the backend NAME and write its weights to FILE.

    A checkpoint next to FILE is written after each epoch. Ctrl-C and the time limit keep the checkpoint
    and the best weights so far.
    """
    from ..solvers.learning.training import Epoch, find_training, train as run
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, progress, show

    if name is None or listed:
        _print_trainings(as_json)
        return VERIFIED
    training = find_training(name)
    if output is None:
        raise click.UsageError("train needs --output FILE")
    with progress(f"{name}:") as status:

        def on_progress(epoch: Epoch) -> None:
            status(f"epoch {epoch.number} of {epoch.epochs}, {_format_figures(epoch.figures)}")

        result = run(
            training, output, examples=_examples(name), on_progress=on_progress,
            options=backend_options, **only(**limits),
        )  # fmt: skip
    if as_json:
        emit(result.to_dict())
    else:
        first = result.epochs - len(result.figures) + 1
        names = tuple(dict.fromkeys(key for values in result.figures for key in values))
        rows = [
            (str(first + k), *(f"{values[key]:.4g}" if key in values else "" for key in names))
            for k, values in enumerate(result.figures)
        ]
        if rows:
            show(table(name, ("epoch", *names), rows))
        endings = {
            "finished": "finished",
            "time": "stopped at the time limit",
            "interrupted": "interrupted",
        }
        where = "no weights yet" if result.path is None else f"weights: {result.path}"
        show(
            f"{endings[result.ended]} after {result.epochs} epochs and {result.seconds:.1f} s; {where}"
        )
        if result.path is not None:
            use = training.use.format(name=name, path=shlex.quote(str(result.path)))
            show(f"crosstrack solve INSTANCE {use}")
    if result.ended == "interrupted":
        return INTERRUPTED
    return VERIFIED if result.path is not None else NO_ANSWER


def _print_trainings(as_json: bool) -> None:
    from ..solvers.learning.training import trainings
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show

    declared = list(trainings().values())
    if as_json:
        emit(
            [
                {
                    "training": training.name,
                    "summary": training.summary,
                    "epochs": training.epochs,
                    "minutes": training.minutes,
                    "extra": training.extra,
                    "options": {key: option.help for key, option in training.options.items()},
                }
                for training in declared
            ]
        )
        return
    rows = [
        (
            training.name,
            training.summary,
            str(training.epochs),
            f"{training.minutes:g}",
            ", ".join(training.options),
        )
        for training in declared
    ]
    show(table("", ("training", "summary", "epochs", "minutes", "options"), rows))


def _examples(name: str) -> Any:
    """Return the generator of training examples declared by the problem, or None."""
    from .. import instances, solvers
    from ..models.problems import declared_in, resolve

    problem = {key: owner for owner, key, _ in declared_in(solvers.__name__, "TRAININGS")}[name]
    for owner, _, target in declared_in(instances.__name__, "EXAMPLES"):
        if owner == problem:
            return resolve(target)
    return None


def _format_figures(figures: Any) -> str:
    return ", ".join(f"{key} {value:.4g}" for key, value in figures.items())
