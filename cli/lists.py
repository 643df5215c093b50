"""Commands that list backends, models and instances."""

from __future__ import annotations

import re
from typing import Any

import click

from .options import VERIFIED, as_json, reading

__all__ = ["backends", "instances", "models"]


@click.command(short_help="List the backends and what they prove.")
@click.option("--probe", is_flag=True, help="Load each backend in a worker to find broken ones.")
@click.option(
    "--for",
    "instance",
    metavar="INSTANCE",
    help="Show which backends solve this instance or file, and why the others refuse it.",
)
@reading
@as_json
def backends(probe: bool, instance: str | None, reading: dict[str, Any], as_json: bool) -> int:
    """List the backends with their state, version, accepted models, guarantee and features."""
    from ..instances.catalogue import load
    from ..solvers.contract.states import backend_states
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, progress, show
    from ..solvers.run.probing import probe as probed

    states = backend_states(None if instance is None else load(instance, **reading))
    if probe:
        with progress("loading every backend"):
            states = probed(states)
    if as_json:
        emit([state.to_dict() for state in states])
        return VERIFIED
    columns = ("backend", "state", "version", "accepts", "guarantee", "features", "summary")
    groups: dict[str, list[tuple[str, ...]]] = {}
    refused = [(s.name, s.cause) for s in states if s.state == "refused"]
    for s in states:
        if s.state == "refused":
            continue
        row = (s.name, s.state, s.version or "", s.accepts, s.guarantee, ", ".join(s.features))
        owner = s.problem.replace("_", "-")
        group = f"native algorithms of {owner}" if owner else "solvers of programs"
        groups.setdefault(group, []).append((*row, s.cause or s.summary))
    drop = ("features", "version", "accepts", "state")
    show(
        *(
            table(group, columns, rows, whole=("state", "guarantee"), drop=drop)
            for group, rows in groups.items()
        ),
        *([table(f"refuse {instance}", ("backend", "reason"), refused)] if refused else []),
    )
    return VERIFIED


@click.command(short_help="List the models with their formulations.")
@as_json
def models(as_json: bool) -> int:
    """List the models with their formulations."""
    from ..models.problems import loadable_models
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show

    result: list[dict[str, Any]] = []
    for kind, cls in loadable_models():
        unit = cls.objective_unit
        result.append(
            {
                "model": kind,
                "class": f"{cls.__module__}.{cls.__qualname__}",
                "formulations": {
                    name: cls.formulation_type(name).summary for name in cls.formulations
                },
                "default_formulation": cls.default_formulation or None,
                # None if each problem of the kind has its own unit.
                "objective_unit": unit if isinstance(unit, str) else None,
                "summary": (cls.__doc__ or "").strip().partition("\n")[0],
            }
        )
    if as_json:
        emit(result)
    else:
        rows = [(f["model"], _plain(f["summary"]), ", ".join(f["formulations"])) for f in result]
        show(table("", ("model", "summary", "formulations"), rows))
    return VERIFIED


@click.command(short_help="List the instances of the catalogue.")
@as_json
def instances(as_json: bool) -> int:
    """List the catalogue with papers, published values and sources of the data."""
    from ..instances.catalogue import entries
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show

    catalogue = entries()
    if as_json:
        emit([entry.to_dict() for entry in catalogue])
    else:
        rows = [(e.name, e.model, e.provenance, e.title, e.note) for e in catalogue]
        columns = ("instance", "model", "data", "title", "note")
        show(table("", columns, rows, whole=("model", "data"), drop=("note", "model", "data")))
    return VERIFIED


def _plain(text: str) -> str:
    """Return a line of a docstring without its markup."""
    return re.sub(r":\w+:`~?([^`]*)`|``?([^`]*)``?", lambda m: m[1] or m[2], text)
