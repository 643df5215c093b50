"""Declaring one phase of an optimal control problem: symbols in, a checked phase out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import Text, show
from ..definition import Phase, Quantity, Restriction
from .guess import draw_lines, read_guess
from .terms import (
    bounds,
    checked_size,
    column,
    compile_function,
    entries,
    free_name,
    range_of,
    read_expression,
    read_relation,
    restriction,
    text,
    typical,
)

__all__ = ["PhaseBuilder"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX


@dataclass(eq=False)
class PhaseBuilder:
    """One phase of a problem being declared; made by :meth:`ControlProblemBuilder.phase`.

    Attributes
    ----------
    name : str
        The phase's name.
    time : casadi.MX
        The time within the phase, t.
    start, end : casadi.MX
        Its two times, t0 and tf.
    """

    name: str
    bounds: tuple[float, float, float, float]
    unit: str
    equation: str
    opened: Callable[[], Any]

    def __post_init__(self) -> None:
        self.time = casadi.MX.sym(f"t of {self.name}")
        self.start = casadi.MX.sym(f"t0 of {self.name}")
        self.end = casadi.MX.sym(f"tf of {self.name}")
        self.symbols: dict[str, Symbol] = {}
        self.states: dict[str, Quantity] = {}
        self.controls: dict[str, Quantity] = {}
        self.ends: dict[str, tuple[Symbol, Symbol]] = {}
        self.rates: dict[str, Symbol] = {}
        self.paths: list[tuple[Restriction, Symbol]] = []
        self.integrands: list[tuple[Symbol, Symbol]] = []
        self.invariants: list[tuple[Restriction, Symbol]] = []
        self.guessed: dict[str, Any] = {}

    @property
    def duration(self) -> Symbol:
        """Its length in time, tf - t0."""
        return self.end - self.start

    # -- variables -------------------------------------------------------------------------------

    def _named(self, kind: str, name: str, size: Any) -> int:
        self.opened()
        free_name(kind, name, [*self.states, *self.controls])
        return checked_size(name, size)

    def _known(self, name: str, size: int) -> Symbol:
        self.symbols[name] = casadi.MX.sym(name, size)
        return self.symbols[name]

    def state(
        self,
        name: str,
        size: int = 1,
        *,
        initial: Any = None,
        final: Any = None,
        lower: Any = None,
        upper: Any = None,
        scale: Any = None,
        unit: str = "",
    ) -> Symbol:
        """Declare a state, and return its symbol.

        Parameters
        ----------
        name : str
            Its name.
        size : int
            Number of entries; more than 1 makes a vector.
        initial, final : float, array_like or tuple, optional
            Its value at the two ends, or a range ``(lower, upper)``; free without.
        lower, upper : float or array_like, optional
            Bounds at every instant.
        scale : float or array_like, optional
            Typical size; by default the largest of the bounds and ends, or 1.
        unit : str
            Unit, for people.
        """
        size = self._named("a state", name, size)
        low, high = bounds(name, lower, upper, size)
        ends: list[Floats] = []
        for what, value in (("initial", initial), ("final", final)):
            label = f"{what} value of {name!r}"
            begin, end = range_of(label, value, size)
            outside = np.flatnonzero((end < low) | (begin > high))
            if outside.size:
                k = int(outside[0])
                raise InvalidData(
                    f"{label} must lie in [{low[k]:g}, {high[k]:g}], its bounds, got "
                    f"{begin[k]:g}" + (f" to {end[k]:g}" if end[k] != begin[k] else ""),
                    field=what,
                )
            ends += [np.maximum(begin, low), np.minimum(end, high)]
        self.states[name] = Quantity(
            name, low, high, ends[0], ends[1], ends[2], ends[3],
            typical(repr(name), scale, size, low, high, *ends), text("unit", unit, repr(name)),
        )  # fmt: skip
        self.ends[name] = (
            casadi.MX.sym(f"{name}(t0)", size),
            casadi.MX.sym(f"{name}(tf)", size),
        )
        return self._known(name, size)

    def control(
        self,
        name: str,
        size: int = 1,
        *,
        lower: Any = None,
        upper: Any = None,
        scale: Any = None,
        unit: str = "",
    ) -> Symbol:
        """Declare a control, and return its symbol; the parameters are those of a state."""
        size = self._named("a control", name, size)
        low, high = bounds(name, lower, upper, size)
        self.controls[name] = Quantity(
            name, low, high, low, high, low, high, typical(repr(name), scale, size, low, high),
            text("unit", unit, repr(name)),
        )  # fmt: skip
        return self._known(name, size)

    # -- what holds at every instant -------------------------------------------------------------

    def dynamics(self, rates: Mapping[Any, Any]) -> None:
        """Declare the rates of states: ``{x: v, v: u}``.

        Parameters
        ----------
        rates : mapping
            The time derivative of each state, keyed by its symbol or name. Several calls add up.
        """
        self.opened()
        if not isinstance(rates, Mapping):
            raise InvalidData(
                f"dynamics must map states to their rates, got {show(rates)}", field="dynamics"
            )
        checked: dict[str, Symbol] = {}
        for key, given in rates.items():
            name = key if isinstance(key, str) else self._state_of(key)
            if name not in self.states:
                raise InvalidData(
                    f"dynamics of {name!r}: phase {self.name!r} has the states "
                    f"{', '.join(map(repr, self.states)) or 'none'}",
                    field="dynamics",
                )
            if name in self.rates or name in checked:
                raise InvalidData(f"dynamics of {name!r} are declared already", field="dynamics")
            rate, size = column(f"dynamics of {name!r}", given), self.states[name].size
            if rate.numel() == 1 and size > 1 and not casadi.symvar(rate):
                rate = casadi.repmat(rate, size)
            if rate.numel() != size:
                raise InvalidData(
                    f"dynamics of {name!r} must have {entries(size)}, got {rate.numel()}",
                    field="dynamics",
                )
            checked[name] = rate
        self.rates.update(checked)

    def _state_of(self, key: Any) -> str:
        """Return the name of the symbol `key`, which must be this phase's own."""
        for name, symbol in self.symbols.items():
            if isinstance(key, casadi.MX) and key.__hash__() == symbol.__hash__():
                return name
        if str(key) in self.states:
            raise InvalidData(
                f"dynamics of {str(key)!r}: the symbol is another phase's or problem's, not that of "
                f"phase {self.name!r}",
                field="dynamics",
            )
        return str(key)

    def path(
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
        """Declare a constraint that holds at every instant.

        Parameters
        ----------
        expression : casadi expression
            In states, controls, time and parameters, or a relation such as ``x**2 + y**2 >= 1``.
        lower, upper, equals : float or array_like, optional
            Its bounds, or the value it must have.
        name, equation, unit : str
            In the words of the paper.
        scale : float or array_like, optional
            Typical size of the expression.
        """
        self.opened()
        name = Text().coerce("name", name, {}) or f"path {len(self.paths) + 1}"
        free_name("a path constraint", name, self._constraints())
        bounded, low, high = read_relation(
            f"path constraint {name!r}", expression, lower, upper, equals
        )
        words = (name, equation, unit)
        self.paths.append((restriction(words, bounded.numel(), low, high, scale), bounded))

    def _constraints(self) -> list[str]:
        """Return the names that are taken: of this phase's constraints, and of those of the ends."""
        lists = (self.paths, self.invariants, self.opened().boundaries)
        return [one.name for listed in lists for one, _ in listed]

    def integral(self, integrand: Any) -> Symbol:
        """Return the integral of `integrand` over the phase, for costs and constraints.

        Parameters
        ----------
        integrand : casadi expression
            A number in states, controls, time and parameters.
        """
        self.opened()
        rate = column("integrand", integrand)
        if rate.numel() != 1:
            raise InvalidData(
                f"an integrand must be one number, got {rate.numel()} entries", field="integral"
            )
        symbol = casadi.MX.sym(f"integral {len(self.integrands) + 1} of {self.name}")
        self.integrands.append((symbol, rate))
        return symbol

    def invariant(
        self, name: str, expression: Any, *, equation: str = "", unit: str = "", scale: Any = None
    ) -> None:
        """Declare what the dynamics conserve, such as the norm of a quaternion; it is verified.

        Parameters
        ----------
        name : str
            Its name.
        expression : casadi expression
            In states, time and parameters.
        equation, unit : str
            In the words of the paper.
        scale : float or array_like, optional
            Typical size.
        """
        self.opened()
        free_name("an invariant", name, self._constraints())
        kept = column(f"invariant {name!r}", expression)
        for control in self.controls:
            if casadi.depends_on(kept, self.symbols[control]):
                raise InvalidData(
                    f"invariant {name!r} uses the control {control!r}, which may jump: an invariant "
                    "is made of states, time and parameters",
                    field="invariant",
                )
        words = (name, equation, unit)
        self.invariants.append((restriction(words, kept.numel(), None, None, scale), kept))

    # -- the ends and the guess ------------------------------------------------------------------

    def initial(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the begin of the phase."""
        return self._at(expression, 0, self.start)

    def final(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the end of the phase."""
        return self._at(expression, 1, self.end)

    def _at(self, expression: Any, side: int, time: Symbol) -> Symbol:
        found = read_expression("a value at the ends", expression)
        for name in self.controls:
            if casadi.depends_on(found, self.symbols[name]):
                raise InvalidData(
                    f"control {name!r} has no value at the ends: it may jump there; make it a state "
                    "with its rate as the control",
                    field="control",
                )
        names = list(self.states)
        old = [*(self.symbols[name] for name in names), self.time]
        new = [*(self.ends[name][side] for name in names), time]
        return casadi.substitute([found], old, new)[0]

    def guess(self, plan: Any = None, *, time: Any = None, **values: Any) -> None:
        """Guess the course, as a start for the search.

        Parameters
        ----------
        plan : ControlPlan, Solution or PhasePlan, optional
            Another answer: what bears the same names is taken over, its times included.
        time : array_like, optional
            Times of the samples given in `values`; its ends are guesses of free times. Without it,
            samples are spread evenly.
        **values : array_like or callable
            For a state or control by name: samples (a row each for a vector), which are joined
            linearly, one value throughout, or a function of time.
        """
        self.opened()
        self.guessed = read_guess(self, plan, time, values, self.guessed)

    # -- the definition -------------------------------------------------------------------------

    def define(self, parameters: Sequence[Symbol]) -> Phase:
        """Return the phase's definition, or raise for what is missing."""
        if not self.states:
            raise InvalidData(f"phase {self.name!r} has no state", field="states")
        missing = [name for name in self.states if name not in self.rates]
        if missing:
            raise InvalidData(
                f"phase {self.name!r}: no dynamics for state {', '.join(map(repr, missing))}",
                field="dynamics",
            )
        x = casadi.vertcat(*(self.symbols[name] for name in self.states))
        u = casadi.vertcat(*(self.symbols[name] for name in self.controls), casadi.MX(0, 1))
        p = casadi.vertcat(*parameters, casadi.MX(0, 1))
        results = {
            "rate": [self.rates[name] for name in self.states],
            "path": [one for _, one in self.paths],
            "integrand": [one for _, one in self.integrands],
            "invariant": [one for _, one in self.invariants],
        }
        known = [self.time, *self.symbols.values(), *parameters]
        for what, columns in results.items():
            self._refuse_strangers(what, columns, known)
        function = compile_function(
            "phase",
            {"t": self.time, "x": x, "u": u, "p": p},
            {what: casadi.vertcat(*columns, casadi.MX(0, 1)) for what, columns in results.items()},
            [self.time, *self.symbols.values(), *parameters],
        )
        start_lower, start_upper, end_lower, end_upper = self.bounds
        return Phase(
            name=self.name,
            states=tuple(self.states.values()),
            controls=tuple(self.controls.values()),
            start_lower=start_lower,
            start_upper=start_upper,
            end_lower=end_lower,
            end_upper=end_upper,
            time_unit=self.unit,
            paths=tuple(one for one, _ in self.paths),
            integrals=len(self.integrands),
            invariants=tuple(one for one, _ in self.invariants),
            function=function,
            guess=draw_lines(self, self.guessed),
            dynamics_equation=self.equation,
        )

    def _refuse_strangers(
        self, what: str, columns: Sequence[Symbol], known: Sequence[Symbol]
    ) -> None:
        marks = {one.__hash__() for one in known}
        for symbol in casadi.symvar(casadi.vertcat(*columns, casadi.MX(0, 1))):
            if symbol.__hash__() not in marks:
                raise InvalidData(
                    f"phase {self.name!r}: the {what} uses {symbol.name()!r}, which is no state, "
                    "control, time or parameter of this phase",
                    field=what,
                )
