"""Declaring an optimal control problem: symbols in, a :class:`~.control_definition.Definition` out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData
from .control_definition import Definition, Guess, Phase, Quantity, Restriction
from .control_guess import drawn_up, sampled
from .fields import show

__all__ = ["Draft", "PhaseDraft"]

Floats = NDArray[np.float64]
Symbol = Any  # casadi.MX

_RELATIONS = (casadi.OP_LE, casadi.OP_LT, casadi.OP_EQ)


def vector(name: str, value: Any, size: int, default: float) -> Floats:
    """Return `value` as a vector of `size`: a number counts for every entry, None is `default`."""
    if value is None:
        return np.full(size, default)
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        raise InvalidData(f"{name} must be numbers, got {show(value)}", field=name) from None
    if isinstance(value, str | bool) or np.isnan(found).any():
        raise InvalidData(f"{name} must be numbers, got {show(value)}", field=name)
    if found.ndim > 1 or (found.ndim == 1 and found.size != size):
        raise InvalidData(
            f"{name} must be a number or {size} of them, got shape {found.shape}", field=name
        )
    return np.broadcast_to(found, (size,)).copy()


def _range(name: str, value: Any, size: int) -> tuple[Floats, Floats]:
    """Return the bounds that `value` means: None is free, a tuple of two a range, else fixed."""
    if isinstance(value, tuple) and len(value) == 2:
        if size == 2 and all(np.ndim(part) == 0 for part in value):
            raise InvalidData(
                f"{name} = {value!r} may mean two values or a range: write a list for values, "
                "([low, low], [high, high]) for a range",
                field=name,
            )
        low = vector(f"lower end of {name}", value[0], size, -np.inf)
        return low, vector(f"upper end of {name}", value[1], size, np.inf)
    if value is None:
        return vector(name, None, size, -np.inf), vector(name, None, size, np.inf)
    fixed = vector(name, value, size, 0.0)
    if not np.isfinite(fixed).all():
        raise InvalidData(f"{name} must be finite, got {show(value)}", field=name)
    return fixed, fixed


def _between(name: str, low: Floats, high: Floats) -> None:
    bad = np.flatnonzero(~(low <= high))
    if bad.size:
        raise InvalidData(
            f"{name}: lower {low[bad[0]]:g} exceeds upper {high[bad[0]]:g}", field=name
        )


def _column(what: str, expression: Any) -> Symbol:
    """Return `expression` as a column of CasADi's MX."""
    try:
        found = casadi.MX(expression)
    except (NotImplementedError, TypeError):
        raise InvalidData(
            f"{what} must be a CasADi expression of declared symbols or a number, got "
            f"{show(expression)}",
            field=what,
        ) from None
    return casadi.vec(found)


def _related(what: str, expression: Any, lower: Any, upper: Any, equals: Any) -> tuple[Any, ...]:
    """Return (expression, lower, upper); a relation is brought to one side."""
    column = _column(what, expression)
    bare = casadi.MX(expression) if not isinstance(expression, int | float) else column
    if bare.n_dep() == 2 and bare.op() in _RELATIONS:
        if not (lower is None and upper is None and equals is None):
            raise InvalidData(
                f"{what}: a relation has its bounds in itself; leave out lower, upper and equals",
                field=what,
            )
        left, right = bare.dep(0), bare.dep(1)
        column = casadi.vec(left - right)
        return column, (0.0 if bare.op() == casadi.OP_EQ else None), 0.0
    if equals is not None:
        if lower is not None or upper is not None:
            raise InvalidData(f"{what}: give equals, or lower and upper", field=what)
        return column, equals, equals
    if lower is None and upper is None:
        raise InvalidData(
            f"{what} needs a bound: lower, upper or equals, or a relation such as x <= 1",
            field=what,
        )
    return column, lower, upper


def _scale(name: str, given: Any, size: int, *bounds: Floats) -> Floats:
    """Return the typical size of each entry: what is given, or the largest finite bound, or 1."""
    if given is not None:
        found = vector(f"scale of {name}", given, size, 1.0)
        if not (np.isfinite(found) & (found > 0)).all():
            raise InvalidData(f"scale of {name} must be > 0, got {show(given)}", field="scale")
        return found
    table = np.abs(np.array(bounds))
    largest: Floats = np.where(np.isfinite(table), table, 0.0).max(axis=0)
    return np.where(largest > 0, largest, 1.0)


