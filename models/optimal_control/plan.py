"""What solves an optimal control problem: states and controls as piecewise polynomials of time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData, UnknownName
from ..fields import Array, Whole, frozen, required, show
from ..records import Table
from .lagrange import barycentric_weights, differentiation, interpolation

__all__ = ["ControlPlan", "PhasePlan", "Piecewise"]

Floats = NDArray[np.float64]

#: How far outside its interval, relative to the whole length, a time may lie by rounding.
EDGE = 1e-9
#: Times that a grid may have.
MOST_SAMPLES = 10_000_000
#: States that a plan's one line names.
SHOWN = 4


def _short(value: float) -> str:
    """Return a number for people, rounding noise left out."""
    return f"{0.0 if abs(value) < 1e-9 else value:.6g}"


@dataclass(frozen=True, eq=False, repr=False)
class Piecewise:
    """A vector of functions of time, one polynomial in Lagrange form an interval.

    Parameters
    ----------
    knots : ndarray, shape (intervals + 1,)
        Where the intervals begin and end, increasing.
    nodes : tuple of ndarray
        One an interval: distinct positions in [-1, 1], where -1 is its begin and 1 its end.
    values : tuple of ndarray, shape (nodes, size)
        The values at the nodes.
    lower, upper : ndarray, shape (size,), optional
        Where the values saturate: what lies beyond is cut off, as an actuator does it.
    """

    knots: Floats
    nodes: tuple[Floats, ...]
    values: tuple[Floats, ...]
    lower: Floats | None = None
    upper: Floats | None = None

    def __post_init__(self) -> None:
        knots = Array(("knots",)).coerce("knots", self.knots, {})
        if knots.size < 2 or not (np.diff(knots) > 0).all():
            raise InvalidData(f"knots must increase, got {show(knots.tolist())}", field="knots")
        count = knots.size - 1
        for name in ("nodes", "values"):
            if not isinstance(getattr(self, name), list | tuple):
                raise InvalidData(
                    f"{name} must be a list, one entry an interval, got {show(getattr(self, name))}",
                    field=name,
                )
        if len(self.nodes) != count or len(self.values) != count:
            raise InvalidData(
                f"{count} intervals need as many nodes and values, "
                f"got {len(self.nodes)} and {len(self.values)}",
                field="nodes",
            )
        sizes: dict[str, tuple[int, str]] = {}
        nodes: list[Floats] = []
        values: list[Floats] = []
        for k in range(count):
            at = Array(("n",), lower=-1.0, upper=1.0).coerce(f"nodes[{k}]", self.nodes[k], {})
            if at.size == 0 or not (np.diff(at) > 0).all():
                raise InvalidData(f"nodes[{k}] must increase, got {at.tolist()}", field="nodes")
            if k and at.size == nodes[-1].size and (at == nodes[-1]).all():
                at = nodes[-1]  # kept once: a mesh has few different sets
            inner = {**sizes, "nodes": (at.size, f"nodes[{k}]")}
            table = Array(("nodes", "size")).coerce(f"values[{k}]", self.values[k], inner)
            sizes.setdefault("size", (table.shape[1], "values[0]"))
            nodes.append(at)
            values.append(table)
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "nodes", tuple(nodes))
        object.__setattr__(self, "values", tuple(values))
        for name, sign in (("lower", -1), ("upper", 1)):
            if getattr(self, name) is not None:
                bound = Array(("size",), infinity=sign).coerce(name, getattr(self, name), sizes)
                object.__setattr__(self, name, bound)

    def __repr__(self) -> str:
        return f"<Piecewise {self.size} functions, {self.intervals} intervals>"

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(self.values[0].shape[1])

    @property
    def intervals(self) -> int:
        """Number of intervals."""
        return int(self.knots.size) - 1

    @cached_property
    def _weights(self) -> tuple[Floats, ...]:
        known: dict[int, Floats] = {}
        for at in self.nodes:
            if id(at) not in known:
                known[id(at)] = frozen(barycentric_weights(at))
        return tuple(known[id(at)] for at in self.nodes)

    def _cut(self, values: Floats) -> Floats:
        if self.lower is None and self.upper is None:
            return values
        found: Floats = np.clip(values, self.lower, self.upper)
        return found

    def on(self, interval: int, points: ArrayLike) -> Floats:
        """Return the values in `interval` at `points` in [-1, 1], shape (points, size)."""
        matrix = interpolation(self.nodes[interval], points, self._weights[interval])
        return self._cut(matrix @ self.values[interval])

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Floats:
        """Return the values at times `t`, shape (…, size); at a knot, those of the interval after it.

        A derivative is that of the polynomials, saturation left aside.

        Raises
        ------
        InvalidData
            A time lies outside the knots, or is no number; a derivative is no whole number >= 0.
        """
        order = Whole(0).coerce("derivative", derivative, {})
        try:
            times = np.asarray(t, float)
        except Exception:  # whatever a stranger's conversion raises
            raise InvalidData(f"t must be numbers, got {show(t)}", field="t") from None
        flat = times.reshape(-1)
        begin, end = self.knots[0], self.knots[-1]
        slack = EDGE * max(end - begin, abs(begin), abs(end))
        outside = ~((flat >= begin - slack) & (flat <= end + slack))
        if outside.any():
            raise InvalidData(
                f"t must lie in [{begin:g}, {end:g}], got {flat[outside][0]:g}", field="t"
            )
        flat = np.clip(flat, begin, end)
        place = np.clip(np.searchsorted(self.knots, flat, side="right") - 1, 0, self.intervals - 1)
        found = np.empty((flat.size, self.size))
        for k in np.unique(place):
            here = place == k
            low, high = self.knots[k], self.knots[k + 1]
            tau = 2.0 * (flat[here] - low) / (high - low) - 1.0
            if order == 0:
                found[here] = self.on(int(k), tau)
                continue
            table = self.values[k]
            turn = differentiation(self.nodes[k]) * (2.0 / (high - low))
            for _ in range(order):
                table = turn @ table
            found[here] = interpolation(self.nodes[k], tau, self._weights[k]) @ table
        return found.reshape((*times.shape, self.size))

    def to_data(self) -> dict[str, Any]:
        """Return the functions as JSON data."""

        def bound(values: Floats | None, sign: int) -> Any:
            return None if values is None else Array(("n",), infinity=sign).encode(values)

        return {
            "nodes": [at.tolist() for at in self.nodes],
            "values": [table.tolist() for table in self.values],
            "lower": bound(self.lower, -1),
            "upper": bound(self.upper, 1),
        }

    @classmethod
    def from_data(cls, data: Any, knots: Any, what: str) -> Piecewise:
        """Return the functions that :meth:`to_data` wrote; bad data raises ``InvalidData``."""
        keys = {"nodes", "values", "lower", "upper"}
        if not isinstance(data, Mapping) or not {"nodes", "values"} <= set(data) <= keys:
            raise InvalidData(
                f"{what} must be an object with nodes and values (lower, upper), got {show(data)}",
                field=what,
            )
        for key in ("nodes", "values"):
            if not isinstance(data[key], Sequence) or isinstance(data[key], str):
                raise InvalidData(
                    f"{what}: {key} must be a list, one entry an interval, got {show(data[key])}",
                    field=what,
                )
        return cls(
            knots, tuple(data["nodes"]), tuple(data["values"]), data.get("lower"), data.get("upper")
        )


@dataclass(frozen=True, eq=False, repr=False)
class PhasePlan:
    """States and controls over one phase.

    Parameters
    ----------
    name : str
        The phase's name.
    states, controls : Piecewise
        The functions, on the same knots; a control may saturate.
    state_names, control_names : tuple of str
        One a function; entries of a vector are called ``"q[0]"``, ``"q[1]"`` …
    costates : Piecewise, optional
        Multipliers of the dynamics (λ), one a state, where a transcription gave them.
    """

    name: str
    states: Piecewise
    controls: Piecewise
    state_names: tuple[str, ...]
    control_names: tuple[str, ...]
    costates: Piecewise | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InvalidData(f"name must be a string, got {show(self.name)}", field="name")
        for what in ("states", "controls", "costates"):
            if what != "costates" or self.costates is not None:
                required(what, getattr(self, what), Piecewise)
        for label in ("state_names", "control_names"):
            names = getattr(self, label)
            if not isinstance(names, list | tuple) or not all(isinstance(n, str) for n in names):
                raise InvalidData(f"{label} must hold strings, got {show(names)}", field=label)
            object.__setattr__(self, label, tuple(names))
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
        """Time at which the phase begins (t0)."""
        return float(self.states.knots[0])

    @property
    def end(self) -> float:
        """Time at which it ends (tf)."""
        return float(self.states.knots[-1])

    @property
    def duration(self) -> float:
        """Its length in time."""
        return self.end - self.start

    def grid(self, count: int = 201) -> Floats:
        """Return `count` even times from begin to end."""
        number = Whole(2, MOST_SAMPLES).coerce("count", count, {})
        return np.linspace(self.start, self.end, number)

    def __getitem__(self, name: str) -> Signal:
        """Return the state or control called `name` as a function of time."""
        for part, names in (
            (self.states, self.state_names),
            (self.controls, self.control_names),
        ):
            if not isinstance(name, str):
                break
            if name in names:
                return Signal(part, (names.index(name),), scalar=True)
            entries = tuple(k for k, one in enumerate(names) if one.startswith(f"{name}["))
            if entries:
                return Signal(part, entries, scalar=False)
        raise UnknownName(
            f"state or control of phase {self.name!r}",
            name,
            [*self.state_names, *self.control_names],
        )

    def to_data(self) -> dict[str, Any]:
        """Return the phase as JSON data."""
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
        """Return the phase that :meth:`to_data` wrote."""
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
    """One state or control of a plan as a function of time.

    Parameters
    ----------
    source : Piecewise
        Where it stands.
    entries : tuple of int
        Its columns there.
    scalar : bool
        Whether its values are numbers, not vectors.
    """

    source: Piecewise
    entries: tuple[int, ...]
    scalar: bool

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Floats:
        """Return the values at times `t`, of its shape, with one more axis for a vector."""
        found = self.source(t, derivative)[..., list(self.entries)]
        return found[..., 0] if self.scalar else found


@dataclass(frozen=True, eq=False, repr=False)
class ControlPlan:
    """States, controls, times and parameters that answer an optimal control problem.

    ``plan["x"](t)`` is a state or control of a plan with one phase; with several, ask the phase:
    ``plan.phases[1]["x"](t)`` or ``plan.phase("coast")["x"](t)``.

    Parameters
    ----------
    phases : tuple of PhasePlan
        In the order of the problem.
    parameters : mapping of str to ndarray
        Values of the parameters.
    """

    phases: tuple[PhasePlan, ...]
    parameters: Mapping[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.phases, list | tuple):
            raise InvalidData(
                f"phases must be a list of PhasePlan, got {show(self.phases)}", field="phases"
            )
        object.__setattr__(self, "phases", tuple(self.phases))
        values = {}
        for name, value in Table().coerce("parameters", self.parameters, {}).items():
            single = [value] if np.isscalar(value) else value
            values[name] = Array(("size",)).coerce(f"parameters[{name!r}]", single, {})
        object.__setattr__(self, "parameters", values)
        if not self.phases or not all(isinstance(one, PhasePlan) for one in self.phases):
            raise InvalidData(
                f"phases of a plan must be 1 PhasePlan at least, got {show(self.phases)}",
                field="phases",
            )

    def __repr__(self) -> str:
        return f"<ControlPlan {self}>"

    def __str__(self) -> str:
        parts = []
        for one in self.phases:
            ends = [
                f"{name} {_short(begin)} → {_short(end)}"
                for name, begin, end in zip(
                    one.state_names, one.states(one.start), one.states(one.end), strict=True
                )
            ]
            if len(ends) > SHOWN:
                ends = [*ends[:SHOWN], "…"]
            parts.append(
                f"{one.name}: t {_short(one.start)} → {one.end:.8g}, {', '.join(ends)} "
                f"({one.states.intervals} intervals)"
            )
        parts += [
            f"{name} = {', '.join(map(_short, value))}" for name, value in self.parameters.items()
        ]
        return "; ".join(parts)

    def phase(self, name: str) -> PhasePlan:
        """Return the phase called `name`."""
        for one in self.phases:
            if isinstance(name, str) and one.name == name:
                return one
        raise UnknownName("phase", name, [one.name for one in self.phases])

    @property
    def start(self) -> float:
        """Time at which the first phase begins."""
        return self.phases[0].start

    @property
    def end(self) -> float:
        """Time at which the last phase ends."""
        return self.phases[-1].end

    def grid(self, count: int = 201) -> Floats:
        """Return `count` even times over a plan's only phase."""
        return self._only("grid").grid(count)

    def __getitem__(self, name: str) -> Signal:
        """Return a state or control of a plan's only phase as a function of time."""
        return self._only(repr(name))[name]

    def __iter__(self) -> Iterator[PhasePlan]:
        return iter(self.phases)

    def _only(self, what: str) -> PhasePlan:
        if len(self.phases) > 1:
            names = ", ".join(repr(one.name) for one in self.phases)
            raise InvalidData(
                f"{what}: the plan has {len(self.phases)} phases ({names}); ask one of them",
                field="phases",
            )
        return self.phases[0]

    def to_data(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return {
            "phases": [one.to_data() for one in self.phases],
            "parameters": {name: value.tolist() for name, value in self.parameters.items()},
        }

    @classmethod
    def from_data(cls, data: Any) -> ControlPlan:
        """Return the plan that :meth:`to_data` wrote; bad data raises ``InvalidData``."""
        if not isinstance(data, Mapping) or not {"phases"} <= set(data) <= {"phases", "parameters"}:
            raise InvalidData(
                f"a plan must be an object with phases and parameters, got {show(data)}",
                field="plan",
            )
        if not isinstance(data["phases"], Sequence) or isinstance(data["phases"], str):
            raise InvalidData(f"phases must be a list, got {show(data['phases'])}", field="phases")
        parameters = data.get("parameters", {})
        if not isinstance(parameters, Mapping):
            raise InvalidData(
                f"parameters must be an object, got {show(parameters)}", field="parameters"
            )
        values = {
            str(name): Array(("size",)).coerce(f"parameters[{name!r}]", value, {})
            for name, value in parameters.items()
        }
        return cls(tuple(PhasePlan.from_data(one) for one in data["phases"]), values)
