"""Plans from samples of another tool: arrays of times, states and controls by name."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from ...errors import InvalidData
from ..fields import Array, show
from .definition import Definition, Phase
from .piecewise import Piecewise
from .plan import ControlPlan, PhasePlan

__all__ = ["is_sampled", "plan_of_samples"]


def is_sampled(definition: Definition, data: Any) -> bool:
    """Return True if `data` contains samples rather than the JSON data of a plan."""
    if not isinstance(data, Mapping) or "phases" in data:
        return False
    names = data.keys() - {"parameters"}
    return "time" in data or bool(names and names <= {phase.name for phase in definition.phases})


def plan_of_samples(definition: Definition, data: Mapping[str, Any]) -> ControlPlan:
    """Return the plan that interpolates samples linearly.

    `data` has ``"time"``, each state and control by name, shape (samples,) or (samples, size), and optionally
    ``"parameters"`` by name; others have their guess, and data their value. A control may have one sample
    fewer: the last one is repeated. A problem with several phases takes one such mapping per phase, by name.
    Errors name the wrong entry.
    """
    parts = {name: value for name, value in data.items() if name != "parameters"}
    if "time" in parts:
        parts = {definition.phases[0].name: parts}
    _require("phases", [phase.name for phase in definition.phases], parts)
    phases = tuple(_phase(phase, parts[phase.name]) for phase in definition.phases)
    values = data.get("parameters", {})
    if not isinstance(values, Mapping):
        raise InvalidData(f"parameters must be a mapping, got {show(values)}", field="parameters")
    known = {item.name: item for item in definition.parameters}
    _require("parameters", list(known), {**known, **values})
    parameters = {
        name: item.read(values[name]) if name in values else item.initial_lower
        for name, item in known.items()
    }
    return ControlPlan(phases, parameters).attached(definition)


def _require(what: str, expected: list[str], given: Any) -> None:
    if not isinstance(given, Mapping) or set(given) != set(expected):
        names = list(given) if isinstance(given, Mapping) else given
        raise InvalidData(
            f"{what} of the samples must be {expected}, got {show(names)}", field=what.split()[0]
        )


def _phase(phase: Phase, data: Any) -> PhasePlan:
    """Return one phase of a plan from its samples."""
    quantities = [*phase.states, *phase.controls]
    _require(f"names in phase {phase.name!r}", ["time", *(item.name for item in quantities)], data)
    times = Array(("samples",)).coerce("time", data["time"], {})
    if times.size < 2 or not (np.diff(times) > 0).all():
        raise InvalidData(
            f"time must have at least 2 samples that increase, got {show(times.tolist())}",
            field="time",
        )
    nodes = (np.array([-1.0, 1.0]),) * (times.size - 1)
    functions = []
    for items in (phase.states, phase.controls):
        tables = [np.zeros((times.size, 0))]
        for item in items:
            table = Array(())._numbers(item.name, data[item.name])
            if item.size == 1 and table.ndim == 1:
                table = table[:, None]
            if items is phase.controls and len(np.atleast_1d(table)) == times.size - 1:
                table = np.concatenate([table, table[-1:]])
            sizes = {"samples": (times.size, "time"), "size": (item.size, "the declaration")}
            tables.append(Array(("samples", "size")).coerce(item.name, table, sizes))
        rows = pairwise(np.concatenate(tables, axis=1))
        functions.append(Piecewise(times, nodes, tuple(np.stack(pair) for pair in rows)))
    states, controls = functions
    return PhasePlan(phase.name, states, controls, phase.state_names, phase.control_names)
