"""Declaring an optimal control problem: symbols in, a :class:`~.control_definition.Definition` out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import show
from ..definition import Definition, Quantity, Restriction
from .phase import PhaseDraft
from .terms import (
    bounds,
    checked_size,
    column,
    compiled,
    entries,
    free_name,
    middle,
    range_of,
    related,
    restriction,
    text,
    typical,
    vector,
)

__all__ = ["Draft", "PhaseDraft"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX


@dataclass(eq=False)
class Draft:
    """A problem being declared."""

    phases: list[PhaseDraft] = field(default_factory=list)
    parameters: dict[str, tuple[Quantity, Symbol]] = field(default_factory=dict)
    boundaries: list[tuple[Restriction, Symbol]] = field(default_factory=list)
    objective: tuple[Symbol, str] | None = None

    def phase(
        self, opened: Callable[[], Any], name: str, time: Any, unit: str, equation: str
    ) -> PhaseDraft:
        """Add a phase."""
        name = name or f"phase {len(self.phases) + 1}"
        free_name("a phase", name, [one.name for one in self.phases])
        if not isinstance(time, tuple | list) or len(time) != 2:
            raise InvalidData(
                f"time of phase {name!r} must be (start, end), each a number or (lower, upper), "
                f"got {show(time)}",
                field="time",
            )
        sides = [_times(what, name, one) for what, one in zip(("start", "end"), time, strict=True)]
        (first, _), (_, last) = sides
        if not first < last:
            raise InvalidData(
                f"time of phase {name!r} must go forward, got start {first:g}, end {last:g}",
                field="time",
            )
        made = PhaseDraft(
            name, (*sides[0], *sides[1]), text("unit", unit, f"phase {name!r}"),
            text("equation", equation, f"phase {name!r}"), opened,
        )  # fmt: skip
        self.phases.append(made)
        return made

    def parameter(
        self, name: str, size: int, lower: Any, upper: Any, guess: Any, scale: Any, unit: str
    ) -> Symbol:
        """Add a parameter."""
        free_name("a parameter", name, list(self.parameters))
        size = checked_size(name, size)
        low, high = bounds(name, lower, upper, size)
        value = middle(low, high)
        if guess is not None:
            value = vector(f"guess of {name!r}", guess, size, 0.0)
            outside = np.flatnonzero(~((low <= value) & (value <= high) & np.isfinite(value)))
            if outside.size:
                k = int(outside[0])
                raise InvalidData(
                    f"guess of {name!r} must be finite and lie in [{low[k]:g}, {high[k]:g}], its "
                    f"bounds, got {value[k]:g}",
                    field="guess",
                )
        quantity = Quantity(
            name, low, high, value, value, low, high,
            typical(repr(name), scale, size, low, high, value), text("unit", unit, repr(name)),
        )  # fmt: skip
        symbol = casadi.MX.sym(name, size)
        self.parameters[name] = (quantity, symbol)
        return symbol

    def minimise(self, objective: Any, unit: str) -> None:
        """Set the objective."""
        value = column("objective", objective)
        if value.numel() != 1:
            raise InvalidData(
                f"the objective must be one number, got {value.numel()} entries", field="objective"
            )
        self.objective = (value, text("unit", unit, "the objective"))

    def subject_to(
        self,
        expression: Any,
        lower: Any,
        upper: Any,
        equals: Any,
        words: tuple[str, str, str],
        scale: Any,
    ) -> None:
        """Add a boundary constraint."""
        name = words[0] or f"boundary {len(self.boundaries) + 1}"
        lists = [self.boundaries]
        for one in self.phases:
            lists += [one.paths, one.invariants]
        taken = [made.name for listed in lists for made, _ in listed]
        free_name("a boundary constraint", name, taken)
        bounded, low, high = related(
            f"boundary constraint {name!r}", expression, lower, upper, equals
        )
        made = restriction((name, *words[1:]), bounded.numel(), low, high, scale)
        self.boundaries.append((made, bounded))

    def link(self, first: PhaseDraft, second: PhaseDraft, states: Sequence[str]) -> None:
        """Add continuity between two phases."""
        for one in (first, second):
            if not any(one is known for known in self.phases):
                what = f"phase {one.name!r}" if isinstance(one, PhaseDraft) else show(one)
                raise InvalidData(f"link: {what} is no phase of this problem", field="link")
        label = f"link of {first.name!r} and {second.name!r}"
        if first is second:
            raise InvalidData(f"{label}: a phase cannot follow itself", field="link")
        names = list(states) or [name for name in first.states if name in second.states]
        if not names:
            raise InvalidData(
                f"{label}: no state bears the same name in both; for the time alone, declare "
                "subject_to(second.start == first.end)",
                field="link",
            )
        taken = [one.name for one, _ in self.boundaries]
        made = [self._continued(label, name, first, second) for name in names]
        for known, _ in made:
            if known.name in taken:
                raise InvalidData(f"{label}: {known.name!r} is declared already", field="link")
        _meeting(label, "time", first.bounds[2:], second.bounds[:2])
        words = (f"time goes on from {first.name} to {second.name}", "", first.unit)
        # Said once, however many calls link the states; times that are fixed meet already.
        if words[0] not in taken and len({*first.bounds[2:], *second.bounds[:2]}) > 1:
            scale = max(abs(first.bounds[3]), 1.0)
            made.append((restriction(words, 1, 0.0, 0.0, scale), second.start - first.end))
        self.boundaries += made

    @staticmethod
    def _continued(
        label: str, name: Any, first: PhaseDraft, second: PhaseDraft
    ) -> tuple[Restriction, Symbol]:
        """Return what lets one state go on from phase to phase."""
        if name not in first.states or name not in second.states:
            raise InvalidData(f"{label}: state {show(name)} must be in both phases", field="link")
        before, after = first.states[name], second.states[name]
        if before.size != after.size:
            raise InvalidData(
                f"{label}: state {name!r} has {entries(before.size)} in the first and {after.size} "
                "in the second",
                field="link",
            )
        for k in range(before.size):
            _meeting(
                label,
                f"state {name!r}",
                (before.final_lower[k], before.final_upper[k]),
                (after.initial_lower[k], after.initial_upper[k]),
            )
        words = (f"{name} goes on from {first.name} to {second.name}", "", before.unit)
        scale = np.maximum(before.scale, after.scale)
        made = restriction(words, before.size, 0.0, 0.0, scale)
        return made, second.ends[name][0] - first.ends[name][1]

    def finished(self) -> Definition:
        """Return the definition, or raise for what is missing."""
        if not self.phases:
            raise InvalidData("the problem has no phase: declare one with phase(…)", field="phases")
        if self.objective is None:
            raise InvalidData(
                "the problem has no objective: declare it with minimise(…)", field="objective"
            )
        parameters = [symbol for _, symbol in self.parameters.values()]
        phases = tuple(one.finished(parameters) for one in self.phases)
        ends: list[Symbol] = []
        for one in self.phases:
            ends += [one.start, one.end]
            for side in (0, 1):
                ends += [one.ends[name][side] for name in one.states]
            ends += [symbol for symbol, _ in one.integrands]
        columns = {
            "objective": [self.objective[0]],
            "boundary": [one for _, one in self.boundaries],
        }
        self._refuse_strangers(columns, [*ends, *parameters])
        endpoint = compiled(
            "endpoint",
            {"e": casadi.vertcat(*ends), "p": casadi.vertcat(*parameters, casadi.MX(0, 1))},
            {what: casadi.vertcat(*parts, casadi.MX(0, 1)) for what, parts in columns.items()},
            [*ends, *parameters],
        )
        return Definition(
            phases=phases,
            parameters=tuple(quantity for quantity, _ in self.parameters.values()),
            boundaries=tuple(one for one, _ in self.boundaries),
            endpoint=endpoint,
            objective_unit=self.objective[1],
        )

    def _refuse_strangers(
        self, columns: Mapping[str, Sequence[Symbol]], known: Sequence[Symbol]
    ) -> None:
        marks = {one.__hash__() for one in known}
        running = {
            symbol.__hash__(): one.name
            for one in self.phases
            for symbol in (*one.symbols.values(), one.time)
        }
        for what, parts in columns.items():
            for symbol in casadi.symvar(casadi.vertcat(*parts, casadi.MX(0, 1))):
                mark = symbol.__hash__()
                if mark in marks:
                    continue
                where = running.get(mark)
                hint = (
                    f"a function of time in phase {where!r}: write phase.initial(…), "
                    "phase.final(…) or phase.integral(…)"
                    if where
                    else "declared nowhere in this problem"
                )
                raise InvalidData(f"the {what} uses {symbol.name()!r}, {hint}", field=what)


def _times(what: str, name: str, value: Any) -> tuple[float, float]:
    """Return the bounds of one of a phase's two times, which must be finite."""
    label = f"{what} of phase {name!r}"
    pair = tuple(value) if isinstance(value, list) else value
    if isinstance(pair, tuple) and len(pair) != 2:
        raise InvalidData(
            f"{label} must be a number or (lower, upper), got {show(value)}", field="time"
        )
    low, high = range_of(label, pair, 1)
    if not (np.isfinite(low) & np.isfinite(high)).all():
        raise InvalidData(
            f"{label} is free between {low[0]:g} and {high[0]:g}: a free time needs finite "
            "bounds, (lower, upper)",
            field="time",
        )
    return float(low[0]), float(high[0])


def _meeting(
    label: str, what: str, before: tuple[float, float], after: tuple[float, float]
) -> None:
    """Raise where what ends in one range cannot go on in the other."""
    if before[1] < after[0] or after[1] < before[0]:
        raise InvalidData(
            f"{label}: {what} ends in [{before[0]:g}, {before[1]:g}] and begins in "
            f"[{after[0]:g}, {after[1]:g}], which do not meet",
            field="link",
        )
