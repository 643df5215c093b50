"""Plans of optimal control problems: states and controls as piecewise polynomials of time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData, UnknownName
from ..declaration import Nested, Plan
from ..fields import (
    Array,
    Optional,
    Spec,
    Text,
    Whole,
    declared as field_of,
    frozen,
    required,
    show,
)
from ..records import Several, Table
from .definition import entry_slices
from .piecewise import Piecewise

if TYPE_CHECKING:
    from .definition import Definition, Phase
    from .simulation import Simulation

__all__ = ["ControlPlan", "PhasePlan", "Piecewise"]

Floats = NDArray[np.float64]

#: Largest number of times of a grid.
MOST_SAMPLES = 10_000_000
#: Number of states in the one-line description of a plan.
SHOWN = 4


def _short(value: float) -> str:
    """Return a number for display, with rounding noise as 0."""
    return f"{0.0 if abs(value) < 1e-9 else value:.6g}"


class _Functions(Spec):
    """Piecewise polynomials of time."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Piecewise:
        return required(name, value, Piecewise)

    def encode(self, value: Piecewise) -> Any:
        return value.to_data()

    def feed(self, value: Piecewise) -> Iterable[bytes]:
        yield repr((value.knots.tolist(), value.to_data())).encode()

    def refreeze(self, value: Piecewise) -> Piecewise:
        return replace(value)


class _Parameters(Spec):
    """Values of the parameters by name; a single number is a vector of one entry."""

    _values = Array(("size",))

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> dict[str, Floats]:
        return {
            key: self._values.coerce(f"{name}[{key!r}]", [v] if np.isscalar(v) else v, {})
            for key, v in Table().coerce(name, value, {}).items()
        }

    def encode(self, value: dict[str, Floats]) -> Any:
        return {name: entries.tolist() for name, entries in value.items()}

    def feed(self, value: dict[str, Floats]) -> Iterable[bytes]:
        yield repr(sorted(self.encode(value).items())).encode()

    def refreeze(self, value: dict[str, Floats]) -> dict[str, Floats]:
        return {name: frozen(entries) for name, entries in value.items()}


