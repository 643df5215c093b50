"""Instances of minimum-derivative trajectories: curves, random walks, corridors, and their files."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bezier import read_bezier, write_bezier
    from .corridors import corridor, corridor_with_way, gates, hurried
    from .paths import (
        figure_eight,
        helix,
        random_walk,
        random_waypoints,
        square,
        times_by_distance,
    )
    from .pieces import Poly7
    from .poly7 import PIECES_THAT_FIT, Poly7Report, read_poly7, write_poly7
    from .tables import Samples, read_samples, read_waypoints, sample_columns, write_samples

__all__ = [
    "PIECES_THAT_FIT",
    "Poly7",
    "Poly7Report",
    "Samples",
    "corridor",
    "corridor_with_way",
    "figure_eight",
    "gates",
    "helix",
    "hurried",
    "random_walk",
    "random_waypoints",
    "read_bezier",
    "read_poly7",
    "read_samples",
    "read_waypoints",
    "sample_columns",
    "square",
    "times_by_distance",
    "write_bezier",
    "write_poly7",
    "write_samples",
]

_HOMES = {
    "PIECES_THAT_FIT": "poly7",
    "Poly7": "pieces",
    "Poly7Report": "poly7",
    "Samples": "tables",
    "corridor": "corridors",
    "corridor_with_way": "corridors",
    "figure_eight": "paths",
    "gates": "corridors",
    "helix": "paths",
    "hurried": "corridors",
    "random_walk": "paths",
    "random_waypoints": "paths",
    "read_bezier": "bezier",
    "read_poly7": "poly7",
    "read_samples": "tables",
    "read_waypoints": "tables",
    "sample_columns": "tables",
    "square": "paths",
    "times_by_distance": "paths",
    "write_bezier": "bezier",
    "write_poly7": "poly7",
    "write_samples": "tables",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
