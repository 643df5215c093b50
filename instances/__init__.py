"""ON WHAT: the papers' settings with their figures, seeded generators, readers and writers."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .catalogue import CatalogueEntry, Provenance, entries, entry, load, register_entry
    from .error_correction.files import read_csv, read_points, write_csv, write_json
    from .storage import read_model, read_plan, register_references, write_model, write_text

__all__ = [
    "CatalogueEntry",
    "Provenance",
    "entries",
    "entry",
    "load",
    "read_csv",
    "read_model",
    "read_plan",
    "read_points",
    "register_entry",
    "register_references",
    "write_csv",
    "write_json",
    "write_model",
    "write_text",
]

_HOMES = {
    "CatalogueEntry": "catalogue",
    "Provenance": "catalogue",
    "entries": "catalogue",
    "entry": "catalogue",
    "load": "catalogue",
    "read_csv": "error_correction.files",
    "read_model": "storage",
    "read_plan": "storage",
    "read_points": "error_correction.files",
    "register_entry": "catalogue",
    "register_references": "storage",
    "write_csv": "error_correction.files",
    "write_json": "error_correction.files",
    "write_model": "storage",
    "write_text": "storage",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
