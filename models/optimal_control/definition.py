"""What an optimal control problem consists of once it is declared: bounds, names and functions.

Symbols live only while people declare; this is what is stored, sent to another process, digested,
verified and transcribed.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Real, Spec, Text, Whole, declared, show
from ..programs.compiled import Compiled

if TYPE_CHECKING:
    import casadi

__all__ = [
    "Definition",
    "Guess",
    "Phase",
    "Quantity",
    "Restriction",
    "Stated",
    "entry_names",
]

Floats = NDArray[np.float64]
PartT = TypeVar("PartT", bound="_Part")

_LOW = Array(("size",), infinity=-1)
_HIGH = Array(("size",), infinity=1)


@dataclass(frozen=True, eq=False)
class _Part:
    """A piece of the definition whose fields are declared with a Spec, as a model's are."""

    def __post_init__(self) -> None:
        sizes: dict[str, tuple[int, str]] = {}
        for field in dataclasses.fields(self):
            spec = field.metadata.get("spec")
            if spec is not None:
                value = spec.coerce(field.name, getattr(self, field.name), sizes)
                object.__setattr__(self, field.name, value)
        self.check()

    def check(self) -> None:
        """Raise :class:`~crosstrack.errors.InvalidData` where fields contradict one another."""

    def to_data(self) -> dict[str, Any]:
        """Return the piece as JSON data."""
        found = {}
        for field in dataclasses.fields(self):
            value, spec = getattr(self, field.name), field.metadata.get("spec")
            if spec is not None:
                found[field.name] = spec.encode(value)
            elif isinstance(value, tuple):
                found[field.name] = [one.to_data() for one in value]
            else:
                found[field.name] = None if value is None else value.to_data()
        return found

    @classmethod
    def from_data(cls: type[PartT], data: Any, parts: Mapping[str, Any] | None = None) -> PartT:
        """Return the piece in `data`; `parts` reads the fields that hold pieces."""
        names = [field.name for field in dataclasses.fields(cls)]
        if not isinstance(data, Mapping) or set(data) != set(names):
            raise InvalidData(
                f"a {cls.__name__.lower()} has the keys {', '.join(names)}, got {show(data)}",
                field=cls.__name__.lower(),
            )
        return cls(**{name: (parts or {}).get(name, data[name]) for name in names})


def _read(data: Mapping[str, Any], kinds: Mapping[str, type[_Part]]) -> dict[str, Any]:
    """Return the tuples of pieces in `data`, a list of each kind by its key."""
    found: dict[str, Any] = {}
    for name, kind in kinds.items():
        listed = data.get(name, ())
        if not isinstance(listed, list | tuple):
            raise InvalidData(f"{name} must be a list, got {show(listed)}", field=name)
        found[name] = tuple(kind.from_data(one) for one in listed)
    return found


def _ordered(of: str, low: Any, high: Any, what: str) -> None:
    """Raise where a lower bound exceeds an upper one."""
    bad = np.flatnonzero(~(np.atleast_1d(low) <= np.atleast_1d(high)))
    if bad.size:
        k = int(bad[0])
        raise InvalidData(
            f"{what} of {of}: lower {np.atleast_1d(low)[k]:g} exceeds upper "
            f"{np.atleast_1d(high)[k]:g}",
            field=what,
        )


def _sized(of: str, one: Any) -> None:
    if not one.name or any(c in one.name for c in "[]"):
        raise InvalidData(f"{of} must have a name without brackets, got {one.name!r}", field="name")
    if not one.size:
        raise InvalidData(f"{of} {one.name!r} must have 1 entry at least, got 0", field="lower")
    if not (one.scale > 0).all():
        raise InvalidData(f"scale of {one.name!r} must be > 0, got {one.scale}", field="scale")


def _apart(what: str, names: Iterable[str]) -> None:
    """Raise where a name stands twice."""
    known: set[str] = set()
    for name in names:
        if name in known:
            raise InvalidData(f"{what}: {name!r} stands twice", field=what)
        known.add(name)


def _fits(what: str, function: casadi.Function, sizes: Mapping[str, int]) -> None:
    """Raise where an argument or a result of `function` has another size than what is declared."""
    for name, size in sizes.items():
        known = function.name_in()
        have = function.numel_in(name) if name in known else function.numel_out(name)
        if have != size:
            raise InvalidData(
                f"{what}: {name} of the function has {have} entries, {size} are declared",
                field=name,
            )