@dataclass(frozen=True, eq=False, repr=False)
class PhasePlan(Plan):
    """States and controls over one phase.

    Parameters
    ----------
    name : str
        Name of the phase.
    states, controls : Piecewise
        Functions with the same knots; controls may saturate.
    state_names, control_names : tuple of str
        Names of the functions; entries of a vector are ``"q[0]"``, ``"q[1]"`` …
    costates : Piecewise, optional
        Multipliers of the dynamics (λ), one per state; None if the transcription gives none.
    declared : Phase, optional
        Declaration of the phase, which makes outputs and path constraints available as functions of
        time. It is not stored; :meth:`OptimalControlProblem.attach` sets it.
    values : ndarray, shape (parameters,), optional
        Values of the parameters, used with the declaration.
    """

    name: str = field_of(Text())
    states: Piecewise = field_of(_Functions())
    controls: Piecewise = field_of(_Functions())
    state_names: tuple[str, ...] = field_of(Several(Text()))
    control_names: tuple[str, ...] = field_of(Several(Text()))
    costates: Piecewise | None = field_of(Optional(_Functions()), default=None)
    declared: Phase | None = None
    values: Floats | None = None

    def check(self) -> None:
        """Reject functions with other knots, or another number of columns than names."""
        for what, part, names in (
            ("states", self.states, self.state_names),
            ("controls", self.controls, self.control_names),
            ("costates", self.costates, self.state_names),
        ):
            if part is not None and part.size != len(names):
                raise InvalidData(
                    f"phase {self.name!r}: {what} has {part.size} columns for {len(names)} names",
                    field=what,
                )
            if part is not None and not np.array_equal(part.knots, self.states.knots):
                raise InvalidData(
                    f"phase {self.name!r}: {what} must have the knots of states", field=what
                )

    def __repr__(self) -> str:
        names = ", ".join([*self.state_names, *self.control_names])
        return (
            f"<PhasePlan {self.name!r} from {self.start:.6g} to {self.end:.6g}, "
            f"{self.states.intervals} intervals: {names}>"
        )

    @property
    def start(self) -> float:
        """Start time of the phase (t0)."""
        return float(self.states.knots[0])

    @property
    def end(self) -> float:
        """End time of the phase (tf)."""
        return float(self.states.knots[-1])

    @property
    def duration(self) -> float:
        """Duration of the phase."""
        return self.end - self.start

    def grid(self, count: int = 201) -> Floats:
        """Return `count` equidistant times from start to end."""
        number = Whole(2, MOST_SAMPLES).coerce("count", count, {})
        return np.linspace(self.start, self.end, number)

    def __getitem__(self, name: str) -> Signal:
        """Return the signal called `name` as a function of time.

        Parameters
        ----------
        name : str
            Name of a state or control, or of an output, path constraint or invariant of the
            declaration.

        Returns
        -------
        Signal
            Function of time.

        Raises
        ------
        UnknownName
            No signal has this name, or the plan lacks its declaration, see
            :meth:`OptimalControlProblem.attach`.
        """
        known = [*self.state_names, *self.control_names]
        parts = (self.states, self.state_names), (self.controls, self.control_names)
        for part, names in parts if isinstance(name, str) else ():
            if name in names:
                return Signal(part, (names.index(name),), scalar=True)
            entries = tuple(k for k, item in enumerate(names) if item.startswith(f"{name}["))
            if entries:
                return Signal(part, entries, scalar=False)
        if self.declared is None:
            kind = "state or control (model.attach(plan) gives outputs and path constraints too)"
            raise UnknownName(f"{kind} of phase {self.name!r}", name, known)
        for item, places in entry_slices(self.declared.observed):
            if isinstance(name, str) and item.name == name:
                entries = tuple(range(places.start, places.stop))
                return Signal(self.observed, entries, scalar=item.size == 1)
        known += [item.name for item in self.declared.observed]
        raise UnknownName(
            f"state or control, constraint or output, of phase {self.name!r}", name, known
        )

    def observed(self, t: ArrayLike, derivative: int = 0) -> Floats:
        """Return path constraints, invariants and outputs at times `t`, shape (…, entries).

        Raises
        ------
        InvalidData
            The plan lacks its declaration, or `derivative` is not 0.
        """
        if self.declared is None or self.values is None:
            raise InvalidData(
                f"phase {self.name!r} of the plan does not know its declaration: "
                "model.attach(plan) returns a plan that does",
                field="plan",
            )
        if derivative:
            raise InvalidData(
                f"derivative of a declared expression must be 0, got {derivative}",
                field="derivative",
            )
        x, u = self.states(t), self.controls(t)
        times = np.asarray(t, float)
        parts = self.declared.observe(
            times.reshape(-1), x.reshape(-1, x.shape[-1]), u.reshape(-1, u.shape[-1]), self.values
        )
        return np.concatenate(parts, axis=1).reshape((*times.shape, -1))

    def simulate(self, **options: Any) -> Simulation:
        """Return the motion with this control under disturbances."""
        from .simulation import simulate

        return simulate(self, **options)

    def data(self) -> dict[str, Any]:
        """Return the phase as JSON data, in which all functions share the knots."""
        return {
            "name": self.name,
            "knots": self.states.knots.tolist(),
            "state_names": list(self.state_names),
            "control_names": list(self.control_names),
            "states": self.states.to_data(),
            "controls": self.controls.to_data(),
            "costates": None if self.costates is None else self.costates.to_data(),
        }

    @classmethod
    def from_data(cls, data: Any) -> PhasePlan:
        """Return the phase that :meth:`data` wrote."""
        keys = {"name", "knots", "state_names", "control_names", "states", "controls"}
        if not isinstance(data, Mapping) or not keys <= set(data) <= keys | {"costates"}:
            raise InvalidData(
                f"a phase of a plan has the keys {', '.join(sorted(keys))}, got {show(data)}",
                field="phases",
            )
        knots = data["knots"]
        costates = data.get("costates")
        return cls(
            data["name"],
            Piecewise.from_data(data["states"], knots, "states"),
            Piecewise.from_data(data["controls"], knots, "controls"),
            data["state_names"],
            data["control_names"],
            None if costates is None else Piecewise.from_data(costates, knots, "costates"),
        )


