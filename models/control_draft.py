"""Declaring an optimal control problem: symbols in, a :class:`~.control_definition.Definition` out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData
from .control_definition import Definition, Quantity, Restriction
from .control_phase import PhaseDraft
from .control_terms import (
    between,
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
from .fields import show

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
        bounds: list[float] = []
        for what, value in zip(("start", "end"), time, strict=True):
            label = f"{what} of phase {name!r}"
            low, high = range_of(label, tuple(value) if isinstance(value, list) else value, 1)
            _between(label, low, high)
            if not (np.isfinite(low) & np.isfinite(high)).all():
                raise InvalidData(
                    f"{label} is free between {low[0]:g} and {high[0]:g}: a free time needs finite "
                    "bounds, (lower, upper)",
                    field="time",
                )
            bounds += [float(low[0]), float(high[0])]
        if not bounds[0] < bounds[3]:
            raise InvalidData(
                f"time of phase {name!r} must go forward, got start {bounds[0]:g}, end {bounds[3]:g}",
                field="time",
            )
        made = PhaseDraft(
            name, (bounds[0], bounds[1], bounds[2], bounds[3]), unit, equation, opened
        )
        self.phases.append(made)
        return made

    def parameter(
        self, name: str, size: int, lower: Any, upper: Any, guess: Any, scale: Any, unit: str
    ) -> Symbol:
        """Add a parameter."""
        free_name("a parameter", name, list(self.parameters))
        low = vector(f"lower bound of {name!r}", lower, checked_size(name, size), -np.inf)
        high = vector(f"upper bound of {name!r}", upper, size, np.inf)
        _between(f"bounds of {name!r}", low, high)
        middle = np.where(np.isfinite(low) & np.isfinite(high), 0.5 * (low + high), 0.0)
        middle = np.clip(middle, low, high)
        value = (
            middle
            if guess is None
            else np.clip(vector(f"guess of {name!r}", guess, size, 0.0), low, high)
        )
        quantity = Quantity(
            name, low, high, value, value, low, high,
            typical(repr(name), scale, size, low, high, value), unit,
        )  # fmt: skip
        symbol = casadi.MX.sym(name, size)
        self.parameters[name] = (quantity, symbol)
        return symbol

    def minimise(self, objective: Any, unit: str) -> None:
        """Set the objective."""
        column = column("objective", objective)
        if column.numel() != 1:
            raise InvalidData(
                f"the objective must be one number, got {column.numel()} entries", field="objective"
            )
        self.objective = (column, unit)

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
        free_name("a boundary constraint", name, [one.name for one, _ in self.boundaries])
        column, low, high = related(
            f"boundary constraint {name!r}", expression, lower, upper, equals
        )
        made = restriction((name, *words[1:]), column.numel(), low, high, scale)
        self.boundaries.append((made, column))

    def link(self, first: PhaseDraft, second: PhaseDraft, states: Sequence[str]) -> None:
        """Add continuity between two phases."""
        for one in (first, second):
            if not any(one is known for known in self.phases):
                raise InvalidData(f"link: {show(one)} is no phase of this problem", field="link")
        names = list(states) or [name for name in first.states if name in second.states]
        for name in names:
            if name not in first.states or name not in second.states:
                raise InvalidData(
                    f"link: state {name!r} must be in both phases, {first.name!r} and {second.name!r}",
                    field="link",
                )
            size, other = first.states[name].lower.size, second.states[name].lower.size
            if size != other:
                raise InvalidData(
                    f"link: state {name!r} has {size} entries in {first.name!r} and {other} in "
                    f"{second.name!r}",
                    field="link",
                )
            scale = np.maximum(first.states[name].scale, second.states[name].scale)
            made = restriction(
                (f"{name} goes on from {first.name} to {second.name}", "", first.states[name].unit),
                size, 0.0, 0.0, scale,
            )  # fmt: skip
            self.boundaries.append((made, second.ends[name][0] - first.ends[name][1]))
        scale_time = max(abs(first.bounds[3]), 1.0)
        made = restriction(
            (f"time goes on from {first.name} to {second.name}", "", first.unit),
            1,
            0.0,
            0.0,
            scale_time,
        )
        self.boundaries.append((made, second.start - first.end))

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
            "boundary": [column for _, column in self.boundaries],
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
