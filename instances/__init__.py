"""ON WHAT: the papers' settings with their figures, seeded generators, readers and writers."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .catalogue import CatalogueEntry, Provenance, entries, entry, load, register_entry
    from .error_correction.files import read_csv, read_points, write_csv, write_json
    from .minimum_snap.bezier import read_bezier, write_bezier
    from .minimum_snap.paths import times_by_distance
    from .minimum_snap.pieces import Poly7
    from .minimum_snap.poly7 import Poly7Report, read_poly7, write_poly7
    from .minimum_snap.tables import Samples, read_samples, read_waypoints, write_samples
    from .optimal_control.tables import write_control_samples
    from .storage import read_model, read_plan, register_references, write_model, write_text

__all__ = [
    "CatalogueEntry",
    "Poly7",
    "Poly7Report",
    "Provenance",
    "Samples",
    "entries",
    "entry",
    "load",
    "read_bezier",
    "read_csv",
    "read_model",
    "read_plan",
    "read_points",
    "read_poly7",
    "read_samples",
    "read_waypoints",
    "register_entry",
    "register_references",
    "times_by_distance",
    "write_bezier",
    "write_control_samples",
    "write_csv",
    "write_json",
    "write_model",
    "write_poly7",
    "write_samples",
    "write_text",
]

_HOMES = {
    "CatalogueEntry": "catalogue",
    "Poly7": "minimum_snap.pieces",
    "Poly7Report": "minimum_snap.poly7",
    "Provenance": "catalogue",
    "Samples": "minimum_snap.tables",
    "entries": "catalogue",
    "entry": "catalogue",
    "load": "catalogue",
    "read_bezier": "minimum_snap.bezier",
    "read_csv": "error_correction.files",
    "read_model": "storage",
    "read_plan": "storage",
    "read_points": "error_correction.files",
    "read_poly7": "minimum_snap.poly7",
    "read_samples": "minimum_snap.tables",
    "read_waypoints": "minimum_snap.tables",
    "register_entry": "catalogue",
    "register_references": "storage",
    "times_by_distance": "minimum_snap.paths",
    "write_bezier": "minimum_snap.bezier",
    "write_control_samples": "optimal_control.tables",
    "write_csv": "error_correction.files",
    "write_json": "error_correction.files",
    "write_model": "storage",
    "write_poly7": "minimum_snap.poly7",
    "write_samples": "minimum_snap.tables",
    "write_text": "storage",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
