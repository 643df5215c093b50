"""Diagnosis of an infeasible corridor or limits: the contradicting segments, bounds and axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...models.minimum_snap.bounds import derivative_name, derivative_unit
from ...models.minimum_snap.formulations.instants import Limits
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.trajectory import Trajectory
from ..contract import limits as contract_limits
from ..contract.backend import Control, Termination
from ..run.diagnosis import Diagnosis, Finding, filtered
from .interior_point import InteriorPoint

__all__ = ["diagnose_trajectory"]

_METHOD = "Farkas' multipliers of the interior point, then a deletion filter over its bounds"
_FIELDS = {1: "velocity_limit", 2: "acceleration_limit", 3: "jerk_limit"}


def diagnose_trajectory(model: MinimumDerivative, time_limit: float | None = 60.0) -> Diagnosis:
    """Return a minimal set of bounds that no trajectory satisfies together, one finding per bound.

    Removing any bound of the set makes the problem feasible. The time limit, s, applies to each
    problem that the filter solves.
    """
    backend = InteriorPoint()
    if backend.refuses(model):
        return filtered(model, None, None, contract_limits.Limits(time_limit=time_limit))
    ends = _ends(time_limit)
    first, segments = ends(model)
    if first is Termination.OPTIMAL:
        return Diagnosis(model.name, True, _METHOD, "a plan exists: nothing to explain")
    if first is not Termination.INFEASIBLE:
        return Diagnosis(
            model.name, None, _METHOD, f"not settled: interior-point ended with {first}"
        )
    limits = Limits.of(model)
    parts = [row for row, at in enumerate(limits.segment.tolist()) if at in segments]
    if ends(_keeping(model, limits.taken(np.array(parts))))[0] is not Termination.INFEASIBLE:
        parts = list(range(limits.segment.size))
    unsure = set()
    for part in list(parts):
        fewer = [other for other in parts if other != part]
        outcome = ends(_keeping(model, limits.taken(np.array(fewer, np.int64))))[0]
        if outcome is Termination.INFEASIBLE:
            parts = fewer
        elif outcome is not Termination.OPTIMAL:
            unsure.add(part)
    findings = tuple(_finding(model, limits, part, part in unsure) for part in parts)
    named = sorted({int(limits.segment[part]) for part in parts})
    place = ", ".join(map(str, named))
    summary = (
        f"no plan: on segment{'s' if len(named) > 1 else ''} {place} these bounds cannot hold "
        "together, and leaving out any one of them gives a plan"
    )
    return Diagnosis(model.name, False, _METHOD, summary, findings)


def _ends(
    time_limit: float | None,
) -> Callable[[MinimumDerivative], tuple[Termination, frozenset[int]]]:
    """Return a function that solves a model and returns termination and contradicting segments."""
    from .chain import chains
    from .interior_solver import Settings, solve_chain

    settings = Settings(gap=1e-6, tolerance=1e-9, between=1e-7)
    whole = Control()

    def ends(model: MinimumDerivative) -> tuple[Termination, frozenset[int]]:
        results = []
        with whole.stage(time_limit) as control:
            for chain in chains(model):
                results.append(solve_chain(chain, settings, control.flag))
                if results[-1].status == "infeasible":
                    return Termination.INFEASIBLE, frozenset(results[-1].conflict.tolist())
        if control.stopped:
            return Termination.NO_SOLUTION, frozenset()
        # Any feasible trajectory suffices.
        plan = Trajectory(model.times, np.concatenate([r.powers for r in results], axis=2))
        return (Termination.OPTIMAL if model.verify(plan).ok else Termination.FAILED), frozenset()

    return ends


def _keeping(model: MinimumDerivative, limits: Limits) -> MinimumDerivative:
    """Return `model` restricted to these bounds."""
    changed: dict[str, Any] = {}
    for number, bound in enumerate(model.bounds):
        mine = limits.bound == number
        kept = np.zeros(bound.lower.shape, bool)
        kept[limits.segment[mine], limits.axis[mine]] = True
        if bound.derivative == 0:
            changed["corridor_lower"] = np.where(kept, bound.lower, -np.inf)
            changed["corridor_upper"] = np.where(kept, bound.upper, np.inf)
        else:
            changed[_FIELDS[bound.derivative]] = np.where(kept, bound.upper, np.inf)
    spaces = model.halfspaces
    if spaces is not None:
        index = limits.axis[limits.bound == len(model.bounds)]
        changed["polytope_segments"] = spaces.segments[index]
        changed["polytope_normals"] = spaces.normals[index]
        changed["polytope_offsets"] = spaces.offsets[index]
    return replace(model, **changed)


def _finding(model: MinimumDerivative, limits: Limits, part: int, unsure: bool) -> Finding:
    segment, number, which = (int(column[part]) for column in limits[:3])
    data: dict[str, Any] = {
        "segment": segment,
        "start": float(model.times[segment]),
        "end": float(model.times[segment + 1]),
        "settled": not unsure,
    }
    where = f"segment {segment}"
    low, high = float(limits.lower[part]), float(limits.upper[part])
    if number == len(model.bounds):
        normal = limits.direction[part].tolist()
        terms = " + ".join(f"{value:.4g} x{axis}" for axis, value in enumerate(normal) if value)
        text = f"polytope on {where}: {terms} <= {high:.6g} m"
        data.update(bound="polytope", halfspace=which)
    else:
        bound = model.bounds[number]
        text = f"{bound.name} on {where}, axis {which}: {_range(bound.derivative, low, high)}"
        data.update(bound=bound.name, axis=which, lower=_finite(low), upper=_finite(high))
    text += f", from {data['start']:g} s to {data['end']:g} s"
    if unsure:
        text += ": whether it is needed is not settled"
    return Finding(text, "", where, data)


def _range(derivative: int, low: float, high: float) -> str:
    word, unit = derivative_name(derivative), derivative_unit(derivative)
    if low == -high:
        return f"|{word}| <= {high:g} {unit}"
    if not np.isfinite(low):
        return f"{word} <= {high:g} {unit}"
    if not np.isfinite(high):
        return f"{word} >= {low:g} {unit}"
    return f"{low:g} <= {word} <= {high:g} {unit}"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
