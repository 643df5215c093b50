"""Names of the rich features of fleet routing, with which models and backends are compared."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import Any

__all__ = ["FEATURES", "TIMED", "features_of", "list_unsupported"]

#: Features that give a plan times.
TIMED = (
    "times", "speed", "service", "windows", "releases", "shifts", "max_duration", "time_cost", "makespan",
)  # fmt: skip
#: All features: fields of the model, several dimensions of its loads, and two objectives.
FEATURES = (
    "times", "speed", "service", "windows", "releases", "dimensions", "pickups", "backhauls", "pairs",
    "fixed_cost", "distance_cost", "time_cost", "shifts", "max_duration", "ends", "requires", "skills",
    "prizes", "groups", "reloads", "max_reloads", "stations", "cost", "makespan",
)  # fmt: skip


def features_of(model: Any) -> frozenset[str]:
    """Return the names of the rich features that `model` uses, members of ``FEATURES``; empty for a plain model.

    They are names of fields, ``"dimensions"`` for loads with several dimensions, and ``"cost"`` or
    ``"makespan"`` for these objectives. An empty list, and ``False`` for `backhauls`, are absent.
    """
    names = {str(model.objective)} & {"cost", "makespan"}
    for name in FEATURES:
        value = getattr(model, name, None)
        if value is not None and value is not False and len(value if value is not True else "1"):
            names.add(name)
    if any(array is not None and array.ndim == 2 for array in (model.demands, model.capacity)):
        names.add("dimensions")
    return frozenset(names)


def list_unsupported(model: Any, supported: AbstractSet[str]) -> str:
    """Return the features of `model` that are not `supported`, as text in the order of ``FEATURES``."""
    missing = features_of(model) - supported
    return ", ".join(name for name in FEATURES if name in missing)
