"""Builder that turns the declarations of an optimal control problem into its definition."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, SupportsIndex, TypeVar

import casadi
import numpy as np

from ....errors import InvalidData
from ...fields import Text, show
from ...model import Model
from ..definition import Definition, Quantity, Restriction
from .guess import define_linked
from .phase import PhaseBuilder
from .tables import domains
from .terms import (
    bounds,
    checked_size,
    column,
    compile_function,
    constraint,
    entries,
    free_name,
    middle,
    quantity,
    range_of,
    restriction,
    text,
    typical,
    vector,
)

__all__ = ["ControlProblemBuilder"]

Symbol = Any  # casadi.MX
ModelT = TypeVar("ModelT", bound=Model[Any])


class ControlProblemBuilder(Generic[ModelT]):
    """Optimal control problem under declaration, as returned by ``OptimalControlProblem(name)``.

    Declare phases, states, controls, dynamics and the objective, and pass it to
    :func:`crosstrack.solve` like any model. Expressions are CasADi's (``casadi.sin(x)``, ``x**2``).
    Attributes of the built problem (``digest``, ``verify``, ``to_json`` …) are those of the result
    of :meth:`build`. Later declarations are allowed and give another problem with another digest.

    Parameters
    ----------
    name : str
        Label of the problem.
    make : callable
        Function that creates the problem from a name and a definition.
    """

    def __init__(self, name: str, make: Callable[..., ModelT]) -> None:
        self.name = Text().coerce("name", name, {})
        self.phases: list[PhaseBuilder] = []
        self.parameters: dict[str, tuple[Quantity, Symbol]] = {}
        self.boundaries: list[tuple[Restriction, Symbol]] = []
        self.objective: tuple[Symbol, str, float] | None = None
        self._make = make
        self._built: ModelT | None = None
        self.links: list[tuple[PhaseBuilder, PhaseBuilder, list[str]]] = []

    def build(self) -> ModelT:
        """Return the problem as declared so far.

        Raises
        ------
        InvalidData
            A declaration is missing, such as the dynamics of a state or the objective.
        """
        if self._built is None:
            self._built = self._make(self.name, definition=self._define())
        return self._built

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self.build(), name)

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        # Symbols cannot leave the process, so a copy is the built problem.
        return self.build().__reduce_ex__(protocol)

    def __repr__(self) -> str:
        if self._built is None:
            return f"<{type(self).__name__} {self.name!r} {self.describe()}>"
        return repr(self._built)

    def describe(self) -> str:
        """Return the size in a few words, or ``"being declared"`` before the problem is built."""
        return "being declared" if self._built is None else str(self.build().describe())

    def _open(self) -> Self:
        """Return the builder for further declarations, and discard the built problem."""
        self._built = None
        return self

    # -- declaring -------------------------------------------------------------------------------

    def phase(
        self,
        name: str = "",
        *,
        time: tuple[Any, Any] = (0.0, 1.0),
        unit: str = "s",
        equation: str = "",
    ) -> PhaseBuilder:
        """Add a phase, and return it for the declaration of states, controls and dynamics.

        Parameters
        ----------
        name : str
            Name of the phase; by default ``"phase 1"``, ``"phase 2"`` …
        time : tuple
            Start and end time: each a number, or ``(lower, upper)`` if it is free.
        unit : str
            Unit of time.
        equation : str
            Number of the equation of motion in the paper.

        Returns
        -------
        PhaseBuilder
            The phase.
        """
        self._open()
        name = Text().coerce("name", name, {}) or f"phase {len(self.phases) + 1}"
        free_name("a phase", name, [item.name for item in self.phases])
        if not isinstance(time, tuple | list) or len(time) != 2:
            raise InvalidData(
                f"time of phase {name!r} must be (start, end), each a number or (lower, upper), "
                f"got {show(time)}",
                field="time",
            )
        sides = [
            _read_time(what, name, item) for what, item in zip(("start", "end"), time, strict=True)
        ]
        (first, _), (_, last) = sides
        if not first < last:
            raise InvalidData(
                f"time of phase {name!r} must go forward, got start {first:g}, end {last:g}",
                field="time",
            )
        phase = PhaseBuilder(
            name, (*sides[0], *sides[1]), text("unit", unit, f"phase {name!r}"),
            text("equation", equation, f"phase {name!r}"), self._open,
        )  # fmt: skip
        self.phases.append(phase)
        return phase

    def parameter(
        self,
        name: str,
        size: int = 1,
        *,
        lower: Any = None,
        upper: Any = None,
        guess: Any = None,
        scale: Any = None,
        unit: str = "",
    ) -> Symbol:
        """Declare a constant that is optimised with the motion.

        Parameters
        ----------
        name : str
            Name of the parameter.
        size : int
            Number of entries.
        lower, upper : float or array_like, optional
            Bounds; None for no bound.
        guess : float or array_like, optional
            Start of the search; by default the middle of the bounds.
        scale : float or array_like, optional
            Typical size; by default the largest of the finite bounds and the guess, or 1.
        unit : str
            Unit, for display.

        Returns
        -------
        casadi.MX
            Symbol of the parameter.
        """
        self._open()
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
        edges = (low, high, value, value, low, high)
        return self._add(quantity(name, scale, unit, edges), size)

    def _add(self, parameter: Quantity, size: int) -> Symbol:
        symbol = casadi.MX.sym(parameter.name, size)
        self.parameters[parameter.name] = (parameter, symbol)
        return symbol

    def data(
        self, name: str, size: int = 1, *, value: Any = None, scale: Any = None, unit: str = ""
    ) -> Symbol:
        """Declare data: a constant whose value is given and can change between solves.

        Data may appear wherever a parameter may. :func:`crosstrack.solve` uses `value`, or the values of
        ``ocp.given(name=…)``; :func:`crosstrack.prepare` accepts values at each call.

        Parameters
        ----------
        name : str
            Name of the data; use a Python identifier so that it can be a keyword argument.
        size : int
            Number of entries.
        value : float or array_like, optional
            Default value; 0 if omitted.
        scale : float or array_like, optional
            Typical size; by default that of `value`, or 1.
        unit : str
            Unit, for display.

        Returns
        -------
        casadi.MX
            Symbol of the data.
        """
        self._open()
        free_name("data", name, list(self.parameters))
        size = checked_size(name, size)
        blank = quantity(name, None, unit, (np.zeros(size),) * 6, given=True)
        edges = (blank.read(0.0 if value is None else value),) * 6
        return self._add(quantity(name, scale, unit, edges, given=True), size)

    def minimise(self, objective: Any, *, unit: str = "", scale: Any = None) -> None:
        """Declare the objective, which is minimised.

        Parameters
        ----------
        objective : casadi expression
            Scalar expression in integrals (``phase.integral(…)``), values at the ends
            (``phase.final(x)``), times (``phase.end``) and parameters.
        unit : str
            Unit of the objective.
        scale : float, optional
            Typical size. By default it is measured at the guess and again on every mesh. Solvers work
            on the objective divided by it, and the accepted error of the objective is relative to it.
        """
        self._open()
        value = column("objective", objective)
        if value.numel() != 1:
            raise InvalidData(
                f"the objective must be one number, got {value.numel()} entries", field="objective"
            )
        size = 0.0 if scale is None else float(typical("the objective", scale, 1)[0])
        self.objective = (value, text("unit", unit, "the objective"), size)

    def subject_to(
        self,
        expression: Any,
        *,
        lower: Any = None,
        upper: Any = None,
        equals: Any = None,
        name: str = "",
        equation: str = "",
        unit: str = "",
        scale: Any = None,
    ) -> None:
        """Declare a boundary constraint on values at the ends, integrals, times and parameters.

        Parameters
        ----------
        expression : casadi expression
            Bounded expression, or a relation such as ``phase.final(x) <= 2 * p``.
        lower, upper, equals : float or array_like, optional
            Bounds, or the required value.
        name, equation, unit : str
            Name and equation number in the paper, and unit.
        scale : float or array_like, optional
            Typical size of the expression.

        Raises
        ------
        InvalidData
            The expression has no bound, or a name is taken.
        """
        self._open()
        labels = (
            Text().coerce("name", name, {}) or f"boundary {len(self.boundaries) + 1}",
            equation,
            unit,
        )
        lists = [self.boundaries]
        for phase in self.phases:
            lists += [phase.paths, phase.invariants]
        taken = [item.name for items in lists for item, _ in items]
        sides = (lower, upper, equals)
        self.boundaries.append(constraint("boundary", labels, taken, expression, sides, scale))

    def link(self, first: PhaseBuilder, second: PhaseBuilder, *states: str) -> None:
        """Link two phases: `second` begins at the end of `first`.

        Parameters
        ----------
        first, second : PhaseBuilder
            Phases of this problem.
        *states : str
            Names of the continuous states; by default all states of equal name.

        Raises
        ------
        InvalidData
            A phase or state does not exist, or the bounds of the two ends do not meet.
        """
        self._open()
        for item in (first, second):
            if not any(item is known for known in self.phases):
                what = f"phase {item.name!r}" if isinstance(item, PhaseBuilder) else show(item)
                raise InvalidData(f"link: {what} is no phase of this problem", field="link")
        label = f"link of {first.name!r} and {second.name!r}"
        if first is second:
            raise InvalidData(f"{label}: a phase cannot follow itself", field="link")
        names = list(states) or [name for name in first.states if name in second.states]
        if not names:
            raise InvalidData(
                f"{label}: no state has the same name in both; for the time alone, declare "
                "subject_to(second.start == first.end)",
                field="link",
            )
        taken = [item.name for item, _ in self.boundaries]
        constraints = [self._continue(label, name, first, second) for name in names]
        for known, _ in constraints:
            if known.name in taken:
                raise InvalidData(f"{label}: {known.name!r} is declared already", field="link")
        _check_meeting(label, "time", first.bounds[2:], second.bounds[:2])
        labels = (f"time goes on from {first.name} to {second.name}", "", first.unit)
        # Declared once, however many calls link the states; fixed times meet already.
        if labels[0] not in taken and len({*first.bounds[2:], *second.bounds[:2]}) > 1:
            scale = max(abs(first.bounds[3]), 1.0)
            constraints.append((restriction(labels, 1, 0.0, 0.0, scale), second.start - first.end))
        self.boundaries += constraints
        self.links.append((first, second, names))

    @staticmethod
    def _continue(
        label: str, name: Any, first: PhaseBuilder, second: PhaseBuilder
    ) -> tuple[Restriction, Symbol]:
        """Return the constraint that makes one state continuous across two phases."""
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
            _check_meeting(
                label,
                f"state {name!r}",
                (before.final_lower[k], before.final_upper[k]),
                (after.initial_lower[k], after.initial_upper[k]),
            )
        labels = (f"{name} goes on from {first.name} to {second.name}", "", before.unit)
        scale = np.maximum(before.scale, after.scale)
        constraint = restriction(labels, before.size, 0.0, 0.0, scale)
        return constraint, second.ends[name][0] - first.ends[name][1]

    def end_symbols(self) -> list[Symbol]:
        """Return the symbols of the endpoint vector: times, states at ends and instants, integrals."""
        ends: list[Symbol] = []
        for item in self.phases:
            ends += [item.start, item.end]
            for side in (0, 1):
                ends += [item.ends[name][side] for name in item.states]
            ends += [symbol for symbol, _ in item.integrands]
            for place in sorted(item.instants):
                ends += [item.state_at(place, name) for name in item.states]
        return ends

    def _define(self) -> Definition:
        """Return the definition, or raise if a declaration is missing."""
        if not self.phases:
            raise InvalidData("the problem has no phase: declare one with phase(…)", field="phases")
        if self.objective is None:
            raise InvalidData(
                "the problem has no objective: declare it with minimise(…)", field="objective"
            )
        parameters = [symbol for _, symbol in self.parameters.values()]
        values = np.concatenate([*(item.initial_lower for item, _ in self.parameters.values()), []])
        phases = define_linked(
            self.phases, self.links, lambda item, *linked: item.define(parameters, values, *linked)
        )
        stated = [self.objective[0], *(item for _, item in self.boundaries)]
        taken = [item.name for part in phases for item in (*part.paths, *part.invariants)]
        boundaries = self.boundaries + domains(stated, taken)
        endpoint = compile_function(
            "endpoint",
            {"e": self.end_symbols(), "p": parameters},
            {"objective": [self.objective[0]], "boundary": [item for _, item in boundaries]},
            self.explain,
        )
        return Definition(
            phases=phases, parameters=tuple(quantity for quantity, _ in self.parameters.values()),
            boundaries=tuple(item for item, _ in boundaries), endpoint=endpoint,
            objective_unit=self.objective[1], objective_scale=self.objective[2],
        )  # fmt: skip

    def explain(self, what: str, symbol: Symbol) -> str:
        """Return the error message for a symbol that has no value at the ends."""
        mark = symbol.__hash__()
        for phase in self.phases:
            if any(mark == owned.__hash__() for owned in (*phase.symbols.values(), phase.time)):
                return (
                    f"the {what} uses {symbol.name()!r}, a function of time in phase {phase.name!r}: "
                    "write phase.initial(…), phase.final(…), phase.at(t, …) or phase.integral(…)"
                )
        return f"the {what} uses {symbol.name()!r}, declared nowhere in this problem"


def _read_time(what: str, name: str, value: Any) -> tuple[float, float]:
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


def _check_meeting(
    label: str, what: str, before: tuple[float, float], after: tuple[float, float]
) -> None:
    """Raise if the ranges of two linked ends do not overlap."""
    if before[1] < after[0] or after[1] < before[0]:
        raise InvalidData(
            f"{label}: {what} ends in [{before[0]:g}, {before[1]:g}] and begins in "
            f"[{after[0]:g}, {after[1]:g}], which do not meet",
            field="link",
        )
