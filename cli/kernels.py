"""Command that compiles the kernels of the native algorithms into the cache."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from .options import INTERRUPTED, VERIFIED, as_json

if TYPE_CHECKING:
    from ..jit import Kernel
    from ..models.model import Model

__all__ = ["compile"]

#: Seconds per run, without compiling. A run calls its kernels early.
_SECONDS = 1.0
#: Number of catalogue entries per problem, evenly spaced: several sizes and optional fields.
_ENTRIES = 4


@click.command(short_help="Compile the loops of the algorithms for later calls.")
@click.argument("problem", nargs=-1)
@as_json
def compile(problem: tuple[str, ...], as_json: bool) -> int:  # noqa: A001 - the command's name
    """Compile the loops of the native algorithms of each PROBLEM, by default of all problems.

    Later calls load them from the cache on disk. Each algorithm solves some entries of the catalogue for
    at most a second; loops that only other data need are compiled at their first call.
    """
    from rich.console import Console
    from rich.progress import Progress

    from .. import compilation
    from ..errors import CrosstrackError, UnknownName
    from ..models.problems import PROBLEMS
    from ..solvers.contract.enums import Limit
    from ..solvers.contract.job import Job
    from ..solvers.report.terminal import emit
    from ..solvers.run.execution import execute

    names = {name.replace("_", "-"): name for name in PROBLEMS}
    chosen = dict.fromkeys(name.replace("_", "-") for name in problem or names)
    for name in chosen:
        if name not in names:
            raise UnknownName("problem", name, names)
    logging.getLogger("crosstrack").setLevel(logging.ERROR)  # the bar shows that it compiles
    compilation.compile_here()
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("", total=None)
        runs = [run for name in chosen for run in _runs(names[name])]
        progress.update(task, total=len(runs))
        for model, backend in runs:
            progress.update(task, description=f"{model.kind}: {backend}")
            job = Job(model, backend, time_limit=_SECONDS, compiled=True)
            try:
                if execute(job).limit is Limit.INTERRUPTED:
                    return INTERRUPTED
            except CrosstrackError:  # it does not accept this entry
                pass
            progress.advance(task)
    kernels = list(_kernels())
    done = sum(sum(entry.dispatcher.stats.cache_misses.values()) for entry in kernels)
    present = sum(sum(entry.dispatcher.stats.cache_hits.values()) for entry in kernels)
    if as_json:
        emit({"compiled": done, "present": present})
    else:
        click.echo(f"{done} loops compiled, {present} were in the cache")
    return VERIFIED


def _runs(problem: str) -> Iterator[tuple[Model[Any], str]]:
    """Yield models of the catalogue and names of the problem's algorithms that need no other library."""
    from ..instances.catalogue import entries, load
    from ..models.problems import problem_of
    from ..solvers.contract.registry import declarations, is_plain

    backends = [entry.load() for entry in declarations() if entry.problem == problem]
    names: dict[str, list[str]] = {}
    for entry in entries():
        if problem_of(entry.model) == problem:
            names.setdefault(entry.model, []).append(entry.name)
    for group in names.values():
        step = max(1, (len(group) - 1) // (_ENTRIES - 1))
        for name in group[::step][:_ENTRIES]:
            model = load(name)
            for backend in filter(is_plain, backends):
                if isinstance(model, backend.accepts) and not backend.refuses(model):
                    yield model, backend.name


def _kernels() -> Iterator[Kernel]:
    """Yield the kernels that this process has compiled or loaded."""
    from ..jit import Kernel

    root = __package__.partition(".")[0]
    modules = [module for name, module in sys.modules.items() if name.partition(".")[0] == root]
    values = {id(value): value for module in modules for value in vars(module).values()}
    for value in values.values():
        if isinstance(value, Kernel) and hasattr(vars(value).get("dispatcher"), "stats"):
            yield value
