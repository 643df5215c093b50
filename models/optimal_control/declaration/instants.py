"""Values of expressions at the ends of a phase and at instants between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi

from ....errors import InvalidData
from ...fields import show
from ..definition import Quantity
from .terms import read_expression

__all__ = ["Instants"]

Symbol = Any  # casadi.MX

#: Distance from an end at which an instant is that end, and error of a fraction, relative to the phase.
EDGE = 1e-12
#: Times of both ends for which an expression must give the same fraction of the phase.
SPANS = ((0.0, 1.0), (2.0, 5.0), (-3.0, 4.0))


class Instants:
    """Part of a phase under declaration that evaluates expressions at single instants."""

    name: str
    bounds: tuple[float, float, float, float]
    opened: Callable[[], Any]
    time: Symbol
    start: Symbol
    end: Symbol
    states: dict[str, Quantity]
    controls: dict[str, Quantity]
    symbols: dict[str, Symbol]
    ends: dict[str, tuple[Symbol, Symbol]]
    #: Symbols of the states at interior instants, by fraction of the phase and name.
    instants: dict[float, dict[str, Symbol]]

    def initial(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the start of the phase."""
        return self._at(expression, 0.0)

    def final(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the end of the phase."""
        return self._at(expression, 1.0)

    def at(self, time: Any, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at an instant of the phase.

        The result is a symbol for costs and boundary constraints, such as the sum of squares of a
        measurement, ``sum((phase.at(t, x) - y) ** 2 for t, y in data)``.

        Parameters
        ----------
        time : float or casadi expression
            Instant: a number if both times of the phase are fixed. In any phase, an expression of its
            times with a constant fraction, such as ``phase.start + 0.3 * phase.duration``.
        expression : casadi expression
            Expression in states, time and parameters.

        Returns
        -------
        casadi.MX
            Value of the expression.

        Raises
        ------
        InvalidData
            The instant is outside of the phase or not at a constant fraction of it, or the
            expression contains a control or an algebraic variable.
        """
        self.opened()
        return self._at(expression, self._fraction(time))

    def state_at(self, place: float, name: str) -> Symbol:
        """Return the symbol of a state at a fraction of the phase."""
        if place in (0.0, 1.0):
            return self.ends[name][int(place)]
        known = self.instants.setdefault(place, {})
        if name not in known:
            known[name] = casadi.MX.sym(f"{name}(fraction {place:g})", self.states[name].size)
        return known[name]

    def _fraction(self, time: Any) -> float:
        """Return the fraction of the phase at `time`, from 0 to 1."""
        label = f"instant of phase {self.name!r}"
        instant = read_expression(label, time)
        for symbol in casadi.symvar(instant):
            if symbol.__hash__() not in (self.start.__hash__(), self.end.__hash__()):
                raise InvalidData(
                    f"{label} must be a number, or an expression of the phase's start and end, got "
                    f"{show(instant)}, which uses {symbol.name()!r}: for an instant that varies, divide "
                    "the phase there into two phases and link them",
                    field="time",
                )
        if instant.shape != (1, 1):
            raise InvalidData(f"{label} must be one number, got {show(time)}", field="time")
        function = casadi.Function("instant", [self.start, self.end], [instant])
        fractions = [(float(function(a, b)) - a) / (b - a) for a, b in SPANS]
        place, (start, other, end, last) = fractions[0], self.bounds
        if max(fractions) - min(fractions) > EDGE * (1.0 + abs(place)):
            if start < other or end < last:
                raise InvalidData(
                    f"{label} must be at a constant fraction because the phase has a free time, such as "
                    f"phase.start + 0.3 * phase.duration, got {show(time)}: for another instant, divide "
                    "the phase there into two phases and link them",
                    field="time",
                )
            place = (float(function(start, end)) - start) / (end - start)
        if not -EDGE <= place <= 1.0 + EDGE:
            raise InvalidData(
                f"{label} must be between its start and its end, {start:g} and {last:g}, got "
                f"{show(time)}",
                field="time",
            )
        near = [edge for edge in (0.0, 1.0, *self.instants) if abs(edge - place) <= EDGE]
        return near[0] if near else place

    def _at(self, expression: Any, place: float) -> Symbol:
        result = read_expression("a value at the ends or at an instant", expression)
        for name, control in self.controls.items():
            if casadi.depends_on(result, self.symbols[name]):
                kind = "algebraic variable" if control.algebraic else "control"
                raise InvalidData(
                    f"{kind} {name!r} has no value at the ends or another single instant: it may jump "
                    "there; make it a state with its rate as the control",
                    field="control",
                )
        inner = self.start + place * (self.end - self.start)
        time = {0.0: self.start, 1.0: self.end}.get(place, inner)
        uses = [name for name in self.states if casadi.depends_on(result, self.symbols[name])]
        old = [*(self.symbols[name] for name in uses), self.time]
        new = [*(self.state_at(place, name) for name in uses), time]
        return casadi.substitute([result], old, new)[0]
