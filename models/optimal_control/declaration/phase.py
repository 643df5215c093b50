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
from .flight import fly
from .guess import After, Guessed, draw_lines
from .symbols import explain_symbols
from .tables import domains
from .terms import (
    bounds,
    checked_size,
    column,
    compile_function,
    constraint,
    entries,
    free_name,
    range_of,
    read_expression,
    restriction,
    text,
    typical,
)

__all__ = ["PhaseBuilder"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX


@dataclass(eq=False)
class PhaseBuilder(Guessed):
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
        explain_symbols()
        self.time = casadi.MX.sym(f"t of {self.name}")
        self.start = casadi.MX.sym(f"t0 of {self.name}")
        self.end = casadi.MX.sym(f"tf of {self.name}")
        self.symbols: dict[str, Symbol] = {}
        self.states, self.controls = {}, {}
        self.ends: dict[str, tuple[Symbol, Symbol]] = {}
        self.rates: dict[str, Symbol] = {}
        self.paths: list[tuple[Restriction, Symbol]] = []
        self.integrands: list[tuple[Symbol, Symbol]] = []
        self.invariants: list[tuple[Restriction, Symbol]] = []
        self.outputs: list[tuple[Restriction, Symbol]] = []
        self.guessed, self.flown, self.feedback = {}, set(), {}

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
        initial, final : float, array_like, tuple or expression, optional
            Its value at the two ends, or a range ``(lower, upper)``; free without. An expression, of
            data for instance, becomes a boundary constraint.
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
        said = {"initial": initial, "final": final}
        for what, value in said.items():
            label = f"{what} value of {name!r}"
            if isinstance(value, casadi.MX):
                value = None
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
        symbol = self._known(name, size)
        if any(isinstance(value, casadi.MX) for value in said.values()):
            self._end_by_expressions(name, said)
        return symbol

    def _end_by_expressions(self, name: str, said: Mapping[str, Any]) -> None:
        """Declare ends that are expressions as constraints, and guess them at the data's values."""
        one, problem, known = self.states[name], self.opened(), []
        for side, (what, value) in enumerate(said.items()):
            low, high = getattr(one, f"{what}_lower"), getattr(one, f"{what}_upper")
            if isinstance(value, casadi.MX):
                problem.subject_to(
                    self.ends[name][side] == value,
                    name=f"{what} {name} of {self.name}", unit=one.unit, scale=one.scale,
                )  # fmt: skip
                symbols = [symbol for _, symbol in problem.parameters.values()]
                at = casadi.Function("at", symbols, [value], {"allow_free": True})
                if not at.has_free():
                    values = at.call(
                        [given.initial_lower for given, _ in problem.parameters.values()]
                    )
                    known.append(np.clip(np.array(values[0], float).reshape(-1), low, high))
            elif (low == high).all():
                known.append(low)
        if known:
            table = np.stack(
                [np.broadcast_to(end, one.lower.shape) for end in (known[0], known[-1])]
            )
            self.guessed[name] = np.array([0.0, 1.0]), table

    def control(
        self,
        name: str,
        size: int = 1,
        *,
        lower: Any = None,
        upper: Any = None,
        scale: Any = None,
        unit: str = "",
        integer: bool = False,
    ) -> Symbol:
        """Declare a control, and return its symbol; the parameters are those of a state.

        What is `integer` has whole bounds and is to take whole numbers only: solvers find the
        relaxed plan, and :func:`~crosstrack.models.optimal_control.round_controls` rounds it.
        """
        size = self._named("a control", name, size)
        low, high = bounds(name, lower, upper, size)
        self.controls[name] = Quantity(
            name, low, high, low, high, low, high, typical(repr(name), scale, size, low, high),
            text("unit", unit, repr(name)), integer=integer,
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
        words = (Text().coerce("name", name, {}) or f"path {len(self.paths) + 1}", equation, unit)
        sides = (lower, upper, equals)
        self.paths.append(constraint("path", words, self._constraints(), expression, sides, scale))

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

    def output(self, name: str, expression: Any, *, equation: str = "", unit: str = "") -> Symbol:
        """Name what is to be seen of a plan beside states and controls, and return it.

        It binds nothing: ``plan[name](t)`` gives it, pictures draw it and exports hold it.

        Parameters
        ----------
        name : str
            Its name.
        expression : casadi expression
            In states, controls, time and parameters.
        equation, unit : str
            In the words of the paper.
        """
        self.opened()
        taken = [*self.states, *self.controls, *self._constraints()]
        free_name("an output", name, [*taken, *(one.name for one, _ in self.outputs)])
        shown = column(f"output {name!r}", expression)
        words = (name, equation, unit)
        self.outputs.append((restriction(words, shown.numel(), None, None, None), shown))
        return shown

    # -- the ends --------------------------------------------------------------------------------

    def initial(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the start of the phase."""
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

    # -- the definition -------------------------------------------------------------------------

    def define(
        self,
        parameters: Sequence[Symbol],
        values: Floats,
        span: tuple[float, float],
        before: Mapping[str, Floats],
        after: After,
    ) -> Phase:
        """Return the phase's definition, or raise for what is missing.

        The guess has the `values` of parameters, the times `span`, and what `before` and `after`
        tell of linked phases, as in :func:`~.guess.draw_lines`.
        """
        if not self.states:
            raise InvalidData(f"phase {self.name!r} has no state", field="states")
        missing = [name for name in self.states if name not in self.rates]
        if missing:
            raise InvalidData(
                f"phase {self.name!r}: no dynamics for state {', '.join(map(repr, missing))}",
                field="dynamics",
            )
        rates = [self.rates[name] for name in self.states]
        integrands = [one for _, one in self.integrands]
        invariants = [one for _, one in self.invariants]
        stated = [*rates, *(one for _, one in self.paths), *integrands, *invariants]
        paths = [*self.paths, *domains(stated, self._constraints())]
        results = {
            "rate": rates,
            "path": [one for _, one in paths],
            "integrand": integrands,
            "invariant": invariants,
        }
        arguments = {
            "t": [self.time],
            "x": [self.symbols[name] for name in self.states],
            "u": [self.symbols[name] for name in self.controls],
            "p": parameters,
        }
        function = compile_function("phase", arguments, results, self._explain)
        guess = draw_lines(self, span, before, after)
        if self.flown:
            laws = [{**self.symbols, **self.feedback}[name] for name in self.controls]
            steer = compile_function("feedback", arguments, {"feedback": laws}, self._explain)
            guess = fly(self, function, steer, guess, values)
        shown = None
        if self.outputs:
            columns = {"output": [one for _, one in self.outputs]}
            shown = compile_function("outputs", arguments, columns, self._explain)
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
            paths=tuple(one for one, _ in paths),
            integrals=len(self.integrands),
            invariants=tuple(one for one, _ in self.invariants),
            function=function,
            guess=guess,
            dynamics_equation=self.equation,
            outputs=tuple(one for one, _ in self.outputs),
            outputs_function=shown,
        )

    def _explain(self, what: str, symbol: Symbol) -> str:
        """Return what is wrong with a symbol that is not the phase's own."""
        return (
            f"phase {self.name!r}: the {what} uses {symbol.name()!r}, which is no state, control, "
            "time or parameter of this phase"
        )