def restriction(
    words: tuple[str, str, str], size: int, lower: Any, upper: Any, scale: Any
) -> Restriction:
    """Return checked bounds of an expression of `size` entries; words are name, equation and unit."""
    name, equation, unit = words
    low = vector(f"lower bound of {name!r}", lower, size, -np.inf)
    high = vector(f"upper bound of {name!r}", upper, size, np.inf)
    _between(f"bounds of {name!r}", low, high)
    return Restriction(
        name=name,
        equation=equation,
        unit=unit,
        lower=low,
        upper=high,
        scale=_scale(repr(name), scale, size, low, high),
    )


def _free_name(kind: str, name: Any, taken: Sequence[str]) -> None:
    if not isinstance(name, str) or not name or any(c in name for c in "[]"):
        raise InvalidData(
            f"{kind} must have a name without brackets, got {show(name)}", field="name"
        )
    if name in taken:
        raise InvalidData(f"{kind} {name!r} is declared already", field="name")


def _size(name: str, size: Any) -> int:
    if isinstance(size, bool) or not isinstance(size, int) or size < 1:
        raise InvalidData(
            f"size of {name!r} must be a whole number >= 1, got {size!r}", field="size"
        )
    return size


@dataclass(eq=False)
class PhaseDraft:
    """One phase of a problem being declared; made by :meth:`OptimalControlProblem.phase`.

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

    def _declare(self, kind: str, name: str, size: int) -> Symbol:
        self.opened()
        _free_name(kind, name, [*self.states, *self.controls])
        symbol = casadi.MX.sym(name, _size(name, size))
        self.symbols[name] = symbol
        return symbol

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
        symbol = self._declare("a state", name, size)
        low = vector(f"lower bound of {name!r}", lower, size, -np.inf)
        high = vector(f"upper bound of {name!r}", upper, size, np.inf)
        _between(f"bounds of {name!r}", low, high)
        ends: list[Floats] = []
        for what, value in (("initial", initial), ("final", final)):
            label = f"{what} value of {name!r}"
            begin, end = _range(label, value, size)
            _between(label, begin, end)
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
            name,
            low,
            high,
            ends[0],
            ends[1],
            ends[2],
            ends[3],
            _scale(repr(name), scale, size, low, high, *ends),
            unit,
        )
        self.ends[name] = (
            casadi.MX.sym(f"{name}(t0)", size),
            casadi.MX.sym(f"{name}(tf)", size),
        )
        return symbol

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
        symbol = self._declare("a control", name, size)
        low = vector(f"lower bound of {name!r}", lower, size, -np.inf)
        high = vector(f"upper bound of {name!r}", upper, size, np.inf)
        _between(f"bounds of {name!r}", low, high)
        self.controls[name] = Quantity(
            name, low, high, low, high, low, high, _scale(repr(name), scale, size, low, high), unit
        )
        return symbol

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
        for key, rate in rates.items():
            name = key if isinstance(key, str) else self._state_of(key)
            if name not in self.states:
                raise InvalidData(
                    f"dynamics of {name!r}: phase {self.name!r} has the states "
                    f"{', '.join(map(repr, self.states)) or 'none'}",
                    field="dynamics",
                )
            if name in self.rates or name in checked:
                raise InvalidData(f"dynamics of {name!r} are declared already", field="dynamics")
            column, size = _column(f"dynamics of {name!r}", rate), self.states[name].lower.size
            if column.numel() == 1 and size > 1 and not casadi.symvar(column):
                column = casadi.repmat(column, size)
            if column.numel() != size:
                raise InvalidData(
                    f"dynamics of {name!r} must have {size} entries, got {column.numel()}",
                    field="dynamics",
                )
            checked[name] = column
        self.rates.update(checked)

    def _state_of(self, key: Any) -> str:
        for name, symbol in self.symbols.items():
            if symbol is key or (
                isinstance(key, casadi.MX) and key.__hash__() == symbol.__hash__()
            ):
                return name
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
        name = name or f"path {len(self.paths) + 1}"
        _free_name("a path constraint", name, [one.name for one, _ in self.paths])
        column, low, high = _related(f"path constraint {name!r}", expression, lower, upper, equals)
        words = (name, equation, unit)
        self.paths.append((restriction(words, column.numel(), low, high, scale), column))

    def integral(self, integrand: Any) -> Symbol:
        """Return the integral of `integrand` over the phase, for costs and constraints.

        Parameters
        ----------
        integrand : casadi expression
            A number in states, controls, time and parameters.
        """
        self.opened()
        column = _column("integrand", integrand)
        if column.numel() != 1:
            raise InvalidData(
                f"an integrand must be one number, got {column.numel()} entries", field="integral"
            )
        symbol = casadi.MX.sym(f"integral {len(self.integrands) + 1} of {self.name}")
        self.integrands.append((symbol, column))
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
        _free_name("an invariant", name, [one.name for one, _ in self.invariants])
        column = _column(f"invariant {name!r}", expression)
        words = (name, equation, unit)
        self.invariants.append((restriction(words, column.numel(), None, None, scale), column))

    # -- the ends and the guess ------------------------------------------------------------------

    def initial(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the begin of the phase."""
        return self._at(expression, 0, self.start)

    def final(self, expression: Any) -> Symbol:
        """Return `expression`, of states, time and parameters, at the end of the phase."""
        return self._at(expression, 1, self.end)

    def _at(self, expression: Any, side: int, time: Symbol) -> Symbol:
        column = casadi.MX(expression)
        for name in self.controls:
            if casadi.depends_on(column, self.symbols[name]):
                raise InvalidData(
                    f"control {name!r} has no value at the ends: it may jump there; make it a state "
                    "with its rate as the control",
                    field="control",
                )
        names = list(self.states)
        old = [*(self.symbols[name] for name in names), self.time]
        new = [*(self.ends[name][side] for name in names), time]
        return casadi.substitute([column], old, new)[0]

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
        self.guessed = sampled(self, plan, time, values, self.guessed)

    # -- the end product -------------------------------------------------------------------------

    def finished(self, parameters: Sequence[Symbol]) -> Phase:
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
            "path": [column for _, column in self.paths],
            "integrand": [column for _, column in self.integrands],
            "invariant": [column for _, column in self.invariants],
        }
        known = [self.time, *self.symbols.values(), *parameters]
        for what, columns in results.items():
            self._refuse_strangers(what, columns, known)
        function = compiled(
            "phase",
            {"t": self.time, "x": x, "u": u, "p": p},
            {what: casadi.vertcat(*columns, casadi.MX(0, 1)) for what, columns in results.items()},
            [self.time, *self.symbols.values(), *parameters],
        )
        start_lower, start_upper, end_lower, end_upper = self.bounds
        partial = Phase(
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
            guess=Guess(0.0, 1.0, np.zeros(1), np.zeros((1, x.numel())), np.zeros((1, u.numel()))),
            dynamics_equation=self.equation,
        )
        object.__setattr__(partial, "guess", drawn_up(partial, self.guessed))
        return partial

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


