"""Definition of an optimal control problem: bounds, names and functions.

The symbols of the declaration are not part of it. A definition is stored, sent to other processes,
digested, verified and transcribed.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, suggestion
from ..declaration import Declared, Listed, Nested
from ..fields import Array, Optional, Real, Text, Whole, declared, frozen, show
from ..programs.compiled import Compiled, canonical_text
from ..records import Several
from .quantities import (
    SIDES,
    Quantity,
    Restriction,
    check_algebraic,
    check_order,
    entry_names,
    entry_slices,
    entry_units,
    stacked,
)

if TYPE_CHECKING:
    import casadi

__all__ = [
    "SIDES", "Definition", "Guess", "Phase", "Quantity", "Restriction", "check_algebraic",
    "check_order", "entry_names", "entry_slices", "entry_units", "stacked",
]  # fmt: skip

Floats = NDArray[np.float64]


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


@dataclass(frozen=True, eq=False)
class Guess(Declared):
    """Samples of the guessed states and controls of a phase, interpolated linearly.

    `start` and `end` are the guessed times, and `fractions` the increasing positions of the samples from 0 to
    1. Tables have the shape (samples, entries).
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
        return stacked(getattr(self, what), field)

    def bounds(self, what: str, side: str = "") -> tuple[Floats, Floats]:
        """Return lower and upper bounds of all items of `what`; `side` may be ``"initial"`` or ``"final"``."""
        low, high = (f"{side}_{edge}".lstrip("_") for edge in ("lower", "upper"))
        return self.stacked(what, low), self.stacked(what, high)


@dataclass(frozen=True, eq=False, kw_only=True)
class Phase(_Stacked):
    """Phase: an interval of time with its own states, controls and dynamics.

    Equal bounds of the start or end time fix it. `paths` are constraints at every instant (C ≤ 0 of the
    paper's eq. 13). `invariants`, which the dynamics conserve, and `outputs`, which are shown, have infinite
    bounds. `integrals` is the number of integrals over the phase in costs and constraints. `function` is
    ``(t, x, u, p) -> (rate, path, integrand, invariant)`` at one instant, and `outputs_function`
    ``(t, x, u, p) -> output``, None without outputs. `instants` are the interior instants whose states occur
    in costs and boundary constraints, as increasing fractions of the phase. `dynamics_equation` is the number
    in the paper.
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
        """Return path constraints, invariants and outputs at times `t`, each of shape (points, entries)."""
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
    """Optimal control problem in Bolza form, over one or several phases in order.

    `parameters` are constants to be optimised or given, guessed at `initial_lower` = `initial_upper`.
    `boundaries` are constraints between the ends of the phases (φ = 0 of the paper's eq. 13). `endpoint` is
    ``(e, p) -> (objective, boundary)`` with the endpoint vector e, which stacks t0, tf, x0, xf, the integrals
    and the states at interior instants of every phase. `objective_scale` is the typical size of the
    objective; 0 to measure it along the guess and each plan.
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
        return frozen(np.concatenate([np.arange(size) >= size - inner for size, inner in sizes]))

    def given(self, values: Mapping[str, Any]) -> Definition:
        """Return the definition with other values of its data, by name; unknown names and other sizes raise."""
        data = {parameter.name: parameter for parameter in self.parameters if parameter.given}
        for name in values:
            if name not in data:
                known = ", ".join(map(repr, data)) or "none"
                raise InvalidData(
                    f"{name!r} is no data of the problem; {suggestion(name, list(data))}"
                    f"its data: {known}",
                    field=str(name),
                )
        parameters = (p.holding(values[p.name]) if p.name in values else p for p in self.parameters)
        return replace(self, parameters=tuple(parameters))

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
