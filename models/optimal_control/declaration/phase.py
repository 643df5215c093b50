"""Builder that turns the declarations of one phase into its definition."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData
from ...fields import Text, show
from ...programs.symbols import explain_symbols
from ..algebraic import check_index, solver_of
from ..definition import Phase, Restriction, check_algebraic
from .algebraic import Algebraic
from .flight import fly
from .guess import After, draw_lines
from .tables import domains
from .terms import (
    bounds,
    checked_size,
    column,
    compile_function,
    constraint,
    entries,
    free_name,
    quantity,
    range_of,
    restriction,
)

__all__ = ["PhaseBuilder"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX


@dataclass(eq=False)
class PhaseBuilder(Algebraic):
    """Phase under declaration, created by :meth:`ControlProblemBuilder.phase`.

    Attributes
    ----------
    name : str
        Name of the phase.
    time : casadi.MX
        Time within the phase, t.
    start, end : casadi.MX
        Start and end time, t0 and tf.
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
        self.instants = {}

    @property
    def duration(self) -> Symbol:
        """Duration of the phase, tf - t0."""
        return self.end - self.start

    # -- variables -------------------------------------------------------------------------------

    def _check_name(self, kind: str, name: str, size: Any) -> int:
        self.opened()
        free_name(kind, name, [*self.states, *self.controls])
        return checked_size(name, size)

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
        """Declare a state.

        Parameters
        ----------
        name : str
            Name of the state.
        size : int
            Number of entries; more than 1 makes a vector.
        initial, final : float, array_like, tuple or expression, optional
            Value at the start and the end, or a range ``(lower, upper)``; free by default. An
            expression, such as declared data, becomes a boundary constraint.
        lower, upper : float or array_like, optional
            Bounds at every instant.
        scale : float or array_like, optional
            Typical size; by default the largest of the bounds and ends, or 1.
        unit : str
            Unit, for display.

        Returns
        -------
        casadi.MX
            Symbol of the state.
        """
        size = self._check_name("a state", name, size)
        low, high = bounds(name, lower, upper, size)
        ends: list[Floats] = []
        given = {"initial": initial, "final": final}
        for what, value in given.items():
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
        self.states[name] = quantity(name, scale, unit, (low, high, *ends))
        first, last = (casadi.MX.sym(f"{name}({time})", size) for time in ("t0", "tf"))
        self.ends[name] = first, last
        self.symbols[name] = casadi.MX.sym(name, size)
        if any(isinstance(value, casadi.MX) for value in given.values()):
            self._end_by_expressions(name, given)
        return self.symbols[name]

    def _end_by_expressions(self, name: str, ends: Mapping[str, Any]) -> None:
        """Add constraints for ends that are expressions, and guess them at the values of the data."""
        state, problem, known = self.states[name], self.opened(), []
        for side, (what, value) in enumerate(ends.items()):
            low, high = getattr(state, f"{what}_lower"), getattr(state, f"{what}_upper")
            if isinstance(value, casadi.MX):
                problem.subject_to(
                    self.ends[name][side] == value,
                    name=f"{what} {name} of {self.name}", unit=state.unit, scale=state.scale,
                )  # fmt: skip
                symbols = [symbol for _, symbol in problem.parameters.values()]
                function = casadi.Function("at", symbols, [value], {"allow_free": True})
                if not function.has_free():
                    values = function.call(
                        [parameter.initial_lower for parameter, _ in problem.parameters.values()]
                    )
                    known.append(np.clip(np.array(values[0], float).reshape(-1), low, high))
            elif (low == high).all():
                known.append(low)
        if known:
            table = np.stack(
                [np.broadcast_to(end, state.lower.shape) for end in (known[0], known[-1])]
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
        """Declare a control.

        Parameters
        ----------
        name, size, lower, upper, scale, unit
            See :meth:`state`.
        integer : bool
            Whether the control is integer-valued, with integer bounds. Solvers compute the relaxed
            plan, and :func:`~crosstrack.models.optimal_control.round_controls` rounds it.

        Returns
        -------
        casadi.MX
            Symbol of the control.
        """
        size = self._check_name("a control", name, size)
        low, high = bounds(name, lower, upper, size)
        self.controls[name] = quantity(name, scale, unit, (low, high) * 3, integer=integer)
        self.symbols[name] = casadi.MX.sym(name, size)
        return self.symbols[name]

    # -- what holds at every instant -------------------------------------------------------------

    def dynamics(self, rates: Mapping[Any, Any]) -> None:
        """Declare the rates of states, such as ``{x: v, v: u}``.

        Parameters
        ----------
        rates : mapping
            Time derivatives, keyed by the symbol or name of the state. Several calls add up.

        Raises
        ------
        InvalidData
            A key is not a state of this phase or is declared already, or a rate has another size.
        """
        self.opened()
        if not isinstance(rates, Mapping):
            raise InvalidData(
                f"dynamics must map states to their rates, got {show(rates)}", field="dynamics"
            )
        checked: dict[str, Symbol] = {}
        for key, value in rates.items():
            name = key if isinstance(key, str) else self._state_of(key)
            if name not in self.states:
                raise InvalidData(
                    f"dynamics of {name!r}: phase {self.name!r} has the states "
                    f"{', '.join(map(repr, self.states)) or 'none'}",
                    field="dynamics",
                )
            if name in self.rates or name in checked:
                raise InvalidData(f"dynamics of {name!r} are declared already", field="dynamics")
            rate, size = column(f"dynamics of {name!r}", value), self.states[name].size
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
        """Return the name of the symbol `key`, which must belong to this phase."""
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
        """Declare a path constraint, which holds at every instant.

        Parameters
        ----------
        expression : casadi expression
            Expression in states, controls, time and parameters, or a relation such as
            ``x**2 + y**2 >= 1``.
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
        self.opened()
        labels = (Text().coerce("name", name, {}) or f"path {len(self.paths) + 1}", equation, unit)
        sides = (lower, upper, equals)
        self.paths.append(constraint("path", labels, self._constraints(), expression, sides, scale))

    def _constraints(self) -> list[str]:
        """Return the names of the constraints of this phase and of the boundary constraints."""
        lists = (self.paths, self.invariants, self.opened().boundaries)
        return [item.name for items in lists for item, _ in items]

    def integral(self, integrand: Any) -> Symbol:
        """Return the integral of `integrand` over the phase, for costs and constraints.

        Parameters
        ----------
        integrand : casadi expression
            Scalar expression in states, controls, time and parameters.

        Returns
        -------
        casadi.MX
            Symbol of the integral.
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
        """Declare a conserved quantity, such as the norm of a quaternion, which is verified.

        Parameters
        ----------
        name : str
            Name of the quantity.
        expression : casadi expression
            Expression in states, time and parameters.
        equation, unit : str
            Equation number in the paper, and unit.
        scale : float or array_like, optional
            Typical size.
        """
        self.opened()
        free_name("an invariant", name, self._constraints())
        conserved = column(f"invariant {name!r}", expression)
        for control in self.controls:
            if casadi.depends_on(conserved, self.symbols[control]):
                raise InvalidData(
                    f"invariant {name!r} uses the control {control!r}, which may jump: an invariant "
                    "is made of states, time and parameters",
                    field="invariant",
                )
        labels = (name, equation, unit)
        self.invariants.append(
            (restriction(labels, conserved.numel(), None, None, scale), conserved)
        )

    def output(self, name: str, expression: Any, *, equation: str = "", unit: str = "") -> Symbol:
        """Declare an additional quantity of a plan, and return its expression.

        It constrains nothing. ``plan[name](t)`` evaluates it, pictures draw it and exports contain it.

        Parameters
        ----------
        name : str
            Name of the output.
        expression : casadi expression
            Expression in states, controls, time and parameters.
        equation, unit : str
            Equation number in the paper, and unit.

        Returns
        -------
        casadi.MX
            The expression as a column.
        """
        self.opened()
        taken = [*self.states, *self.controls, *self._constraints()]
        free_name("an output", name, [*taken, *(item.name for item, _ in self.outputs)])
        output = column(f"output {name!r}", expression)
        labels = (name, equation, unit)
        self.outputs.append((restriction(labels, output.numel(), None, None, None), output))
        return output

    # -- the definition -------------------------------------------------------------------------

    def define(
        self,
        parameters: Sequence[Symbol],
        values: Floats,
        span: tuple[float, float],
        before: Mapping[str, Floats],
        after: After,
    ) -> Phase:
        """Return the phase's definition, or raise if a declaration is missing.

        The guess uses the `values` of parameters, the times `span`, and the data `before` and `after`
        of linked phases.
        """
        if not self.states:
            raise InvalidData(f"phase {self.name!r} has no state", field="states")
        missing = [name for name in self.states if name not in self.rates]
        if missing:
            raise InvalidData(
                f"phase {self.name!r}: no dynamics for state {', '.join(map(repr, missing))}",
                field="dynamics",
            )
        check_algebraic(
            f"phase {self.name!r}", self.controls.values(), (item for item, _ in self.paths)
        )
        rates = [self.rates[name] for name in self.states]
        integrands = [item for _, item in self.integrands]
        invariants = [item for _, item in self.invariants]
        stated = [*rates, *(item for _, item in self.paths), *integrands, *invariants]
        paths = [*self.paths, *domains(stated, self._constraints())]
        results = {
            "rate": rates,
            "path": [item for _, item in paths],
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
            solved = solver_of(
                function, tuple(self.controls.values()), tuple(item for item, _ in paths)
            )
            guess = fly(self, function, steer, solved, guess, values)
        outputs = None
        if self.outputs:
            columns = {"output": [item for _, item in self.outputs]}
            outputs = compile_function("outputs", arguments, columns, self._explain)
        sides = ("start_lower", "start_upper", "end_lower", "end_upper")
        phase = Phase(
            name=self.name,
            states=tuple(self.states.values()),
            controls=tuple(self.controls.values()),
            **dict(zip(sides, self.bounds, strict=True)),
            time_unit=self.unit,
            paths=tuple(item for item, _ in paths),
            integrals=len(self.integrands),
            invariants=tuple(item for item, _ in self.invariants),
            function=function,
            guess=guess,
            dynamics_equation=self.equation,
            outputs=tuple(item for item, _ in self.outputs),
            outputs_function=outputs,
            instants=tuple(sorted(self.instants)),
        )
        check_index(phase, values)
        return phase

    def _explain(self, what: str, symbol: Symbol) -> str:
        """Return the error message for a symbol that does not belong to the phase."""
        return (
            f"phase {self.name!r}: the {what} uses {symbol.name()!r}, which is no state, control, "
            "time or parameter of this phase"
        )
