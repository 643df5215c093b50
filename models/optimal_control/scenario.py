"""One control for several realisations of the data: scenarios with shared controls, times and parameters.

The scenarios are declared as one problem whose phases have the states of all scenarios. Every
transcription, picture, file and verification of single problems therefore applies. States, constraints
and integrals that are the same in all scenarios are declared once: copies would make the equations of the
program dependent.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InvalidData
from ..conversion import as_model
from ..fields import Array, required, show
from .definition import SIDES, Definition, Phase, Quantity, Restriction, entry_slices
from .piecewise import Piecewise
from .plan import ControlPlan, PhasePlan

__all__ = ["scenario_plan", "scenarios"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Flags = NDArray[np.bool_]

OBJECTIVES = ("expectation", "worst")
#: Name of the parameter that bounds the objectives of all scenarios.
WORST = "worst case"


def scenarios(
    problem: Any,
    data: Sequence[Mapping[str, ArrayLike]] | Mapping[str, Mapping[str, ArrayLike]],
    *,
    weights: ArrayLike | None = None,
    objective: str = "expectation",
) -> Any:
    """Return the problem of one control that satisfies all constraints for each realisation of the data.

    Controls, times and optimised parameters are shared. Each scenario has its own copy of the states that
    depend on the data that differ: state ``x`` of the scenario ``light`` is called ``x (light)``.
    :func:`scenario_plan` returns the plan of one scenario.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem with data declared by ``ocp.data(…)``.
    data : sequence of mapping, or mapping of str to mapping
        Values of the data by name, per scenario. Scenarios of a sequence are called ``1``, ``2`` ….
        Data that a scenario omits have their declared values.
    weights : array_like, shape (scenarios,), optional
        Weights of the expectation, at least 0, relative to their sum; equal by default.
    objective : {"expectation", "worst"}
        Minimise the weighted mean of the scenarios' objectives, or the largest of them. The largest one
        is bounded by the parameter ``worst case``.

    Returns
    -------
    OptimalControlProblem
        Problem with the scenarios as its states. Their data remain data of the problem, such as
        ``mass (light)``.

    Raises
    ------
    InvalidData
        A name is not data of the problem, a value has another size or is not finite, or `weights` or
        `objective` is not allowed.

    Notes
    -----
    A free initial value of a state with copies may differ between scenarios. To share it, declare a
    parameter and ``initial=parameter``. An equation at the final time holds in every scenario, which one
    control can often not achieve; use a range.

    Examples
    --------
    >>> import crosstrack as ct
    >>> from crosstrack.models import OptimalControlProblem
    >>> ocp = OptimalControlProblem("push")
    >>> mass = ocp.data("mass", value=1.0)
    >>> phase = ocp.phase(time=(0, 1))
    >>> v, force = phase.state("v", initial=0), phase.control("force", lower=-2, upper=2)
    >>> phase.dynamics({v: force / mass})
    >>> ocp.minimise((phase.final(v) - 1) ** 2 + phase.integral(force**2))
    >>> robust = ocp.scenarios({"light": {"mass": 0.8}, "heavy": {"mass": 1.25}})
    >>> plan = ct.solve(robust, seed=0).plan
    >>> [round(float(plan[name](1.0)), 4) for name in ("v (light)", "v (heavy)")]
    [0.6098, 0.3902]
    """
    model = as_model(problem)
    definition = required("problem", getattr(model, "definition", problem), Definition)
    if isinstance(data, list | tuple):
        data = {str(k): item for k, item in enumerate(data, 1)}
    if not (isinstance(data, Mapping) and data) or not all(
        isinstance(item, Mapping) for item in data.values()
    ):
        raise InvalidData(
            f"data must be one mapping of names to values per scenario, got {show(data)}",
            field="data",
        )
    if objective not in OBJECTIVES:
        raise InvalidData(
            f"objective must be one of {', '.join(map(repr, OBJECTIVES))}, got {show(objective)}",
            field="objective",
        )
    if weights is not None and objective == "worst":
        raise InvalidData(
            "weights are those of the expectation: omit them for objective='worst'", field="weights"
        )
    sizes = {"scenarios": (len(data), "data")}
    given = np.ones(len(data)) if weights is None else weights
    shares = Array(("scenarios",), lower=0.0).coerce("weights", given, sizes)
    if not shares.any():
        raise InvalidData(
            f"weights must have a positive entry, got {show(weights)}", field="weights"
        )
    algebraic = [x.name for phase in definition.phases for x in phase.controls if x.algebraic]
    if algebraic:
        raise InvalidData(
            "problem must have no algebraic variables, because scenarios share controls, got "
            f"{', '.join(map(repr, algebraic))}: eliminate them, or declare them as states",
            field="problem",
        )
    known = [definition.given(values).parameters for values in data.values()]
    stack = _Stack(definition, tuple(map(str, data)), tuple(known), objective == "worst")
    name = f"{model.name} in {len(data)} scenarios"
    make: Any = type(model)
    return make(name, definition=stack.define(shares / shares.sum()))


def scenario_plan(problem: Any, plan: ControlPlan, scenario: str) -> ControlPlan:
    """Return the plan of one scenario, for the problem that :func:`scenarios` was called with.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem without scenarios.
    plan : ControlPlan
        Plan of the problem with scenarios.
    scenario : str
        Name of the scenario.

    Returns
    -------
    ControlPlan
        Plan without costates, for ``problem.given(…).verify`` with the data of the scenario.

    Raises
    ------
    InvalidData
        The plan has no such scenario.
    """
    definition = required("problem", getattr(problem, "definition", problem), Definition)
    required("plan", plan, ControlPlan)

    def find(name: str, known: Sequence[str]) -> str:
        base, bracket, entry = name.partition("[")
        own = f"{base} ({scenario}){bracket}{entry}"
        result = own if own in known else name
        if result not in known:
            raise InvalidData(
                f"the plan must have {own!r} or {name!r} for scenario {scenario!r}, got "
                f"{', '.join(map(repr, known))}",
                field="scenario",
            )
        return result

    parts = []
    for phase in definition.phases:
        part = plan.phase(phase.name)
        columns = [
            part.state_names.index(find(name, part.state_names)) for name in phase.state_names
        ]
        old = part.states
        states = Piecewise(old.knots, old.nodes, tuple(table[:, columns] for table in old.values))
        names = phase.state_names, phase.control_names
        parts.append(PhasePlan(phase.name, states, part.controls, *names))
    known = list(plan.parameters)
    values = {p.name: plan.parameters[find(p.name, known)] for p in definition.parameters}
    return ControlPlan(tuple(parts), values).attached(definition)


def _depends(function: casadi.Function, result: int, argument: str, flags: Flags) -> Flags:
    """Return the entries of a result that depend on the marked entries of an argument."""
    pattern = function.jac_sparsity(result, function.index_in(argument))
    rows, columns = map(np.array, pattern.get_triplet())
    marked = np.zeros(function.size1_out(result), bool)
    if rows.size:
        marked[rows[flags[columns]]] = True
    return marked


def _widen(items: Iterable[Any], flags: Flags) -> Flags:
    """Return `flags` with all entries of an item marked if one is."""
    result = flags.copy()
    for _, places in entry_slices(items):
        result[places] = flags[places].any()
    return result


@dataclass(frozen=True, eq=False)
class _Copies:
    """Entries of a vector with one copy per scenario of the marked ones.

    `places[k]` are the new entries that the vector of scenario k consists of.
    """

    places: Whole

    @cached_property
    def source(self) -> Whole:
        """Scenario and entry of each new entry, shape (2, new entries)."""
        # A shared entry is taken from the first scenario.
        _, first = np.unique(self.places, return_index=True)
        return np.stack(np.unravel_index(first, self.places.shape))

    @property
    def size(self) -> int:
        """Number of new entries."""
        return int(self.source.shape[1])

    def gather(self, vectors: Sequence[Any]) -> Any:
        """Return the new vector of the vectors of all scenarios, as CasADi expressions."""
        count = self.places.shape[1]
        chosen = (self.source[0] * count + self.source[1]).tolist()
        return casadi.densify(casadi.vertcat(*vectors))[chosen] if chosen else vectors[0]


def _copies(sizes: Sequence[int], marked: Sequence[bool], count: int) -> _Copies:
    """Return the copies of items with these sizes; the copies of an item follow one another."""
    columns, start = [np.zeros((count, 0), np.int64)], 0
    for size, split in zip(sizes, marked, strict=True):
        shift = np.arange(count)[:, None] * size * split
        columns.append(start + shift + np.arange(size))
        start += size * (count if split else 1)
    return _Copies(np.concatenate(columns, axis=1))


@dataclass(frozen=True, eq=False)
class _Stack:
    """Definition with scenarios: their names, and the values of all parameters per scenario."""

    definition: Definition
    labels: tuple[str, ...]
    values: tuple[tuple[Quantity, ...], ...]
    worst: bool

    @property
    def count(self) -> int:
        """Number of scenarios."""
        return len(self.labels)

    @cached_property
    def varied(self) -> Flags:
        """Entries of the parameters that differ between scenarios, with all entries of their item."""
        values = np.array([np.concatenate([*(q.lower for q in s), []]) for s in self.values])
        return _widen(self.definition.parameters, (values != values[0]).any(axis=0))

    @cached_property
    def differing(self) -> tuple[list[Flags], list[Flags], Flags]:
        """States and integrals of each phase, and endpoint entries, that differ between scenarios."""
        definition = self.definition
        equal = np.equal(*definition.bounds("boundaries"))
        row, column = map(np.array, definition.endpoint.jac_sparsity(1, 0).get_triplet())
        states = [np.zeros(len(phase.state_names), bool) for phase in definition.phases]
        while True:
            before = sum(int(flags.sum()) for flags in states)
            integrals: list[Flags] = []
            ends, starts = [np.zeros(0, bool)], []
            for phase, flags in zip(definition.phases, states, strict=True):
                flags |= self._differ(phase.function, "rate", flags)
                flags[:] = _widen(phase.states, flags)
                integrals.append(self._differ(phase.function, "integrand", flags))
                starts.append(sum(map(len, ends)) + 2)
                ends += [np.zeros(2, bool), flags, flags, integrals[-1]]
                ends += [flags] * len(phase.instants)
            moved = np.concatenate(ends)
            # An equation with such an entry gives each scenario its own initial value.
            equations = np.flatnonzero(equal & self._differ(definition.endpoint, "boundary", moved))
            for flags, start in zip(states, starts, strict=True):
                at = column[np.isin(row, equations)] - start
                flags[at[(at >= 0) & (at < flags.size)].astype(int)] = True
            if sum(int(flags.sum()) for flags in states) == before:
                return states, integrals, moved

    def _differ(self, function: casadi.Function, result: str, variables: Flags) -> Flags:
        """Return the entries of a result that differ between scenarios, if these variables do."""
        number = function.index_out(result)
        name = "e" if "e" in function.name_in() else "x"
        by_data = _depends(function, number, "p", self.varied)
        return by_data | _depends(function, number, name, variables)

    def _items(self, items: Sequence[Any], flags: Flags) -> tuple[tuple[Any, ...], _Copies]:
        """Return the items with one renamed copy per scenario of the marked ones, and the copies."""
        marked = [bool(flags[places].any()) for _, places in entry_slices(items)]
        result: list[Any] = []
        for item, split in zip(items, marked, strict=True):
            copies = [replace(item, name=f"{item.name} ({label})") for label in self.labels]
            result += copies if split else [item]
        return tuple(result), _copies([item.size for item in items], marked, self.count)

    def _function(
        self, function: casadi.Function, x: _Copies, results: Mapping[str, _Copies]
    ) -> casadi.Function:
        """Return the function of one instant for the states of all scenarios."""
        kind: Any = casadi.SX if function.is_a("SXFunction") else casadi.MX
        u = kind.sym("u", function.size1_in("u"))
        t, states, p = kind.sym("t"), kind.sym("x", x.size), kind.sym("p", self.parameters[2])
        pairs = zip(x.places.tolist(), self.parameters[1].places.tolist(), strict=True)
        parts = [function.call([t, states[at], u, p[of]]) for at, of in pairs]
        columns = zip(results.values(), zip(*parts, strict=True), strict=True)
        stacked = [copies.gather(vectors) for copies, vectors in columns]
        inputs = function.name_in()
        return casadi.Function(function.name(), [t, states, u, p], stacked, inputs, list(results))

    @cached_property
    def parameters(self) -> tuple[tuple[Quantity, ...], _Copies, int]:
        """Parameters with the data of all scenarios, their copies, and the number of entries.

        The number includes the bound of the objectives for the worst case.
        """
        _, copies = self._items(self.definition.parameters, self.varied)
        items: list[Quantity] = []
        for number, (item, places) in enumerate(entry_slices(self.definition.parameters)):
            values = [scenario[number] for scenario in self.values]
            names = [f"{item.name} ({label})" for label in self.labels]
            named = [replace(value, name=name) for value, name in zip(values, names, strict=True)]
            items += named if self.varied[places].any() else values[:1]
        return tuple(items), copies, copies.size + self.bounded

    @cached_property
    def bounded(self) -> bool:
        """Whether a parameter bounds the objectives: not if they are equal in all scenarios."""
        return self.worst and bool(
            self._differ(self.definition.endpoint, "objective", self.differing[2]).any()
        )

    def _phase(self, number: int) -> tuple[Phase, _Copies, _Copies]:
        """Return the phase with all scenarios, and the copies of its states and integrals."""
        phase = self.definition.phases[number]
        flags = self.differing[0][number]
        states, x = self._items(phase.states, flags)
        marked = self.differing[1][number].tolist()
        integrals = _copies([1] * len(marked), marked, self.count)
        changes: dict[str, Any] = {}
        copies = {"rate": x, "integrand": integrals}
        for field, result in (("paths", "path"), ("invariants", "invariant")):
            differ = self._differ(phase.function, result, flags)
            changes[field], copies[result] = self._items(getattr(phase, field), differ)
        order = {name: copies[name] for name in phase.function.name_out()}
        if phase.outputs_function is not None:
            differ = self._differ(phase.outputs_function, "output", flags)
            changes["outputs"], output = self._items(phase.outputs, differ)
            changes["outputs_function"] = self._function(
                phase.outputs_function, x, {"output": output}
            )
        guess = replace(phase.guess, states=phase.guess.states[:, x.source[1]])
        stacked = replace(
            phase, states=states, integrals=integrals.size, guess=guess,
            function=self._function(phase.function, x, order), **changes,
        )  # fmt: skip
        return stacked, x, integrals

    def define(self, weights: Floats) -> Definition:
        """Return the definition with all scenarios, whose objectives have the given weights."""
        definition, ends = self.definition, self.definition.endpoint
        parameters, copies, count = self.parameters
        parts = [self._phase(number) for number in range(len(definition.phases))]
        phases = tuple(phase for phase, _, _ in parts)
        start, places = 0, []
        for phase, x, integrals in parts:
            times = np.tile([0, 1], (self.count, 1))
            others = [2 + x.places, 2 + x.size + x.places, 2 + 2 * x.size + integrals.places]
            inner = 2 + 2 * x.size + integrals.size
            others += [inner + k * x.size + x.places for k in range(len(phase.instants))]
            places.append(start + np.hstack([times, *others]))
            start += phase.end_size
        kind: Any = casadi.SX if ends.is_a("SXFunction") else casadi.MX
        e, p = kind.sym("e", start), kind.sym("p", count)
        pairs = zip(np.hstack(places).tolist(), copies.places.tolist(), strict=True)
        values, rows = zip(*(ends.call([e[at], p[of]]) for at, of in pairs), strict=True)
        differ = self._differ(ends, "boundary", self.differing[2])
        boundaries, of_boundaries = self._items(definition.boundaries, differ)
        boundary = of_boundaries.gather(rows)
        objective = casadi.dot(casadi.DM(weights), casadi.vertcat(*values))
        if self.bounded:
            objective = p[-1]
            boundary = casadi.vertcat(boundary, casadi.vertcat(*values) - objective)
            each = casadi.Function("values", [e, p], [casadi.vertcat(*values)])
            level = self._level(phases, each)
            parameters = (*parameters, level)
            infinite = np.array([np.inf])
            boundaries += tuple(
                Restriction(
                    f"objective ({label})", "", definition.objective_unit,
                    -infinite, np.zeros(1), level.scale,
                )
                for label in self.labels
            )  # fmt: skip
        endpoint = casadi.Function(
            "endpoint", [e, p], [objective, boundary], ends.name_in(), ends.name_out()
        )
        return replace(
            definition, phases=phases, parameters=parameters, boundaries=boundaries,
            endpoint=endpoint,
        )  # fmt: skip

    def _level(self, phases: Sequence[Phase], values: casadi.Function) -> Quantity:
        """Return the parameter that bounds the objectives, guessed from those along the guess."""
        p = np.concatenate([*(q.initial_lower for q in self.parameters[0]), [0.0]])
        parts: list[Floats] = []
        for phase in phases:
            guess = phase.guess
            times = guess.start + guess.fractions * (guess.end - guess.start)
            table = phase.function(times[None], guess.states.T, guess.controls.T, p)[2].full()
            sums = np.trapezoid(table.reshape(phase.integrals, times.size), times, axis=1)
            parts += [times[[0, -1]], guess.states[0], guess.states[-1], sums]
            inner = [np.interp(phase.instants, guess.fractions, x) for x in guess.states.T]
            parts.append(np.array(inner).T.ravel())
        found = values(np.concatenate(parts), p).full().ravel()
        largest = float(found.max()) if np.isfinite(found).all() else 0.0
        scale = self.definition.objective_scale or abs(largest) or 1.0
        infinite = np.array([np.inf])
        edges = (-infinite, infinite, *(np.array([largest]),) * 2, -infinite, infinite)
        unit = self.definition.objective_unit
        sides: dict[str, Any] = dict(zip(SIDES, edges, strict=True))
        return Quantity(WORST, **sides, scale=np.array([scale]), unit=unit)
