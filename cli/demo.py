"""Demonstration: solve an instance of a problem, or the user's data, with every backend."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import click

from ..errors import BackendMissing
from .options import as_json, compare_code, draw, options, picture_path

if TYPE_CHECKING:
    from ..models.model import Model
    from ..solvers.contract.events import Event

__all__ = ["demo"]

#: Default file of the picture.
_PICTURE = "crosstrack-demo.png"


@cache
def _declared_options() -> tuple[click.Option, ...]:
    """Return the options declared by the problems' demonstrations; the first of equal names counts."""
    from ..instances.demos import demos

    result: dict[str, click.Option] = {}
    for demonstration in demos().values():
        for name, option in demonstration.options.items():
            default = "" if option.default is None else f"  [default: {option.default}]"
            result.setdefault(
                name,
                click.Option(
                    [f"--{name.replace('_', '-')}", name],
                    type=option.type,
                    metavar=option.metavar,
                    help=option.help + default,
                ),
            )
    return tuple(result.values())


class _DemoCommand(click.Command):
    """Command that adds the options declared by the problems."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        problem, *rest = super().get_params(ctx)
        return [problem, *_declared_options(), *rest]


@click.command(cls=_DemoCommand, short_help="Show a problem with every backend.")
@click.argument("problem", default="error-correction")
@options(
    time_limit={"default": 60.0, "show_default": True, "help": "Seconds for each run."},
    plot=f"File of the picture.  [default: {_PICTURE}]",
)
@as_json
def demo(problem: str, time_limit: float, plot: str | None, as_json: bool, **data: Any) -> int:
    """Solve an instance of PROBLEM with every backend, print the verdict and draw the plan.

    The default PROBLEM is error-correction: a route past 327 points.
    """
    from ..instances.demos import build_demo
    from ..solvers.contract.registry import find_backend
    from ..solvers.contract.selection import fitting
    from ..solvers.report.terminal import emit, progress, say, show
    from ..solvers.run.crosscheck import Comparison, compare, rejudged

    try:
        picture = picture_path(plot or _PICTURE)
    except BackendMissing as error:
        if plot is not None:
            raise
        picture = None
        say(f"nothing is drawn: {error}")
    model: Model[Any] = build_demo(
        problem, {name: value for name, value in data.items() if value is not None}
    )
    if not as_json:
        show(f"{model.name}: {model.outline()}", f"  digest {model.digest}")
    chosen = fitting(model)
    # Native backends run first; their best plan is the warm start of the program solvers.
    native = [name for name in chosen if isinstance(model, find_backend(name, model).accepts)]
    parts: list[Comparison] = []
    with progress("solving:") as status:

        def on_event(event: Event) -> None:
            assert event.solution is not None
            status(f"{event.backend} {event.solution.termination}")

        for group in (native, [name for name in chosen if name not in native]):
            start = rejudged(model, *parts).verdicts[0].best if parts else None
            if group:
                part = compare(
                    model, group, time_limit=time_limit, warm_start=start, on_event=on_event
                )
                parts.append(part)
    result = rejudged(model, *parts)
    best = result.verdicts[0].best
    if best is not None and picture is not None:
        draw(model, best, picture)
    if as_json:
        emit(result.to_dict())
    else:
        lines = [] if best is None else [f"best plan, by {best.backend}: {best.plan}"]
        show(*result.parts(), *lines)
    return compare_code(result)
