"""What every transcription shares: from a mesh to a program, from a plan to columns and back."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData, UnsupportedOption, show
from ...formulation import Formulation
from ...programs.base import Program
from ...programs.nonlinear import NonlinearProgram
from ..hamiltonian import hamiltonian_spread
from ..model import OptimalControlProblem
from ..plan import ControlPlan, PhasePlan, Piecewise
from ..sampling import courses, endpoint
from ..sizes import Sizes, sizes_at
from .assembly import Assembly
from .calm import calm_strains
from .dependence import dependences, drop_dependent
from .derivatives import functions_of
from .layout import Layout
from .mesh import Mesh, even, read_mesh
from .refinement import Finding, History, Rules, denser, next_meshes, relative_change
from .schemes import Scheme
from .starts import draw_start

__all__ = ["Transcription"]

Floats = NDArray[np.float64]

#: How far before a knot, as a share of the phase, a control is looked up from the left.
LEFT = 1e-13
#: Difference between the objectives of two schemes on the same mesh up to which they agree, in shares of
#: the tolerance, relative to the size of the objective.
AGREED = 10.0
#: Share to which a mesh reduces at least by how much an equation is off that follows from others.
SHRINKS = 0.5


@dataclass(frozen=True, eq=False)
class Transcription(Formulation[OptimalControlProblem, ControlPlan]):
    """An optimal control problem as a nonlinear program on a mesh that is refined until it verifies.

    Parameters
    ----------
    model : OptimalControlProblem
        What is asked.
    intervals : int
        Intervals of the first mesh, in every phase.
    degree : int
        Collocated nodes of each interval of the first mesh.
    mesh : sequence of float or of sequences, optional
        Where the first mesh is cut, as fractions from 0 to 1: one list for all phases, or one each.
    refine : bool
        Whether the mesh is refined until the independent verification meets the tolerance.
    rounds : int
        Meshes at most.
    most_nodes : int
        Collocated nodes at most, over all phases; where more are needed, the run ends with what it has.
    dependent : str
        What to do about equations that others imply: ``"drop"`` them from the program (they are
        verified all the same, and come back where the plan breaks them), ``"raise"``, or ``"keep"``.
    """

    intervals: int = 8
    degree: int = 6
    mesh: Any = None
    refine: bool = True
    rounds: int = 25
    most_nodes: int = 3000
    dependent: str = "drop"
    _meshes: tuple[Mesh, ...] = field(init=False, repr=False, default=())
    _history: History | None = field(init=False, repr=False, default=None)
    _start: ControlPlan | None = field(init=False, repr=False, default=None)
    _told: tuple[Mapping[str, Any], ...] = field(init=False, repr=False, default=())
    _rows: tuple[Mapping[str, Any], ...] = field(init=False, repr=False, default=())
    _settled: bool = field(init=False, repr=False, default=True)

    program_type: ClassVar[type[Program]] = NonlinearProgram
    relaxes: ClassVar[bool] = False
    draws: ClassVar[bool] = True
    #: Equations of the transcription are held to a third of what the plan must satisfy.
    precision: ClassVar[float] = 0.3
    #: How a mesh of this scheme may be refined.
    rules: ClassVar[Rules] = Rules()
    #: Transcription of another scheme that must reach the same objective on the same mesh.
    confirmed_by: ClassVar[type[Transcription] | None] = None

    @staticmethod
    @abstractmethod
    def scheme(count: int) -> Scheme:
        """Return the collocation scheme of an interval with `count` nodes."""

    def __post_init__(self) -> None:
        for name, low, high in (
            ("intervals", 1, 10_000),
            ("degree", 1, 400),
            ("rounds", 1, 1000),
            ("most_nodes", 1, 10**7),
        ):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
                raise UnsupportedOption(
                    f"formulation {self.name!r}: option {name!r} must be a whole number from {low} "
                    f"to {high}, got {show(value)}"
                )
        if not isinstance(self.refine, bool):
            raise UnsupportedOption(
                f"formulation {self.name!r}: option 'refine' must be true or false, "
                f"got {show(self.refine)}"
            )
        choices = ("raise", "drop", "keep")
        if not isinstance(self.dependent, str) or self.dependent not in choices:
            raise UnsupportedOption(
                f"formulation {self.name!r}: option 'dependent' must be one of 'raise', 'drop', "
                f"'keep', got {show(self.dependent)}"
            )
        object.__setattr__(self, "_meshes", self._first_meshes())

    def _first_meshes(self) -> tuple[Mesh, ...]:
        phases = self.model.definition.phases
        degree = self.degree
        if self.mesh is None:
            return tuple(even(self.intervals, degree) for _ in phases)
        nested = isinstance(self.mesh, list | tuple) and any(
            isinstance(one, Mesh) or np.ndim(one) == 1 for one in self.mesh
        )
        if not nested:
            return tuple(read_mesh(self.mesh, degree) for _ in phases)
        if len(self.mesh) != len(phases):
            raise UnsupportedOption(
                f"formulation {self.name!r}: option 'mesh' has {len(self.mesh)} lists for "
                f"{len(phases)} phases"
            )
        return tuple(read_mesh(one, degree) for one in self.mesh)

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """The mesh of each phase."""
        return self._meshes

    # -- the program -----------------------------------------------------------------------------

    @cached_property
    def layout(self) -> Layout:
        """Which column and row stands for what."""
        schemes = [tuple(self.scheme(int(n)) for n in mesh.degrees) for mesh in self._meshes]
        return Layout.of(self.model.definition, self._meshes, schemes)

    def build(self) -> NonlinearProgram:
        """Return the program on the present mesh, started where the last one ended."""
        assembly = Assembly(self.layout, self.sizes)
        start = self._start if self._history is None else self._history.plan
        guess = self._guess() if start is None else self.encode(start)
        program = assembly.program(guess, self.model.name)
        if not self.dropped:
            return program
        if self.dependent == "raise":
            raise InvalidData(
                f"dependent equations: {self.dropped} follow from the others or contradict them. "
                "Leave them out, or let the program do so: formulation_options={'dependent': 'drop'}; "
                "verification checks them all the same",
                field="final",
            )
        return drop_dependent(assembly, program, dependences(self.model.definition))

    @property
    def dropped(self) -> str:
        """Equations that follow from others and are not to be in the program, by name."""
        definition = self.model.definition
        found = () if self.dependent == "keep" else dependences(definition)
        return ", ".join(name for one in found for name in one.names(definition))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out of the program."""
        if not self.dropped:
            return ()
        return (f"left out of the program, for they follow from other equations: {self.dropped}",)

    @cached_property
    def sizes(self) -> Sizes:
        """How large everything is: along the plan of the last mesh, before the first along the guess."""
        known = self._history is not None
        plan = self._history.plan if self._history is not None else self.decode(self._guess())
        definition = self.model.definition
        with np.errstate(all="ignore"):
            phases = courses(definition, plan)
            return sizes_at(definition, phases, endpoint(phases), guessed=not known)

    def _guess(self) -> Floats:
        columns = np.zeros(self.layout.size)
        for one in self.layout.phases:
            guess = one.phase.guess
            for table, places, at in (
                (guess.states, one.state_columns, one.point_fractions),
                (guess.controls, one.control_columns, one.visit_places[0][one.owners]),
            ):
                for k in range(table.shape[1]):
                    columns[places[k]] = np.interp(at, guess.fractions, table[:, k])
            columns[one.time_columns] = guess.start, guess.end
        columns[self.layout.parameter_columns] = self.model.definition.stacked(
            "parameters", "initial_lower"
        )
        return self._with_integrals(columns)

    def _with_integrals(self, columns: Floats) -> Floats:
        """Return `columns` with the integrals that their states and controls give."""
        for number, one in enumerate(self.layout.phases):
            if one.phase.integrals:
                values = self._visited(columns, number)
                weights = np.concatenate([scheme.weights for scheme in one.schemes])
                found = values[one.nx : one.nx + one.phase.integrals] @ weights
                columns[one.integral_columns] = np.where(np.isfinite(found), found, 0.0)
        return columns

    def _visited(self, columns: Floats, number: int) -> Floats:
        """Return what a phase's node functions give at every visit, (entries, visits)."""
        one, own = self.layout.phases[number], self.layout.visit_columns(number)
        function = functions_of(self.model.definition).nodes[number].value.map(one.visits)
        values: Floats = np.array(function(columns[own], one.visit_places), float)
        return values

    # -- plans -----------------------------------------------------------------------------------

    def encode(self, plan: ControlPlan) -> Floats:
        """Return the columns that sample `plan` on the present mesh.

        A plan that satisfies the problem satisfies the rows as nearly as the mesh resolves it.
        """
        if len(plan.phases) != len(self.layout.phases):
            raise InvalidData(
                f"the plan has {len(plan.phases)} phases, the problem {len(self.layout.phases)}",
                field="phases",
            )
        columns = np.zeros(self.layout.size)
        for one, part in zip(self.layout.phases, plan.phases, strict=True):
            if part.states.size != one.nx or part.controls.size != one.nu:
                raise InvalidData(
                    f"phase {part.name!r} of the plan has {part.states.size} states and "
                    f"{part.controls.size} controls, the problem {one.nx} and {one.nu}",
                    field="phases",
                )
            at = part.start + one.point_fractions * part.duration
            columns[one.state_columns] = part.states(np.minimum(at, part.end)).T
            at = part.start + one.visit_places[0][one.owners] * part.duration
            # Where an interval's end is collocated, its control is that of this interval, not the next.
            ends = one.visit_ends[one.owners]
            at = np.clip(at - np.where(ends, LEFT * part.duration, 0.0), part.start, part.end)
            columns[one.control_columns] = part.controls(at).T
            columns[one.time_columns] = part.start, part.end
        used, column = 0, self.layout.parameter_columns
        for quantity in self.model.definition.parameters:
            value = plan.parameters.get(quantity.name)
            if value is None or value.size != quantity.size:
                raise InvalidData(
                    f"the plan must have {quantity.size} value(s) of parameter {quantity.name!r}",
                    field="parameters",
                )
            columns[column[used : used + quantity.size]] = value
            used += quantity.size
        return self._with_integrals(columns)

    def decode(self, point: Floats) -> ControlPlan:
        """Return the plan whose polynomials the columns stand for."""
        columns = np.asarray(point, float)
        definition = self.model.definition
        p = columns[self.layout.parameter_columns]
        phases = []
        for number, one in enumerate(self.layout.phases):
            t0, tf = columns[one.time_columns]
            if not tf > t0:
                raise InvalidData(
                    f"phase {one.phase.name!r}: its end {tf:g} is not after its start {t0:g}",
                    field="time",
                )
            knots = t0 + one.mesh.fractions * (tf - t0)
            knots[-1] = tf
            states = self._state_polynomials(columns, number)
            at = (
                columns[one.control_columns].reshape(one.nu, one.collocated)[:, one.visit_control].T
            )
            cuts = one.visit_starts[1:-1].tolist()
            controls = Piecewise(
                knots,
                tuple(scheme.control_points for scheme in one.schemes),
                tuple(np.split(at, cuts)),
                *one.phase.bounds("controls"),
            )
            phases.append(
                PhasePlan(
                    one.phase.name, states, controls, one.phase.state_names,
                    one.phase.control_names,
                )
            )  # fmt: skip
        parameters, used = {}, 0
        for quantity in definition.parameters:
            parameters[quantity.name] = p[used : used + quantity.size]
            used += quantity.size
        return ControlPlan(tuple(phases), parameters).attached(definition)

    def _state_polynomials(self, columns: Floats, number: int) -> Piecewise:
        one = self.layout.phases[number]
        x = columns[one.state_columns]
        rates = None
        if any(scheme.from_rates.any() for scheme in one.schemes):
            rates = self._visited(columns, number)[: one.nx]
        values = []
        for k, scheme in enumerate(one.schemes):
            table = scheme.from_states @ x[:, one.starts[k] : one.starts[k + 1] + 1].T
            if rates is not None:
                own = rates[:, one.visit_starts[k] : one.visit_starts[k + 1]]
                table = table + scheme.from_rates @ own.T
            values.append(table)
        t0, tf = columns[one.time_columns]
        knots = t0 + one.mesh.fractions * (tf - t0)
        knots[-1] = tf
        return Piecewise(knots, tuple(s.plan_points for s in one.schemes), tuple(values))

    def explained(self, plan: ControlPlan, point: Floats, duals: Floats) -> ControlPlan:
        """Return the plan with costates, from the program's row multipliers."""
        phases, row = [], 0
        for one, part in zip(self.layout.phases, plan.phases, strict=True):
            own = duals[row : row + one.nx * one.defects].reshape(one.nx, one.defects).T
            row += one.nx * one.defects + one.paths * one.collocated + one.phase.integrals
            phases.append(replace(part, costates=one.costates(own, part.states.knots)))
        return replace(plan, phases=tuple(phases))

    # -- refinement and other starts -------------------------------------------------------------

    def refined(self, point: Floats, tolerance: float, duals: Floats | None = None) -> Self | None:
        """Return the formulation on a finer mesh, None where the plan verifies or no mesh helps."""
        plan = self.decode(point)
        objective = float(self.program.objective(point))  # type: ignore[attr-defined]
        rounds = len(self._told) + 1
        if duals is not None:
            plan = self.explained(plan, point, duals)
        found = Finding(None, np.nan, "not refined", settled=True)
        restored = self._restored(plan, tolerance) if self.refine else None
        if restored is not None:
            words = "again with all equations: one that was left out stays broken"
            found = Finding(self._meshes, np.nan, words)
        elif self.refine:
            found = next_meshes(
                self.model, plan, self._meshes, self.rules, tolerance,
                (objective, self.sizes.objective), self._history,
                None if duals is None else calm_strains(self.layout, self.sizes, duals),
            )  # fmt: skip
        found = found.limited(rounds, self.rounds, self.most_nodes)
        row = {
            "mesh": rounds,
            "intervals": sum(mesh.intervals for mesh in self._meshes),
            "nodes": sum(mesh.nodes for mesh in self._meshes),
            "error": found.error if np.isfinite(found.error) else None,
            "objective": objective if np.isfinite(objective) else None,
            "change": found.change if np.isfinite(found.change) else None,
            "verified": found.verified,
            "then": found.words,
        }
        rows = (*self._told, row)
        object.__setattr__(self, "_rows", rows)
        object.__setattr__(self, "_settled", found.settled)
        if found.meshes is None:
            return None
        if restored is not None:
            return restored._with(_told=rows)
        history = History(plan, objective, self._meshes, found.errors, found.accepted)
        return self._with(_meshes=found.meshes, _history=history, _told=rows)

    def counterpart(self, point: Floats) -> Transcription | None:
        """Return the transcription of the other scheme on the same mesh, started at `point`.

        None if refinement is off.
        """
        other = self.confirmed_by
        if other is None or not self.refine:
            return None
        made = other(self.model, dependent=self.dependent, most_nodes=self.most_nodes)
        fixed = other.rules.fixed_degree
        meshes = self._meshes
        if fixed is not None:
            meshes = tuple(
                Mesh(mesh.fractions, np.full(mesh.intervals, fixed), mesh.calm) for mesh in meshes
            )
        plan = self.decode(point)
        return made._with(_meshes=meshes, _start=plan, _history=None)

    def compared(self, point: Floats, objective: float, tolerance: float) -> Self | None:
        """Return the formulation on halved intervals if the other scheme ends elsewhere."""
        own = float(self.program.objective(point))  # type: ignore[attr-defined]
        difference = relative_change(self.sizes.objective, own, objective)
        if difference <= AGREED * tolerance:
            return None
        assert self.confirmed_by is not None
        rounds = len(self._rows)
        words = f"{self.confirmed_by.name} ends at {objective:.9g}: all intervals refined"
        meshes = denser(self._meshes, self.rules)
        finer = Finding(meshes, np.nan, words).limited(rounds, self.rounds, self.most_nodes)
        if meshes is None:
            finer = replace(finer, words="no finer mesh is possible")
        rows = (*self._rows[:-1], {**self._rows[-1], "then": finer.words})
        object.__setattr__(self, "_rows", rows)
        object.__setattr__(self, "_settled", False)
        if finer.meshes is None:
            return None
        errors = tuple(np.full(mesh.intervals, np.inf) for mesh in self._meshes)
        history = History(self.decode(point), own, self._meshes, errors)
        return self._with(_meshes=finer.meshes, _history=history, _told=rows)

    @property
    def settled(self) -> bool:
        """Whether the last plan verified and its objective had settled, or nobody asked for that."""
        return self._settled

    @property
    def history(self) -> tuple[Mapping[str, Any], ...]:
        """A row for each mesh so far: its size, its error, its objective and what was done then."""
        return self._rows

    def _restored(self, plan: ControlPlan, tolerance: float) -> Self | None:
        """Return the formulation with all equations, where one that was left out stays broken."""
        if not self.dropped or self._history is None:
            return None
        kept = self._with(dependent="keep", _history=None)
        before, now = (
            max(check.worst / check.scale for check in kept.program.verify(kept.encode(one)).checks)
            for one in (self._history.plan, plan)
        )
        return kept if now > max(tolerance, SHRINKS * before) else None

    def fitted(self, plan: ControlPlan) -> Self:
        """Return the formulation on the plan's own mesh, where this scheme has such intervals."""
        meshes = []
        for part in plan.phases:
            knots = part.states.knots
            fractions = (knots - knots[0]) / (knots[-1] - knots[0])
            fractions[-1] = 1.0
            own = part.controls if part.controls.size else part.states
            degrees = np.array([at.size for at in own.nodes])
            fixed = self.rules.fixed_degree
            if fixed is not None and (degrees != fixed).any():
                return self
            meshes.append(Mesh(fractions, degrees))
        return self._with(_meshes=tuple(meshes))

    def started(self, seed: int) -> Self:
        """Return the formulation with a start drawn by `seed`: waves about the guess."""
        return self._with(
            _start=draw_start(
                self.model.definition, self._start or self.decode(self._guess()), seed
            )
        )

    def guessed(self, plan: ControlPlan) -> Self:
        """Return the formulation started at `plan`, such as that for another initial state."""
        return self._with(_start=plan)

    def _with(self, **changes: Any) -> Self:
        options = {
            one.name: getattr(self, one.name)
            for one in fields(self)
            if one.init and one.name != "model"
        }
        if "dependent" in changes:
            options["dependent"] = changes["dependent"]
        made = type(self)(self.model, **options)
        for name in ("_meshes", "_history", "_start", "_told"):
            object.__setattr__(made, name, changes.get(name, getattr(self, name)))
        return made

    def statistics(self, plan: ControlPlan) -> dict[str, float | int | str]:
        """Return the size of the mesh, what it changed, and how far the Hamiltonian strays."""
        found: dict[str, float | int | str] = {
            "meshes": len(self._told) + 1,
            "intervals": sum(mesh.intervals for mesh in self._meshes),
            "nodes": sum(mesh.nodes for mesh in self._meshes),
            "columns": self.layout.size,
        }
        if self.dropped:
            found["dropped"] = self.dropped
        if self._history is not None:
            objective = float(self.program.objective(self.encode(plan)))  # type: ignore[attr-defined]
            found["objective_change"] = relative_change(
                self.sizes.objective, objective, self._history.objective
            )
        if all(part.costates is not None for part in plan.phases):
            reports = hamiltonian_spread(self.model, plan)
            spreads = [one.relative for one in reports if one.autonomous]
            if spreads:
                found["hamiltonian_spread"] = max(spreads)
        return found
