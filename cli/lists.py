"""Commands that list backends, models and instances."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from shlex import join
from typing import Any

import click

from ..errors import UnsupportedOption
from .options import VERIFIED, as_json, reading, select

__all__ = ["backends", "instances", "models"]


@click.command(short_help="List the backends and what they prove.")
@click.argument("patterns", nargs=-1, metavar="[PATTERN]...")
@click.option("--probe", is_flag=True, help="Load each backend in a worker to find broken ones.")
@click.option(
    "--for",
    "instance",
    metavar="INSTANCE",
    help="Show which backends solve this instance or file, and why the others refuse it.",
)
@reading
@as_json
def backends(
    patterns: Sequence[str],
    probe: bool,
    instance: str | None,
    reading: dict[str, Any],
    as_json: bool,
) -> int:
    """List the backends with their state, version, accepted models, guarantee and features.

    PATTERN is a name or a glob in quotation marks, such as 'ortools*'.
    """
    from ..instances.catalogue import load
    from ..solvers.contract.states import backend_states
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, progress, show
    from ..solvers.run.probing import probe as probed

    states = backend_states(None if instance is None else load(instance, **reading))
    names = select("backend", patterns, dict.fromkeys(state.name for state in states))
    states = tuple(state for state in states if state.name in names)
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


@click.command(short_help="List the models, or describe one.")
@click.argument("name", required=False)
@click.option(
    "--template",
    type=click.Choice(["json", "csv", "xlsx"]),
    help="Write a file to fill in: a small valid instance of NAME, or its table.",
)
@click.option("--output", metavar="FILE", help="File for the template (default: standard output).")
@as_json
def models(name: str | None, template: str | None, output: str | None, as_json: bool) -> int:
    """List the models with their formulations.

    With NAME, list the fields of this model with units, defaults and meaning, its formulations and the
    backends that accept it.
    """
    from ..models.problems import loadable_models, model_type
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show

    if name is None and (template or output):
        raise click.UsageError("--template and --output need the NAME of a model")
    if output and not template:
        raise click.UsageError("--output needs --template json, csv or xlsx")
    if name is not None:
        cls = model_type(name)
        if template is not None:
            _write_template(name, template, output)
        else:
            _show_model(cls, as_json)
        return VERIFIED
    result = [_summary(kind, cls) for kind, cls in loadable_models()]
    if as_json:
        emit(result)
    else:
        rows = [(f["model"], _plain(f["summary"]), ", ".join(f["formulations"])) for f in result]
        show(table("", ("model", "summary", "formulations"), rows))
    return VERIFIED


def _summary(kind: str, cls: Any) -> dict[str, Any]:
    """Return the facts about a model that the list of all models contains."""
    unit = cls.objective_unit
    return {
        "model": kind,
        "class": f"{cls.__module__}.{cls.__qualname__}",
        "formulations": {name: cls.formulation_type(name).summary for name in cls.formulations},
        "default_formulation": cls.default_formulation or None,
        # None if each problem of the kind has its own unit.
        "objective_unit": unit if isinstance(unit, str) else None,
        "summary": (cls.__doc__ or "").strip().partition("\n")[0],
    }


def _show_model(cls: Any, as_json: bool) -> None:
    """Print fields, formulations and backends of a model."""
    from ..instances.templates import example, template_formats
    from ..models.facts import field_facts
    from ..solvers.contract.states import backend_states
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show

    facts = _summary(cls.kind, cls)
    fields = [fact._asdict() for fact in field_facts(cls)]
    formats = template_formats(cls.kind)
    try:
        states = backend_states(example(cls.kind))
    except UnsupportedOption:  # without an instance, by the declared kinds alone
        states = tuple(s for s in backend_states() if cls.kind in s.accepts.split(", "))
    backends = [
        {"backend": s.name, "state": s.state, "guarantee": s.guarantee, "summary": s.summary}
        for s in states
        if s.state != "refused"
    ]
    if as_json:
        emit({**facts, "fields": fields, "backends": backends, "templates": formats})
        return
    unit = facts["objective_unit"]
    columns = ("field", "unit", "default", "meaning")
    rows = [(f["name"], f["unit"], _default(f), f["meaning"]) for f in fields]
    parts: list[Any] = [
        f"{cls.kind}: {_plain(facts['summary'])}" + (f" (objective in {unit})" if unit else ""),
        table("fields", columns, rows, whole=("unit",)),
    ]
    if facts["formulations"]:
        forms = facts["formulations"].items()
        parts.append(table("formulations", ("formulation", "summary"), forms))
    columns = ("backend", "state", "guarantee", "summary")
    listed = [tuple(backend.values()) for backend in backends]
    parts.append(table("backends", columns, listed, whole=columns[1:3]))
    show(
        *parts,
        f"crosstrack models {cls.kind} --template {'|'.join(formats)} writes a file to fill in",
    )


def _default(fact: Mapping[str, Any]) -> str:
    """Return the default of a field as text."""
    if fact["required"]:
        parent = fact["name"].rpartition(".")[0]
        return f"required in {parent}" if parent else "required"
    value = fact["default"]
    return "none" if value in (None, "") else json.dumps(value, ensure_ascii=False)


def _write_template(kind: str, form: str, output: str | None) -> None:
    """Write a template to a file or to standard output, and name the command that reads it."""
    from ..files import writable, write_bytes
    from ..instances.templates import template
    from ..solvers.report.terminal import say, write

    if form == "xlsx" and output is None:
        raise click.UsageError("an Excel file is binary: name it with --output FILE.xlsx")
    file = None if output is None else writable(output, [f".{form}"])
    content, data = template(kind, form)
    if file is None:
        write(content.decode())
    else:
        write_bytes(file, content)
    more = [
        word for key, value in data.items() for word in ("--data", f"{key}={json.dumps(value)}")
    ]
    if form != "json":
        more += ["--model", kind]
    elif kind in ("nonlinear-program", "optimal-control"):
        more.append("--trusted")  # functions in CasADi's text format
    say(f"solve it: crosstrack solve {join([str(file or f'FILE.{form}'), *more])}")


@click.command(short_help="List the instances of the catalogue.")
@click.argument("patterns", nargs=-1, metavar="[PATTERN]...")
@as_json
def instances(patterns: Sequence[str], as_json: bool) -> int:
    """List the catalogue with papers, published values and sources of the data.

    PATTERN is a name or a glob in quotation marks, such as 'fleet/*'.
    """
    from ..instances.catalogue import entries
    from ..solvers.report.tables import table
    from ..solvers.report.terminal import emit, show

    catalogue = entries()
    names = select("instance", patterns, [entry.name for entry in catalogue])
    catalogue = tuple(entry for entry in catalogue if entry.name in names)
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