def compiled(
    name: str,
    arguments: Mapping[str, Symbol],
    results: Mapping[str, Symbol],
    symbols: Sequence[Symbol],
) -> casadi.Function:
    """Return a function of stacked arguments; made of scalar operations where CasADi can.

    The arguments may be stacks of `symbols`, which CasADi does not take as inputs by themselves.
    """
    parts: list[Symbol] = []
    fresh: dict[str, Symbol] = {}
    for label, stack in arguments.items():
        fresh[label] = casadi.MX.sym(label, stack.numel())
    where: dict[int, Symbol] = {}
    for label, stack in arguments.items():
        at = 0
        for symbol in casadi.symvar(stack):
            where[symbol.__hash__()] = fresh[label][at : at + symbol.numel()]
            at += symbol.numel()
    for symbol in symbols:
        parts.append(casadi.reshape(where[symbol.__hash__()], symbol.shape))
    new = casadi.substitute(list(results.values()), list(symbols), parts)
    found = casadi.Function(name, list(fresh.values()), new, list(fresh), list(results))
    try:
        return found.expand()
    except RuntimeError:
        # An interpolant or an external function has no scalar form; it works as it is.
        return found


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
        _free_name("a phase", name, [one.name for one in self.phases])
        if not isinstance(time, tuple | list) or len(time) != 2:
            raise InvalidData(
                f"time of phase {name!r} must be (start, end), each a number or (lower, upper), "
                f"got {show(time)}",
                field="time",
            )
        bounds: list[float] = []
        for what, value in zip(("start", "end"), time, strict=True):
            label = f"{what} of phase {name!r}"
            low, high = _range(label, tuple(value) if isinstance(value, list) else value, 1)
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
        _free_name("a parameter", name, list(self.parameters))
        low = vector(f"lower bound of {name!r}", lower, _size(name, size), -np.inf)
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
            _scale(repr(name), scale, size, low, high, value), unit,
        )  # fmt: skip
        symbol = casadi.MX.sym(name, size)
        self.parameters[name] = (quantity, symbol)
        return symbol

    def minimise(self, objective: Any, unit: str) -> None:
        """Set the objective."""
        column = _column("objective", objective)
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
        _free_name("a boundary constraint", name, [one.name for one, _ in self.boundaries])
        column, low, high = _related(
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
