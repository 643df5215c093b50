"""Instances of error-correction routing: the paper's settings, generators, files."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .examples import example_1
    from .files import PointTable, read_csv, read_points, write_csv, write_json
    from .generator import generate, generate_with_route, random_small, uniform_slab
    from .listing import setting_model
    from .settings import SETTINGS, TABLE_2, TABLE_3, Setting, Thresholds

__all__ = [
    "SETTINGS",
    "TABLE_2",
    "TABLE_3",
    "PointTable",
    "Setting",
    "Thresholds",
    "example_1",
    "generate",
    "generate_with_route",
    "random_small",
    "read_csv",
    "read_points",
    "setting_model",
    "uniform_slab",
    "write_csv",
    "write_json",
]

_HOMES = {
    "SETTINGS": "settings",
    "TABLE_2": "settings",
    "TABLE_3": "settings",
    "PointTable": "files",
    "Setting": "settings",
    "Thresholds": "settings",
    "example_1": "examples",
    "generate": "generator",
    "generate_with_route": "generator",
    "read_csv": "files",
    "random_small": "generator",
    "read_points": "files",
    "setting_model": "listing",
    "uniform_slab": "generator",
    "write_csv": "files",
    "write_json": "files",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
