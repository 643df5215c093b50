"""Export of plans to other software, in the formats that a problem declares."""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import UnknownName, UnsupportedFormulation, UnsupportedOption, suggestion
from ..files import write_text
from ..models.conversion import as_model
from ..models.model import Model
from ..models.problems import declared_in, problem_of, resolve

__all__ = [
    "ExportFormat",
    "choose_format",
    "closed_ring",
    "export_formats",
    "export_plan",
    "write_geojson",
]


@dataclass(frozen=True)
class ExportFormat:
    """Format of plans for other software.

    Parameters
    ----------
    summary : str
        Description in a few words.
    suffix : str
        Required suffix of the file, such as ``".csv"``.
    write : callable
        Function ``(plan, path, **options)`` that writes the file atomically. It receives the model if
        it has a parameter ``model``. Its result is a report of content that the format cannot
        represent, with ``to_dict`` and ``str``, or any other value.
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
    """Return the export formats for plans of `model`.

    Parameters
    ----------
    model : Model
        Model of the plans.

    Returns
    -------
    mapping of str to ExportFormat
        Formats by name, with the default first; empty if the problem has none.
    """
    owner = problem_of(as_model(model).kind)
    return {
        key: resolve(target)
        for problem, key, target in declared_in(__package__, "EXPORTS")
        if problem == owner
    }


def choose_format(
    model: Model[Any], name: str | None, options: Mapping[str, Any]
) -> tuple[str, ExportFormat]:
    """Return name and format for plans of `model`.

    Parameters and exceptions are those of :func:`export_plan`.
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
    format: str | None = None,  # noqa: A002 - public keyword
    **options: Any,
) -> Any:
    """Write `plan` for `model` as a file for other software, without verifying it.

    Parameters
    ----------
    model : Model
        Model of the plan.
    plan : plan, Solution or JSON data
        Plan to write.
    path : path-like
        File to write.
    format : str, optional
        Name of one of :func:`export_formats`; by default the first.
    **options
        Options of the format.

    Returns
    -------
    object
        The format's report.

    Raises
    ------
    UnsupportedFormulation
        The problem has no export formats.
    UnknownName
        The format does not exist.
    UnsupportedOption
        The format does not accept an option.
    """
    _, chosen = choose_format(model, format, options)
    return chosen.written(model, model.as_plan(plan), path, options)


def write_geojson(
    path: str | os.PathLike[str], features: Iterable[tuple[str, Any, Mapping[str, Any]]]
) -> Path:
    """Write a FeatureCollection in metres atomically with one line per feature; return the path.

    Parameters
    ----------
    path : path-like
        File to write.
    features : iterable of (str, list, mapping)
        Type and coordinates of the geometry, and the properties of each feature.
    """
    lines = ",\n".join(
        json.dumps(
            {
                "type": "Feature",
                "properties": properties,
                "geometry": {"type": kind, "coordinates": coordinates},
            },
            allow_nan=False,
            ensure_ascii=False,
        )
        for kind, coordinates, properties in features
    )
    return write_text(
        path, f'{{"type": "FeatureCollection", "units": "metres", "features": [\n{lines}\n]}}\n'
    )


def closed_ring(ring: Any) -> list[list[float]]:
    """Return the corners of a ring with the first one repeated at the end, as GeoJSON requires."""
    return [*ring.tolist(), ring[0].tolist()]
