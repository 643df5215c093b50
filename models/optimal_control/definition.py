"""Definition of an optimal control problem: bounds, names and functions.

The symbols of the declaration are not part of it. A definition is stored, sent to other processes,
digested, verified and transcribed.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, suggestion
from ..declaration import Declared, Listed, Nested
from ..fields import Array, Flag, Optional, Real, Text, Whole, declared, show
from ..programs.compiled import Compiled, canonical_text
from ..records import Several

if TYPE_CHECKING:
    import casadi

__all__ = [
    "Definition", "Guess", "Phase", "Quantity", "Restriction", "check_algebraic", "check_order", "entry_names", "entry_slices",
    "entry_units",
]  # fmt: skip

Floats = NDArray[np.float64]

#: Bounds of a quantity at every instant and at both ends.
SIDES = ("lower", "upper", "initial_lower", "initial_upper", "final_lower", "final_upper")
_LOW = Array(("size",), infinity=-1)
_HIGH = Array(("size",), infinity=1)


def check_order(name: str, low: Any, high: Any, field: str = "") -> None:
    """Raise if a lower bound exceeds the upper one."""
    low, high = np.atleast_1d(low), np.atleast_1d(high)
    bad = np.flatnonzero(~(low <= high))
    if bad.size:
        raise InvalidData(
            f"{name}: lower {low[bad[0]]:g} exceeds upper {high[bad[0]]:g}", field=field or name
        )


def _check_entries(of: str, item: Any) -> None:
    if not item.name or any(c in item.name for c in "[]"):
        raise InvalidData(
            f"{of} must have a name without brackets, got {item.name!r}", field="name"
        )
    if not item.size:
        raise InvalidData(f"{of} {item.name!r} must have 1 entry at least, got 0", field="lower")
    if not (item.scale > 0).all():
        raise InvalidData(f"scale of {item.name!r} must be > 0, got {item.scale}", field="scale")


def _check_unique(what: str, names: Iterable[str]) -> None:
    """Raise if a name occurs twice."""
    for name, count in Counter(names).items():
        if count > 1:
            raise InvalidData(f"{what}: {name!r} stands twice", field=what)


def _check_sizes(what: str, function: casadi.Function, sizes: Mapping[str, int]) -> None:
    """Raise if an argument or a result of `function` has another size than declared."""
    for name, size in sizes.items():
        known = function.name_in()
        shape = function.size_in(name) if name in known else function.size_out(name)
        actual = shape[0] * shape[1]
        if shape[1] != 1 and shape != (0, 0):
            raise InvalidData(
                f"{what}: {name} of the function must be a column, got shape {tuple(shape)}",
                field="function",
            )
        if actual != size:
            raise InvalidData(
                f"{what}: {name} of the function has {actual} entries, {size} are declared",
                field=name,
            )


class _Bounded(Declared):
    """Base of vectors with bounds."""

    lower: Floats

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(self.lower.size)


ItemT = TypeVar("ItemT", bound=_Bounded)


@dataclass(frozen=True, eq=False)
class Quantity(_Bounded):
    """State, control or parameter: a vector with bounds.

    Parameters
    ----------
    name : str
        Name, without brackets.
    lower, upper : ndarray, shape (size,)
        Bounds at every instant.
    initial_lower, initial_upper, final_lower, final_upper : ndarray, shape (size,)
        Bounds at the two ends of the phase; equal ones fix the value.
    scale : ndarray, shape (size,)
        Typical size of each entry, positive.
    unit : str
        Unit, for display.
    given : bool
        Whether the parameter is data: its value is fixed, and all bounds equal it.
    integer : bool
        Whether the control is integer-valued. Solvers relax it, and
        :func:`~.rounding.round_controls` rounds the relaxed control.
    algebraic : bool
        Whether the control is an algebraic variable, which algebraic equations determine.
    """

    name: str = declared(Text())
    lower: Floats = declared(_LOW)
    upper: Floats = declared(_HIGH)
    initial_lower: Floats = declared(_LOW)
    initial_upper: Floats = declared(_HIGH)
    final_lower: Floats = declared(_LOW)
    final_upper: Floats = declared(_HIGH)
    scale: Floats = declared(Array(("size",), lower=0))
    unit: str = declared(Text(), default="")
    given: bool = declared(Flag(), default=False, added=True)
    integer: bool = declared(Flag(), default=False, added=True)
    algebraic: bool = declared(Flag(), default=False, added=True)

    def read(self, value: Any) -> Floats:
        """Return `value` as a value of this data, shape (size,); a number is broadcast.

        Raises
        ------
        InvalidData
            The value has another size, or is not finite.
        """
        try:
            result = np.asarray(value)
            if result.dtype.kind not in "iuf" or np.ma.is_masked(value):
                raise TypeError
            result = np.broadcast_to(result.astype(float), (self.size,))
        except (TypeError, ValueError):
            result = np.array([np.nan])
        if not np.isfinite(result).all():
            words = "a finite number" if self.size == 1 else f"{self.size} finite numbers, or one"
            raise InvalidData(
                f"data {self.name!r} must be {words}, got {show(value)}", field=self.name
            )
        return result

    def holding(self, value: Any) -> Quantity:
        """Return this data with another value, converted by :meth:`read`."""
        changes: dict[str, Any] = dict.fromkeys(SIDES, self.read(value))
        return replace(self, **changes)

    def check(self) -> None:
        """Raise if bounds contradict one another."""
        _check_entries("a quantity", self)
        edges = np.concatenate([self.lower, self.upper])
        if self.integer and not (np.isfinite(edges) & (edges == np.round(edges))).all():
            raise InvalidData(
                f"bounds of the integer control {self.name!r} must be whole numbers, "
                f"got {show(edges.tolist())}",
                field="integer",
            )
        if self.given and (self.lower != self.upper).any():
            raise InvalidData(
                f"data {self.name!r} must have its value for both bounds, got {self.lower} and "
                f"{self.upper}",
                field="given",
            )
        for side in ("", "initial_", "final_"):
            low, high = getattr(self, f"{side}lower"), getattr(self, f"{side}upper")
            check_order(f"{side}bounds of {self.name!r}", low, high, f"{side}bounds")


def entry_names(quantities: Iterable[Quantity | Restriction]) -> tuple[str, ...]:
    """Return one name per entry: ``"x"`` for a scalar, ``"q[0]", "q[1]"`` for a vector."""
    names: list[str] = []
    for item in quantities:
        names += [item.name] if item.size == 1 else [f"{item.name}[{k}]" for k in range(item.size)]
    return tuple(names)


def entry_units(items: Iterable[Quantity | Restriction]) -> list[str]:
    """Return one unit per entry."""
    return [item.unit for item in items for _ in range(item.size)]


def entry_slices(items: Iterable[ItemT]) -> Iterator[tuple[ItemT, slice]]:
    """Yield each item with the places of its entries in the stacked vector."""
    start = 0
    for item in items:
        yield item, slice(start, start + item.size)
        start += item.size


@dataclass(frozen=True, eq=False)
class Restriction(_Bounded):
    """Bounds on an expression: a path or a boundary constraint.

    Parameters
    ----------
    name, equation, unit : str
        Name and equation number in the paper, and unit.
    lower, upper : ndarray, shape (size,)
        Bounds; equal ones make an equality constraint.
    scale : ndarray, shape (size,)
        Typical size of the expression, positive.
    algebraic : bool
        Whether the path constraint is an equation that determines algebraic variables.
    """

    name: str = declared(Text())
    equation: str = declared(Text())
    unit: str = declared(Text())
    lower: Floats = declared(_LOW)
    upper: Floats = declared(_HIGH)
    scale: Floats = declared(Array(("size",), lower=0))
    algebraic: bool = declared(Flag(), default=False, added=True)

    def check(self) -> None:
        """Raise if bounds contradict one another."""
        _check_entries("a constraint", self)
        check_order(f"bounds of {self.name!r}", self.lower, self.upper, "bounds")


def check_algebraic(label: str, controls: Iterable[Quantity], paths: Iterable[Restriction]) -> None:
    """Raise unless there is one algebraic equation per entry of an algebraic variable."""
    variables = [item for item in controls if item.algebraic]
    equations = [item for item in paths if item.algebraic]
    counts = [sum(item.size for item in items) for items in (variables, equations)]
    if counts[0] != counts[1] or any((item.lower != item.upper).any() for item in equations):
        names = ", ".join(repr(item.name) for item in variables) or "none"
        raise InvalidData(
            f"{label}: the algebraic variables ({names}) have {counts[0]} entries and need as many "
            f"algebraic equations, got {counts[1]}",
            field="algebraic",
        )


@dataclass(frozen=True, eq=False)
class Guess(Declared):
    """Samples of the guessed states and controls of a phase.

    Parameters
    ----------
    start, end : float
        Guessed times of the two ends.
    fractions : ndarray, shape (samples,)
        Positions of the samples, from 0 (start) to 1 (end), increasing.
    states : ndarray, shape (samples, states)
        Values of the states, interpolated linearly.
    controls : ndarray, shape (samples, controls)
        Values of the controls, interpolated linearly.
    """

    start: float = declared(Real())
    end: float = declared(Real())
    fractions: Floats = declared(Array(("samples",), lower=0, upper=1))
    states: Floats = declared(Array(("samples", "states")))
    controls: Floats = declared(Array(("samples", "controls")))

    def check(self) -> None:
        """Raise if the samples or times do not increase."""
        if not self.fractions.size or not (np.diff(self.fractions) > 0).all():
            raise InvalidData(
                f"fractions must increase, got {show(self.fractions.tolist())}", field="fractions"
            )
        if not self.end > self.start:
            raise InvalidData(
                f"end of a guess must be after its start {self.start:g}, got {self.end:g}",
                field="end",
            )


class _Stacked(Declared):
    """Base of classes with tuples of quantities and restrictions, which it stacks into vectors."""

    def stacked(self, what: str, field: str) -> Floats:
        """Return `field` of all items of `what`, such as states, as a vector."""
        parts = [getattr(item, field) for item in getattr(self, what)]
        return np.concatenate([*parts, np.empty(0)])

    def bounds(self, what: str, side: str = "") -> tuple[Floats, Floats]:
        """Return lower and upper bounds of all items of `what`; `side` may be ``"initial"`` or ``"final"``."""
        low, high = (f"{side}_{edge}".lstrip("_") for edge in ("lower", "upper"))
        return self.stacked(what, low), self.stacked(what, high)


@dataclass(frozen=True, eq=False, kw_only=True)
class Phase(_Stacked):
    """Phase: an interval of time with its own states, controls and dynamics.

    Parameters
    ----------
    name : str
        Name of the phase.
    states, controls : tuple of Quantity
        States and controls.
    start_lower, start_upper, end_lower, end_upper : float
        Bounds of the start and end times; equal ones fix them.
    time_unit : str
        Unit of time.
    paths : tuple of Restriction
        Constraints at every instant (C ≤ 0 of the paper's eq. 13).
    integrals : int
        Number of integrals over the phase in costs and constraints.
    invariants : tuple of Restriction
        Quantities that the dynamics conserve, with infinite bounds.
    function : casadi.Function
        ``(t, x, u, p) -> (rate, path, integrand, invariant)`` at one instant.
    guess : Guess
        Start of a search.
    dynamics_equation : str
        Equation number of the dynamics in the paper.
    outputs : tuple of Restriction
        Additional quantities to show, with infinite bounds.
    outputs_function : casadi.Function, optional
        ``(t, x, u, p) -> output``; None without outputs.
    instants : tuple of float
        Interior instants whose states occur in costs and boundary constraints, as fractions of the
        phase, increasing.
    """

    name: str = declared(Text())
    states: tuple[Quantity, ...] = declared(Listed(Quantity))
    controls: tuple[Quantity, ...] = declared(Listed(Quantity))
    start_lower: float = declared(Real())
    start_upper: float = declared(Real())
    end_lower: float = declared(Real())
    end_upper: float = declared(Real())
    time_unit: str = declared(Text())
    paths: tuple[Restriction, ...] = declared(Listed(Restriction))
    integrals: int = declared(Whole(0))
    invariants: tuple[Restriction, ...] = declared(Listed(Restriction))
    function: casadi.Function = declared(
        Compiled(("t", "x", "u", "p"), ("rate", "path", "integrand", "invariant"))
    )
    guess: Guess = declared(Nested(Guess))
    dynamics_equation: str = declared(Text())
    outputs: tuple[Restriction, ...] = declared(Listed(Restriction), default=(), added=True)
    outputs_function: casadi.Function | None = declared(
        Optional(Compiled(("t", "x", "u", "p"), ("output",))), default=None, added=True
    )
    instants: tuple[float, ...] = declared(Several(Real(0.0, 1.0)), default=(), added=True)

    def check(self) -> None:
        """Raise if the sizes of the function or the guess do not match the declaration."""
        label = f"phase {self.name!r}"
        if not self.states:
            raise InvalidData(f"{label} has no state", field="states")
        _check_unique(label, (item.name for item in (*self.states, *self.controls)))
        for what in ("paths", "invariants", "outputs"):
            _check_unique(f"{what} of {label}", (item.name for item in getattr(self, what)))
        for side in ("start", "end"):
            low, high = getattr(self, f"{side}_lower"), getattr(self, f"{side}_upper")
            check_order(f"{side} of {label}", low, high, side)
        if not self.start_lower < self.end_upper:
            raise InvalidData(
                f"time of {label} must go forward, got start {self.start_lower:g}, end "
                f"{self.end_upper:g}",
                field="time",
            )
        check_algebraic(label, self.controls, self.paths)
        if not (np.diff([0.0, *self.instants, 1.0]) > 0).all():
            raise InvalidData(
                f"instants of {label} must increase between 0 and 1, got {show(self.instants)}",
                field="instants",
            )
        sizes = {"t": 1, "x": len(self.state_names), "u": len(self.control_names)}
        results = {
            "rate": sizes["x"],
            "path": sum(item.size for item in self.paths),
            "integrand": self.integrals,
            "invariant": sum(item.size for item in self.invariants),
        }
        _check_sizes(label, self.function, sizes | results)
        if (self.outputs_function is None) != (not self.outputs):
            raise InvalidData(f"{label} must have outputs with their function", field="outputs")
        if self.outputs_function is not None:
            entries = sum(item.size for item in self.outputs)
            _check_sizes(label, self.outputs_function, sizes | {"output": entries})
        for what, expected in (("states", sizes["x"]), ("controls", sizes["u"])):
            actual = getattr(self.guess, what).shape[1]
            if actual != expected:
                raise InvalidData(
                    f"guess of {label} has {actual} columns for {expected} {what}", field="guess"
                )

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, one per entry."""
        return entry_names(self.states)

    @cached_property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls, one per entry."""
        return entry_names(self.controls)

    @property
    def observed(self) -> tuple[Restriction, ...]:
        """Path constraints, invariants and outputs, which a plan evaluates on request."""
        return (*self.paths, *self.invariants, *self.outputs)

    def observe(self, t: Floats, x: Floats, u: Floats, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return path constraints, invariants and outputs, each of shape (points, entries).

        Parameters
        ----------
        t : ndarray, shape (points,)
            Times.
        x, u : ndarray, shape (points, size)
            States and controls.
        p : ndarray, shape (parameters,)
            Parameters.
        """
        arguments = (t[None, :], x.T, u.T, p)
        _, path, _, invariant = (result.full().T for result in self.function(*arguments))
        if self.outputs_function is None:
            return path, invariant, np.empty((t.size, 0))
        return path, invariant, self.outputs_function(*arguments).full().T

    @property
    def end_size(self) -> int:
        """Number of entries in the endpoint vector: t0, tf, x0, xf, integrals, states at instants."""
        return 2 + (2 + len(self.instants)) * len(self.state_names) + self.integrals


@dataclass(frozen=True, eq=False, kw_only=True)
class Definition(_Stacked):
    """Optimal control problem in Bolza form, over one or several phases.

    Parameters
    ----------
    phases : tuple of Phase
        Phases in order.
    parameters : tuple of Quantity
        Constants to be optimised or given; `initial_lower` = `initial_upper` is their guess.
    boundaries : tuple of Restriction
        Constraints between the ends of the phases (φ = 0 of the paper's eq. 13).
    endpoint : casadi.Function
        ``(e, p) -> (objective, boundary)`` with the endpoint vector e, which stacks t0, tf, x0, xf,
        the integrals and the states at interior instants of every phase.
    objective_unit : str
        Unit of the objective.
    objective_scale : float
        Typical size of the objective; 0 to measure it along the guess and each plan.
    """

    phases: tuple[Phase, ...] = declared(Listed(Phase))
    parameters: tuple[Quantity, ...] = declared(Listed(Quantity))
    boundaries: tuple[Restriction, ...] = declared(Listed(Restriction))
    endpoint: casadi.Function = declared(Compiled(("e", "p"), ("objective", "boundary")))
    objective_unit: str = declared(Text())
    objective_scale: float = declared(Real(0.0), added=True, default=0.0)

    def check(self) -> None:
        """Raise if the sizes of the functions do not match the declaration."""
        if not self.phases:
            raise InvalidData("phases must hold 1 phase at least, got 0", field="phases")
        for what in ("phases", "parameters", "boundaries"):
            _check_unique(what, (item.name for item in getattr(self, what)))
        parameters = len(self.parameter_names)
        for phase in self.phases:
            for function in (phase.function, phase.outputs_function):
                if function is not None:
                    _check_sizes(f"phase {phase.name!r}", function, {"p": parameters})
        _check_sizes(
            "endpoint",
            self.endpoint,
            {
                "e": sum(phase.end_size for phase in self.phases),
                "p": parameters,
                "objective": 1,
                "boundary": sum(item.size for item in self.boundaries),
            },
        )

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, one per entry."""
        return entry_names(self.parameters)

    @cached_property
    def interior(self) -> NDArray[np.bool_]:
        """Whether an entry of the endpoint vector is a state at an interior instant."""
        sizes = [(p.end_size, len(p.instants) * len(p.state_names)) for p in self.phases]
        return np.concatenate([np.arange(size) >= size - inner for size, inner in sizes])

    def given(self, values: Mapping[str, Any]) -> Definition:
        """Return the definition with other values of its data, by name; the others are unchanged.

        Raises
        ------
        InvalidData
            A name is not data of the problem, or a value has another size or is not finite.
        """
        data = {parameter.name: parameter for parameter in self.parameters if parameter.given}
        for name in values:
            if name not in data:
                known = ", ".join(map(repr, data)) or "none"
                raise InvalidData(
                    f"{name!r} is no data of the problem; {suggestion(name, list(data))}"
                    f"its data: {known}",
                    field=str(name),
                )
        return replace(
            self,
            parameters=tuple(
                parameter.holding(values[parameter.name]) if parameter.name in values else parameter
                for parameter in self.parameters
            ),
        )

    @cached_property
    def text(self) -> str:
        """Definition as canonical JSON text, which the digest hashes.

        It contains functions in CasADi's text format, as in files of version 0.1.
        """
        data = self.data()
        data["endpoint"] = canonical_text(data["endpoint"])
        for phase in data["phases"]:
            for key in {"function", "outputs_function"} & set(phase):
                phase[key] = canonical_text(phase[key])
        return json.dumps(data, sort_keys=True, allow_nan=False)
