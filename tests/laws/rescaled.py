"""Instances in other units, by the powers of length and time in every field, and ones that allow less."""

from __future__ import annotations

import random
from copy import deepcopy
from typing import Any

__all__ = ["RESCALED", "TIGHTER", "in_other_units", "tightened"]

#: By kind: fields with their powers of length and time; the key "" holds those of the objective.
#: A list gives powers entry by entry; "map.cell" is an entry of an object.
RESCALED: dict[str, dict[str, Any]] = {
    "error-correction": {
        "points": (1, 0), "delta": (-1, 0), "horizontal_rate": (-1, 0), "vertical_rate": (-1, 0), "": (1, 0),
    },
    "fleet-mission": {
        **dict.fromkeys(
            ("obstacles", "bounds", "nodes", "depot", "cell", "radius", "separation", "depot_radius"), (1, 0)
        ),
        "velocity_limit": (1, -1), "acceleration_limit": (1, -2), "": (1, 0),
    },
    "fleet-routing": {
        "points": (1, 0), "map.cell": (1, 0), "map.origin": (1, 0), "battery": (1, 0), "": (1, 0),
    },
    "grid-path": {"map.cell": (1, 0), "map.origin": (1, 0), "": (1, 0)},
    "guided-path-tour": {"coordinates": (1, 0), "": (1, 0)},
    "messenger-tour": {
        "positions": (1, 0), "velocities": (1, -1), "radius": (1, 0), "turning_radius": (1, 0),
        "speed": (1, -1), "start": [(1, 0), (1, 0), (0, 0)], "wind": (1, -1), "home_velocity": (1, -1), "no_fly": (1, 0),
        "windows": (0, 1), "": (1, 0),
    },
    "minimum-derivative": {
        "waypoints": (1, 0), "times": (0, 1), "weights": [(0, -4), (0, -2), (0, 0)], "": (2, -5),
    },
    "minimum-snap": {
        "waypoints": (1, 0), "times": (0, 1), "derivatives": "each", "corridor_lower": (1, 0),
        "corridor_upper": (1, 0), "velocity_limit": (1, -1), "acceleration_limit": (1, -2),
        "jerk_limit": (1, -3), "polytope_offsets": (1, 0), "": (2, -7),
    },
    "resource-routing": {"points": (1, 0), "lengths": (1, 0), "resources.rate": (-1, 0), "": (1, 0)},
    "satellite-slew": {
        "momentum": (0, -1), "torque_limit": (0, -2), "rate_limit": (0, -1), "gimbal_rate_limit": (0, -1),
        "rate_weight": (0, 2), "time_range": (0, 1), "": (0, 1),
    },
    "sequential-ordering": {"distances": (1, 0), "": (1, 0)},
    "time-allocation": {
        "waypoints": (1, 0), "total_time": (0, 1), "velocity_limit": (1, -1), "time_weight": "objective",
    },
}  # fmt: skip


def in_other_units(
    kind: str, whole: dict[str, Any], length: float, time: float
) -> tuple[dict[str, Any], float]:
    """Return an instance in other units, and what its objective is multiplied by."""
    powers = dict(RESCALED[kind])
    data = deepcopy(whole["data"])

    def factor(one: tuple[int, int]) -> float:
        return length ** one[0] * time ** one[1]

    if kind == "time-allocation":
        # The integral of a squared derivative, and the weight times the total time.
        powers[""] = (2, 1 - 2 * data["order"])
        powers["time_weight"] = (2, -2 * data["order"])
    for name, one in powers.items():
        if not name:
            continue
        field, _, entry = name.partition(".")
        if data.get(field) is None:
            continue
        if entry:
            for part in data[field] if isinstance(data[field], list) else [data[field]]:
                part[entry] = _times(part[entry], factor(one))
        elif one == "each":  # derivatives of order 1, 2, … stand one after the other
            data[field] = [
                [_times(row, factor((1, -k - 1))) for k, row in enumerate(node)]
                for node in data[field]
            ]
        elif isinstance(one, list):
            data[field] = [
                _times(value, factor(p)) for value, p in zip(data[field], one, strict=True)
            ]
        else:
            data[field] = _times(data[field], factor(one))
    return {**whole, "data": data}, factor(powers[""])


def _times(value: Any, by: float) -> Any:
    """Return numbers multiplied; nothing and words stay."""
    if isinstance(value, list):
        return [_times(one, by) for one in value]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * by if number else value


def tightened(kind: str, whole: dict[str, Any], draw: random.Random) -> dict[str, Any] | None:
    """Return a tighter instance, None if it cannot be tightened."""
    data = deepcopy(whole["data"])
    if kind == "grid-path":
        rows = data["map"]["blocked"]
        # Rows are listed from the top, or from the bottom where `upward`; kept are the ends.
        kept = {tuple(cell) for cell in (data["start"], *data["goals"])}
        free = [
            (i, j) for i, row in enumerate(rows) for j, one in enumerate(row)
            if one == "." and (j, i) not in kept and (i, j) not in kept
        ]  # fmt: skip
        if not free:
            return None
        i, j = draw.choice(free)
        rows[i] = rows[i][:j] + "@" + rows[i][j + 1 :]
    elif kind == "guided-path-tour":
        first, second = draw.sample(range(len(data["coordinates"])), 2)
        data["precedence"] = [*(data["precedence"] or []), [first, second]]
    elif kind == "sequential-ordering":
        first, second = draw.sample(range(len(data["distances"])), 2)
        data["precedence"] = [*(data["precedence"] or []), [first, second]]
    elif kind == "resource-routing":
        resource = draw.choice([one for one in data["resources"] if one["limits"]])
        name = draw.choice(list(resource["limits"]))
        resource["limits"][name] *= draw.uniform(0.2, 1.0)
    else:
        names = [name for name in TIGHTER[kind] if data.get(name) is not None]
        if not names:
            return None
        name = draw.choice(names)
        by = draw.uniform(0.2, 1.0)
        data[name] = _times(data[name], by)
    return {**whole, "data": data}


#: By kind fields that allow more the larger they are; () where :func:`tightened` knows more.
TIGHTER: dict[str, tuple[str, ...]] = {
    "conic-program": ("column_upper",),
    "error-correction": ("alpha1", "alpha2", "beta1", "beta2", "theta"),
    "fleet-routing": ("capacity", "battery"),
    "grid-path": (),
    "guided-path-tour": (),
    "messenger-tour": ("radius",),
    "minimum-snap": (
        *(
            "corridor_upper",
            "velocity_limit",
            "acceleration_limit",
            "jerk_limit",
            "polytope_offsets",
        ),
    ),
    "mixed-integer-program": ("column_upper", "row_upper"),
    "quadratic-program": ("column_upper",),
    "resource-routing": (),
    "sequential-ordering": (),
    "time-allocation": ("velocity_limit", "total_time"),
}
