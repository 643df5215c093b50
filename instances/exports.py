"""Writing plans for other software, in the formats that a problem declares."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import UnknownName, UnsupportedFormulation, UnsupportedOption, suggestion
from ..models.model import Model, as_model
from ..models.problems import declared_in, problem_of, resolve

__all__ = ["ExportFormat", "choose_format", "export_formats", "export_plan"]


@dataclass(frozen=True)
class ExportFormat:
    """One format of plans that other software reads.

    Parameters
    ----------
    summary : str
        What it is, in a few words.
    suffix : str
        What a file's name must end in, such as ``".csv"``.
    write : callable
        ``(plan, path, **options)``; writes the file in one step. Where it has a parameter ``model``,
        it receives what the plan is for. What it returns may have a ``to_dict`` and a ``str``, which
        report what the format could not hold.
    """

    summary: str
    suffix: str
    write: Callable[..., Any]

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of :attr:`write`."""
        return tuple(name for name in self._parameters if name != "model")

    @property
    def _parameters(self) -> tuple[str, ...]:
        return tuple(inspect.signature(self.write).parameters)[2:]

    def written(
        self, model: Model[Any], plan: Any, path: str | os.PathLike[str], options: Mapping[str, Any]
    ) -> Any:
        """Write `plan` for `model`, and return the format's report."""
        needed = {"model": model} if "model" in self._parameters else {}
        return self.write(plan, path, **needed, **options)


def export_formats(model: Model[Any]) -> Mapping[str, ExportFormat]:
    """Return the formats that plans of `model` can be written in, the usual one first."""
    owner = problem_of(as_model(model).kind)
    return {
        key: resolve(target)
        for problem, key, target in declared_in(__package__, "EXPORTS")
        if problem == owner
    }


def choose_format(
    model: Model[Any], name: str | None, options: Mapping[str, Any]
) -> tuple[str, ExportFormat]:
    """Return the name and the format that plans of `model` are asked to be written in.

    The parameters and what raises are those of :func:`export_plan`.
    """
    formats = export_formats(model)
    if not formats:
        raise UnsupportedFormulation(f"model {model.kind!r} has no format to write plans in")
    name = next(iter(formats)) if name is None else name
    if not isinstance(name, str) or name not in formats:
        raise UnknownName(f"export format of model {model.kind!r}", name, formats)
    chosen = formats[name]
    for option in options:
        if option not in chosen.options:
            known = ", ".join(chosen.options) or "none"
            raise UnsupportedOption(
                f"export format {name!r} has no option {option!r}; "
                f"{suggestion(option, chosen.options)}its options: {known}"
            )
    return name, chosen


def export_plan(
    model: Model[Any],
    plan: Any,
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002 - the word that people type
    **options: Any,
) -> Any:
    """Write `plan` for `model` as a file that other software reads; return the format's report.

    The plan is not verified here.

    Parameters
    ----------
    model : Model
        What the plan is for.
    plan : plan, Solution or JSON data
        The plan.
    path : path-like
        The file.
    format : str, optional
        One of :func:`export_formats`; the first where none is named.
    **options
        Those of the format.

    Raises
    ------
    UnsupportedFormulation
        The problem has no format to write plans in.
    UnknownName, UnsupportedOption
        There is no such format, or the format has no such option.
    """
    _, chosen = choose_format(model, format, options)
    return chosen.written(model, model.as_plan(plan), path, options)
