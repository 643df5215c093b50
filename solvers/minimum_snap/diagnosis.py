"""Diagnosis of an infeasible corridor or limits: the contradicting segments, bounds and axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...models.minimum_snap.bounds import Bound, derivative_name, derivative_unit
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.trajectory import Trajectory
from ..contract.backend import Control, Termination
from ..contract.limits import Limits
from ..run.diagnosis import Diagnosis, Finding, filtered
from .interior_point import InteriorPoint

__all__ = ["diagnose_trajectory"]

_METHOD = "Farkas' multipliers of the interior point, then a deletion filter over its bounds"
_FIELDS = {1: "velocity_limit", 2: "acceleration_limit", 3: "jerk_limit"}


class _Part(NamedTuple):
    """Bound on one segment: an axis of a box, or a half-space."""

    bound: int
    segment: int
    which: int


def diagnose_trajectory(model: MinimumDerivative, time_limit: float | None = 60.0) -> Diagnosis:
    """Return a minimal set of bounds that no trajectory satisfies together.

    Removing any bound of the set makes the problem feasible.

    Parameters
    ----------
    model : MinimumDerivative
        Infeasible problem.
    time_limit : float, optional
        Time limit for each problem that the filter solves, s. 60 by default.

    Returns
    -------
    Diagnosis
        Findings with one bound each.
    """
    backend = InteriorPoint()
    if backend.refuses(model):
        return filtered(model, None, None, Limits(time_limit=time_limit))
    ends = _ends(time_limit)
    first, segments = ends(model)
    if first is Termination.OPTIMAL:
        return Diagnosis(model.name, True, _METHOD, "a plan exists: nothing to explain")
    if first is not Termination.INFEASIBLE:
        return Diagnosis(
            model.name, None, _METHOD, f"not settled: interior-point ended with {first}"
        )
    parts = [part for part in _parts(model) if part.segment in segments]
    if ends(_keeping(model, parts))[0] is not Termination.INFEASIBLE:
        parts = list(_parts(model))
    unsure = set()
    for part in list(parts):
        fewer = [other for other in parts if other != part]
        outcome = ends(_keeping(model, fewer))[0]
        if outcome is Termination.INFEASIBLE:
            parts = fewer
        elif outcome is not Termination.OPTIMAL:
            unsure.add(part)
    findings = tuple(_finding(model, part, part in unsure) for part in parts)
    named = sorted({part.segment for part in parts})
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


def _parts(model: MinimumDerivative) -> tuple[_Part, ...]:
    found = []
    for number, bound in enumerate(model.bounds):
        finite = np.isfinite(bound.lower) | np.isfinite(bound.upper)
        found += [_Part(number, int(k), int(axis)) for k, axis in np.argwhere(finite)]
    if model.halfspaces is not None:
        found += [
            _Part(len(model.bounds), int(k), at)
            for at, k in enumerate(model.halfspaces.segments.tolist())
        ]
    return tuple(sorted(found, key=lambda part: part.segment))


def _keeping(model: MinimumDerivative, parts: list[_Part]) -> MinimumDerivative:
    """Return `model` restricted to these bounds."""
    changed: dict[str, Any] = {}
    for number, bound in enumerate(model.bounds):
        kept = np.zeros(bound.lower.shape, bool)
        for part in parts:
            if part.bound == number:
                kept[part.segment, part.which] = True
        if bound.derivative == 0:
            changed["corridor_lower"] = np.where(kept, bound.lower, -np.inf)
            changed["corridor_upper"] = np.where(kept, bound.upper, np.inf)
        else:
            changed[_FIELDS[bound.derivative]] = np.where(kept, bound.upper, np.inf)
    spaces = model.halfspaces
    if spaces is not None:
        index = [part.which for part in parts if part.bound == len(model.bounds)]
        changed["polytope_segments"] = spaces.segments[index]
        changed["polytope_normals"] = spaces.normals[index]
        changed["polytope_offsets"] = spaces.offsets[index]
    return replace(model, **changed)


def _finding(model: MinimumDerivative, part: _Part, unsure: bool) -> Finding:
    data: dict[str, Any] = {
        "segment": part.segment,
        "start": float(model.times[part.segment]),
        "end": float(model.times[part.segment + 1]),
        "settled": not unsure,
    }
    where = f"segment {part.segment}"
    if part.bound == len(model.bounds):
        assert model.halfspaces is not None
        normal = model.halfspaces.normals[part.which]
        terms = " + ".join(f"{value:.4g} x{axis}" for axis, value in enumerate(normal) if value)
        text = f"polytope on {where}: {terms} <= {model.halfspaces.offsets[part.which]:.6g} m"
        data.update(bound="polytope", halfspace=part.which)
    else:
        bound = model.bounds[part.bound]
        text = f"{bound.name} on {where}, axis {part.which}: {_range(bound, part)}"
        data.update(
            bound=bound.name,
            axis=part.which,
            lower=_finite(bound.lower[part.segment, part.which]),
            upper=_finite(bound.upper[part.segment, part.which]),
        )
    text += f", from {data['start']:g} s to {data['end']:g} s"
    if unsure:
        text += ": whether it is needed is not settled"
    return Finding(text, "", where, data)


def _range(bound: Bound, part: _Part) -> str:
    low, high = bound.lower[part.segment, part.which], bound.upper[part.segment, part.which]
    word, unit = derivative_name(bound.derivative), derivative_unit(bound.derivative)
    if low == -high:
        return f"|{word}| <= {high:g} {unit}"
    if not np.isfinite(low):
        return f"{word} <= {high:g} {unit}"
    if not np.isfinite(high):
        return f"{word} >= {low:g} {unit}"
    return f"{low:g} <= {word} <= {high:g} {unit}"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
