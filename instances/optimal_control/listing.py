"""Catalogue entries of optimal control, declared in ``benchmarks.toml`` with their reference values."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Mapping
from functools import partial
from importlib.resources import files
from typing import Any

from ...models.optimal_control.model import OptimalControlProblem
from ..catalogue import CatalogueEntry, Provenance, Row, listed

__all__ = ["catalogue_entries"]


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the benchmark problems of optimal control."""
    content = tomllib.loads((files(__package__) / "benchmarks.toml").read_text("utf-8"))
    rows = [_row(name, data, content["texts"]) for name, data in content["benchmarks"].items()]
    return listed("optimal-control", "optimal-control", "", rows)


def _row(name: str, data: Mapping[str, Any], texts: Mapping[str, str]) -> Row:
    """Return the row of a benchmark; `texts` replace ``{words}`` in its paper, source and note."""
    source = data["source"].format_map(texts)
    published = {
        "objective": data["objective"],
        "source": source,
        "analytic": data.get("analytic", False),
    }
    notes = [data.get("note", "").format_map(texts), f"Value: {source}."]
    if "printed" in data:
        published["printed"] = data["printed"]
        notes.append(f"Printed: {data['printed']}.")
    problem = data.get("problem", name.replace("-", "_"))
    return Row(
        name,
        data["title"],
        partial(_build, problem, f"optimal-control/{name}", **data.get("options", {})),
        " ".join(filter(None, notes)),
        Provenance(data.get("provenance", "public")),
        published,
        data["paper"].format_map(texts),
    )


def _build(problem: str, name: str, **options: Any) -> OptimalControlProblem:
    """Return the built problem; the functions return builders, which accept further declarations."""
    function = getattr(importlib.import_module(__package__), problem)
    built: OptimalControlProblem = function(name, **options).build()
    return built
