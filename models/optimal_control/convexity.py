"""Recognition of convex problems, whose local optima are all global.

A problem is convex if its times are fixed, its dynamics are affine in states, controls and free parameters,
its objective is convex, and its constraints are affine, or convex with an upper bound, or concave with a
lower bound. The answer False means that convexity was not established.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi

from ..programs.convexity import Outputs, TooLarge, Value, named, stack
from .definition import Definition, Phase

__all__ = ["is_convex"]


def _integrals(
    phase: Phase, p: Any, parameters: list[tuple[Any, Value]]
) -> list[tuple[Any, Value]] | None:
    """Return the integrals of a phase with convex constraints; None if the phase has others."""
    time = casadi.SX.sym("t")
    sign = 1 if phase.start_lower >= 0 else -1 if phase.end_upper <= 0 else 0
    x, u = named("x", len(phase.state_names)), named("u", len(phase.control_names))
    inputs = [(time, Value(time, sign=sign)), *x, *u, *parameters]
    outputs = Outputs(phase.function, [time, stack(x), stack(u), p], inputs)
    if not all(outputs.is_affine(0)) or not outputs.allow(1, phase.bounds("paths")):
        return None
    result = named("integral", phase.integrals)
    sides = zip(outputs.is_curved(2, 1), outputs.is_curved(2, -1), strict=True)
    for k, (convex, concave) in enumerate(sides):
        if not outputs.is_affine(2)[k]:
            shape = 1 if convex else -1 if concave else None
            result[k] = result[k][0], Value(casadi.SX(0), 0, shape)
    return result


@lru_cache(maxsize=64)
def is_convex(definition: Definition) -> bool:
    """Return True if the problem is proven to be convex, so that every local optimum is global.

    False if it is not convex, has a free time or integer controls, or convexity was not established.
    """
    for phase in definition.phases:
        fixed = phase.start_lower == phase.start_upper and phase.end_lower == phase.end_upper
        if not fixed or any(control.integer for control in phase.controls):
            return False
    parameters, p = list[tuple[Any, Value]](), [casadi.SX(0, 1)]
    for quantity in definition.parameters:
        entries = named(quantity.name, quantity.size)
        p.append(casadi.SX(casadi.DM(quantity.lower)) if quantity.given else stack(entries))
        parameters += [] if quantity.given else entries
    ends, e = list(parameters), [casadi.SX(0, 1)]
    try:
        for phase in definition.phases:
            integrals = _integrals(phase, casadi.vertcat(*p), parameters)
            if integrals is None:
                return False
            states = named("end", 2 * len(phase.state_names))
            inner = named("inner", len(phase.instants) * len(phase.state_names))
            ends += [*states, *integrals, *inner]
            e += [
                casadi.SX(phase.start_lower),
                casadi.SX(phase.end_lower),
                stack(states),
                stack(integrals),
                stack(inner),
            ]
        arguments = [casadi.vertcat(*e), casadi.vertcat(*p)]
        outputs = Outputs(definition.endpoint, arguments, ends)
    except (RuntimeError, TooLarge):  # CasADi cannot write the function in scalar operations
        return False
    is_minimum_global = all(outputs.is_curved(0, 1))
    return is_minimum_global and outputs.allow(1, definition.bounds("boundaries"))