@dataclass(frozen=True, eq=False)
class Quantity(_Part):
    """A state, a control or a parameter: a vector with bounds.

    Parameters
    ----------
    name : str
        Its name.
    lower, upper : ndarray, shape (size,)
        Bounds at every instant.
    initial_lower, initial_upper, final_lower, final_upper : ndarray, shape (size,)
        Bounds at the two ends of the phase; equal ones fix the value.
    scale : ndarray, shape (size,)
        Typical size of each entry.
    unit : str
        Unit, for people.
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

    def check(self) -> None:
        """Refuse bounds that contradict one another."""
        _sized("a quantity", self)
        for side in ("", "initial_", "final_"):
            low, high = getattr(self, f"{side}lower"), getattr(self, f"{side}upper")
            _ordered(repr(self.name), low, high, f"{side}bounds")

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(self.lower.size)


def entry_names(quantities: Iterable[Quantity]) -> tuple[str, ...]:
    """Return one name an entry: ``"x"`` for a number, ``"q[0]", "q[1]"`` for a vector."""
    names: list[str] = []
    for one in quantities:
        names += [one.name] if one.size == 1 else [f"{one.name}[{k}]" for k in range(one.size)]
    return tuple(names)


@dataclass(frozen=True, eq=False)
class Restriction(_Part):
    """Bounds on an expression: a path or a boundary constraint.

    Parameters
    ----------
    name, equation, unit : str
        In the words of the paper.
    lower, upper : ndarray, shape (size,)
        Bounds; equal ones make an equation.
    scale : ndarray, shape (size,)
        Typical size of the expression.
    """

    name: str = declared(Text())
    equation: str = declared(Text())
    unit: str = declared(Text())
    lower: Floats = declared(_LOW)
    upper: Floats = declared(_HIGH)
    scale: Floats = declared(Array(("size",), lower=0))

    def check(self) -> None:
        """Refuse bounds that contradict one another."""
        _sized("a constraint", self)
        _ordered(repr(self.name), self.lower, self.upper, "bounds")

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(self.lower.size)


@dataclass(frozen=True, eq=False)
class Guess(_Part):
    """A guess of a phase's course, by samples.

    Parameters
    ----------
    start, end : float
        The times guessed for the two ends.
    fractions : ndarray, shape (samples,)
        Places of the samples, from 0 (start) to 1 (end).
    states : ndarray, shape (samples, states)
        Values there; between them linear.
    controls : ndarray, shape (samples, controls)
        The same.
    """

    start: float = declared(Real())
    end: float = declared(Real())
    fractions: Floats = declared(Array(("samples",), lower=0, upper=1))
    states: Floats = declared(Array(("samples", "states")))
    controls: Floats = declared(Array(("samples", "controls")))

    def check(self) -> None:
        """Refuse samples that do not follow one another."""
        if not self.fractions.size or not (np.diff(self.fractions) > 0).all():
            raise InvalidData(
                f"fractions must increase, got {show(self.fractions.tolist())}", field="fractions"
            )
        if not self.end > self.start:
            raise InvalidData(
                f"end of a guess must be after its start {self.start:g}, got {self.end:g}",
                field="end",
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class Phase(_Part):
    """One phase: a stretch of time with its own states, controls and dynamics.

    Parameters
    ----------
    name : str
        Its name.
    states, controls : tuple of Quantity
        What moves, and what moves it.
    start_lower, start_upper, end_lower, end_upper : float
        Bounds of the two times; equal ones fix them.
    time_unit : str
        Unit of time.
    paths : tuple of Restriction
        Constraints at every instant (C ≤ 0 of the paper's eq. 12).
    integrals : int
        Number of integrals over the phase that costs and constraints speak of.
    invariants : tuple of Restriction
        What the dynamics conserve; the bounds are infinite.
    function : casadi.Function
        ``(t, x, u, p) -> (rate, path, integrand, invariant)``: all at one instant.
    guess : Guess
        Where a search starts.
    dynamics_equation : str
        The paper's equation of the dynamics.
    """

    name: str = declared(Text())
    states: tuple[Quantity, ...]
    controls: tuple[Quantity, ...]
    start_lower: float = declared(Real())
    start_upper: float = declared(Real())
    end_lower: float = declared(Real())
    end_upper: float = declared(Real())
    time_unit: str = declared(Text())
    paths: tuple[Restriction, ...]
    integrals: int = declared(Whole(0))
    invariants: tuple[Restriction, ...]
    function: casadi.Function = declared(
        Compiled(("t", "x", "u", "p"), ("rate", "path", "integrand", "invariant"))
    )
    guess: Guess
    dynamics_equation: str = declared(Text())

    def check(self) -> None:
        """Refuse what the function and the guess do not fit."""
        label = f"phase {self.name!r}"
        if not self.states:
            raise InvalidData(f"{label} has no state", field="states")
        _apart(label, (one.name for one in (*self.states, *self.controls)))
        for what in ("paths", "invariants"):
            _apart(f"{what} of {label}", (one.name for one in getattr(self, what)))
        for side in ("start", "end"):
            low, high = getattr(self, f"{side}_lower"), getattr(self, f"{side}_upper")
            _ordered(label, low, high, side)
        if not self.start_lower < self.end_upper:
            raise InvalidData(
                f"time of {label} must go forward, got start {self.start_lower:g}, end "
                f"{self.end_upper:g}",
                field="time",
            )
        sizes = {"t": 1, "x": len(self.state_names), "u": len(self.control_names)}
        results = {
            "rate": sizes["x"],
            "path": sum(one.size for one in self.paths),
            "integrand": self.integrals,
            "invariant": sum(one.size for one in self.invariants),
        }
        _fits(label, self.function, sizes | results)
        for what, wanted in (("states", sizes["x"]), ("controls", sizes["u"])):
            have = getattr(self.guess, what).shape[1]
            if have != wanted:
                raise InvalidData(
                    f"guess of {label} has {have} columns for {wanted} {what}", field="guess"
                )

    @classmethod
    def from_data(cls, data: Any, parts: Mapping[str, Any] | None = None) -> Phase:
        """Return the phase in `data`."""
        read: dict[str, Any] = {}
        if isinstance(data, Mapping):
            kinds: dict[str, type[_Part]] = {"states": Quantity, "controls": Quantity}
            read = _read(data, kinds | {"paths": Restriction, "invariants": Restriction})
            if "guess" in data:
                read["guess"] = Guess.from_data(data["guess"])
        return super().from_data(data, read)

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """One name a state."""
        return entry_names(self.states)

    @cached_property
    def control_names(self) -> tuple[str, ...]:
        """One name a control."""
        return entry_names(self.controls)

    def stacked(self, what: str, field: str) -> Floats:
        """Return `field` of all quantities or restrictions in `what`, such as states, as a vector."""
        parts = [getattr(one, field) for one in getattr(self, what)]
        return np.concatenate([*parts, np.empty(0)])

    @property
    def end_size(self) -> int:
        """Entries that the phase has in the endpoint vector: t0, tf, x0, xf and the integrals."""
        return 2 + 2 * len(self.state_names) + self.integrals


@dataclass(frozen=True, eq=False, kw_only=True)
class Definition(_Part):
    """An optimal control problem in Bolza form, over one or several phases.

    Parameters
    ----------
    phases : tuple of Phase
        The phases.
    parameters : tuple of Quantity
        Constants to be chosen; `initial_lower` = `initial_upper` hold their guess.
    boundaries : tuple of Restriction
        Constraints between the phases' ends (φ = 0 of the paper's eq. 12).
    endpoint : casadi.Function
        ``(e, p) -> (objective, boundary)``, where e stacks t0, tf, x0, xf and the integrals of
        every phase.
    objective_unit : str
        Unit of the objective.
    """

    phases: tuple[Phase, ...]
    parameters: tuple[Quantity, ...]
    boundaries: tuple[Restriction, ...]
    endpoint: casadi.Function = declared(Compiled(("e", "p"), ("objective", "boundary")))
    objective_unit: str = declared(Text())

    def check(self) -> None:
        """Refuse what the functions do not fit."""
        if not self.phases:
            raise InvalidData("phases must hold 1 phase at least, got 0", field="phases")
        for what in ("phases", "parameters", "boundaries"):
            _apart(what, (one.name for one in getattr(self, what)))
        parameters = len(self.parameter_names)
        for phase in self.phases:
            _fits(f"phase {phase.name!r}", phase.function, {"p": parameters})
        _fits(
            "endpoint",
            self.endpoint,
            {
                "e": sum(phase.end_size for phase in self.phases),
                "p": parameters,
                "objective": 1,
                "boundary": sum(one.size for one in self.boundaries),
            },
        )

    @classmethod
    def from_data(cls, data: Any, parts: Mapping[str, Any] | None = None) -> Definition:
        """Return the definition in `data`."""
        read: dict[str, Any] = {}
        if isinstance(data, Mapping):
            kinds: dict[str, type[_Part]] = {"phases": Phase, "parameters": Quantity}
            read = _read(data, kinds | {"boundaries": Restriction})
        return super().from_data(data, read)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """One name a parameter."""
        return entry_names(self.parameters)

    def stacked(self, what: str, field: str) -> Floats:
        """Return `field` of all parameters or boundaries as a vector."""
        parts = [getattr(one, field) for one in getattr(self, what)]
        return np.concatenate([*parts, np.empty(0)])

    @cached_property
    def text(self) -> str:
        """The definition as canonical JSON text, which the digest hashes."""
        return json.dumps(self.to_data(), sort_keys=True, allow_nan=False)


@dataclass(frozen=True)
class Stated(Spec):
    """The definition as a model's field."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Definition:
        return value if isinstance(value, Definition) else Definition.from_data(value)

    def encode(self, value: Definition) -> Any:
        return value.to_data()

    def feed(self, value: Definition) -> Iterable[bytes]:
        yield value.text.encode()