@dataclass(frozen=True, eq=False)
class Signal:
    """State, control or declared expression of a plan as a function of time.

    Parameters
    ----------
    source : callable
        Function of times and the order of a derivative, such as a :class:`Piecewise`.
    entries : tuple of int
        Columns of the signal in the values of `source`.
    scalar : bool
        Whether the values are numbers rather than vectors.
    """

    source: Callable[[ArrayLike, int], Floats]
    entries: tuple[int, ...]
    scalar: bool

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Floats:
        """Return the values at times `t`, with the shape of `t` and an additional axis for a vector."""
        values = self.source(t, derivative)[..., list(self.entries)]
        return values[..., 0] if self.scalar else values


@dataclass(frozen=True, eq=False, repr=False)
class ControlPlan(Plan):
    """Plan of an optimal control problem: states, controls, times and parameters.

    ``plan["x"](t)`` evaluates a state or control of a plan with one phase. With several phases, use
    ``plan.phases[1]["x"](t)`` or ``plan.phase("coast")["x"](t)``.

    Parameters
    ----------
    phases : tuple of PhasePlan
        Phases, in the order of the problem.
    parameters : mapping of str to ndarray
        Values of the parameters.
    """

    phases: tuple[PhasePlan, ...] = field_of(Several(Nested(PhasePlan)))
    parameters: Mapping[str, Floats] = field_of(_Parameters(), default_factory=dict)

    def check(self) -> None:
        """Reject plans without a phase."""
        if not self.phases:
            raise InvalidData(
                "phases of a plan must be 1 PhasePlan at least, got ()", field="phases"
            )

    def __repr__(self) -> str:
        return f"<ControlPlan {self}>"

    def __str__(self) -> str:
        parts = []
        for part in self.phases:
            values = (part.states(t) for t in (part.start, part.end))
            moves = zip(part.state_names, *values, strict=True)
            ends = [f"{name} {_short(begin)} → {_short(end)}" for name, begin, end in moves]
            if len(ends) > SHOWN:
                ends = [*ends[:SHOWN], "…"]
            parts.append(
                f"{part.name}: t {_short(part.start)} → {part.end:.8g}, {', '.join(ends)} "
                f"({part.states.intervals} intervals)"
            )
        parts += [
            f"{name} = {', '.join(map(_short, value))}" for name, value in self.parameters.items()
        ]
        return "; ".join(parts)

    def phase(self, name: str) -> PhasePlan:
        """Return the phase called `name`, or raise ``UnknownName``."""
        for part in self.phases:
            if isinstance(name, str) and part.name == name:
                return part
        raise UnknownName("phase", name, [part.name for part in self.phases])

    @property
    def start(self) -> float:
        """Start time of the first phase."""
        return self.phases[0].start

    @property
    def end(self) -> float:
        """End time of the last phase."""
        return self.phases[-1].end

    def grid(self, count: int = 201) -> Floats:
        """Return `count` equidistant times over the phase of a plan with one phase."""
        return self._only("grid").grid(count)

    def __getitem__(self, name: str) -> Signal:
        """Return a signal of a plan with one phase as a function of time."""
        return self._only(repr(name))[name]

    def attached(self, definition: Definition) -> ControlPlan:
        """Return the plan with the declaration of each phase, which must fit it."""
        parameters = [self.parameters[parameter.name] for parameter in definition.parameters]
        values = frozen(np.concatenate([*parameters, np.empty(0)]))
        pairs = zip(self.phases, definition.phases, strict=True)
        phases = (replace(part, declared=phase, values=values) for part, phase in pairs)
        return replace(self, phases=tuple(phases))

    def simulate(self, **options: Any) -> Simulation:
        """Return the simulation of a plan with one phase; see :meth:`PhasePlan.simulate`."""
        return self._only("simulate").simulate(**options)

    def __iter__(self) -> Iterator[PhasePlan]:
        return iter(self.phases)

    def _only(self, what: str) -> PhasePlan:
        if len(self.phases) > 1:
            names = ", ".join(repr(part.name) for part in self.phases)
            raise InvalidData(
                f"{what}: the plan has {len(self.phases)} phases ({names}); ask one of them",
                field="phases",
            )
        return self.phases[0]
