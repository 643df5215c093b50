"""Base of all transcriptions: from a mesh to a program, and between plans and columns."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidData, UnsupportedOption, show
from ...formulation import Formulation
from ...programs.base import Program
from ...programs.nonlinear import NonlinearProgram
from ..convexity import is_convex
from ..definition import Phase
from ..epigraph import Epigraph, epigraph_of
from ..hamiltonian import hamiltonian_spread
from ..model import OptimalControlProblem
from ..plan import ControlPlan
from ..sampling import courses, endpoint
from ..sizes import Sizes, sizes_at
from .assembly import Assembly
from .columns import guessed_columns, interpolate, sample
from .dependence import dependences, drop_dependent
from .layout import Layout, layout_of
from .mesh import Mesh, even, mesh_of, read_meshes
from .refinement import Finding, History, Rules, denser, next_meshes, relative_change
from .schemes import Scheme
from .starts import coarse_mesh, draw_flight, draw_start, other_meshes

__all__ = ["Transcription"]

Floats = NDArray[np.float64]

#: Largest relative difference between the objectives of two schemes that agree, in tolerances.
AGREED = 10.0
#: Largest objective of two schemes that vanishes in both, in tolerances of its variation. The barrier leaves
#: (u - 1)^2 at u <= 1 with an integral of 16 of them by Radau, and of 1e-4 by Gauss.
ZERO = 30.0
#: Largest number of interior instants that are knots of the first mesh, per interval of it.
MOST_KNOTS = 4
#: Largest ratio of the residuals of an implied equation on a finer and on a coarser mesh.
SHRINKS = 0.5


@dataclass(frozen=True, eq=False)
class Transcription(Formulation[OptimalControlProblem, ControlPlan]):
    """Optimal control problem as a nonlinear program on a mesh that is refined until it verifies.

    Parameters
    ----------
    model : OptimalControlProblem
        Problem.
    intervals : int
        Number of intervals of the first mesh, per phase; more with knots at interior instants.
    degree : int
        Number of collocation nodes per interval of the first mesh.
    mesh : sequence of float or of sequences, optional
        Ends of the first intervals as fractions from 0 to 1, for all phases or one list per phase.
    refine : bool
        Whether the mesh is refined until the independent verification meets the tolerance.
    rounds : int
        Largest number of meshes.
    most_nodes : int
        Largest number of collocation nodes over all phases; a run that needs more stops.
    dependent : {"drop", "raise", "keep"}
        Treatment of equations that others imply: ``"drop"`` removes them and restores them if the
        plan violates them, ``"raise"`` reports an error, and ``"keep"`` leaves them in the program.
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
    _past_rows: tuple[Mapping[str, Any], ...] = field(init=False, repr=False, default=())
    _rows: tuple[Mapping[str, Any], ...] = field(init=False, repr=False, default=())
    _settled: bool = field(init=False, repr=False, default=True)

    program_type: ClassVar[type[Program]] = NonlinearProgram
    relaxes: ClassVar[bool] = False
    draws: ClassVar[bool] = True
    #: The program is solved to a third of the plan's tolerance.
    precision: ClassVar[float] = 0.3
    #: Rules for the refinement of meshes of this scheme.
    rules: ClassVar[Rules] = Rules()
    #: Transcription of another scheme that must reach the same objective on the same mesh.
    confirmed_by: ClassVar[type[Transcription] | None] = None

    @staticmethod
    @abstractmethod
    def scheme(count: int) -> Scheme:
        """Return the collocation scheme of an interval with `count` nodes."""

    def __post_init__(self) -> None:
        limits = {"intervals": 10_000, "degree": 400, "rounds": 1000, "most_nodes": 10**7}
        for name, most in limits.items():
            value = getattr(self, name)
            is_whole = isinstance(value, int) and not isinstance(value, bool)
            self._require(name, is_whole and 1 <= value <= most, f"a whole number from 1 to {most}")
        self._require("refine", isinstance(self.refine, bool), "true or false")
        choices = ("raise", "drop", "keep")
        is_choice = isinstance(self.dependent, str) and self.dependent in choices
        self._require("dependent", is_choice, "one of 'raise', 'drop', 'keep'")
        phases = self.problem.definition.phases
        if self.mesh is None:
            meshes = tuple(
                even(self.intervals, self.degree, self._knots(phase)) for phase in phases
            )
        else:
            meshes = read_meshes(self.mesh, self.degree, len(phases))
        object.__setattr__(self, "_meshes", meshes)

    def _require(self, name: str, condition: bool, allowed: str) -> None:
        if not condition:
            raise UnsupportedOption(
                f"formulation {self.name!r}: option {name!r} must be {allowed}, "
                f"got {show(getattr(self, name))}"
            )

    def _knots(self, phase: Phase) -> tuple[float, ...]:
        """Return the interior instants of a phase, at which intervals of the first mesh end.

        Controls have corners there. In ``tests/optimal_control/test_instants.py`` Gauss collocation takes
        2 meshes for the gate with a knot and 5 without, and its objective is exact, not 7e-9 off (relative).
        """
        few = len(phase.instants) <= MOST_KNOTS * self.intervals
        return phase.instants if few and self.rules.split else ()

    @property
    def problem(self) -> OptimalControlProblem:
        """Problem that is transcribed, with its own plans; by default the model, without kinks in its costs."""
        return self.model if self._epigraph is None else self._epigraph.problem

    @property
    def _epigraph(self) -> Epigraph | None:
        return epigraph_of(self.model.definition, self.model.name)

    def _to_problem(self, plan: ControlPlan) -> ControlPlan:
        """Return the plan of the transcribed problem for a plan of the model."""
        return plan if self._epigraph is None else self._epigraph.extended(plan)

    def _to_model(self, plan: ControlPlan) -> ControlPlan:
        """Return the model's plan for a plan of the transcribed problem."""
        return plan if self._epigraph is None else self._epigraph.reduced(plan)

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """The mesh of each phase."""
        return self._meshes

    # -- the program -----------------------------------------------------------------------------

    @cached_property
    def layout(self) -> Layout:
        """Assignment of columns and rows to points and equations."""
        return layout_of(self.problem.definition, type(self).scheme, self._meshes)

    def build(self) -> NonlinearProgram:
        """Return the program on the current mesh, started at the plan of the previous one."""
        assembly = Assembly(self.layout, self.sizes)
        start = self._start if self._history is None else self._history.plan
        guess = guessed_columns(self.layout) if start is None else sample(self.layout, start)
        program = assembly.program(guess, self.problem.name)
        if not self.dropped:
            return program
        if self.dependent == "raise":
            raise InvalidData(
                f"dependent equations: {self.dropped} follow from the others or contradict them. "
                "Leave them out, or let the program do so: formulation_options={'dependent': 'drop'}; "
                "verification checks them all the same",
                field="final",
            )
        return drop_dependent(assembly, program, dependences(self.problem.definition))

    @property
    def dropped(self) -> str:
        """Names of the equations that are removed from the program because others imply them."""
        definition = self.problem.definition
        implied = () if self.dependent == "keep" else dependences(definition)
        return ", ".join(name for item in implied for name in item.names(definition))

    @property
    def notes(self) -> tuple[str, ...]:
        """Names of equations that the program omits."""
        text = f"left out of the program, for they follow from other equations: {self.dropped}"
        return (text,) if self.dropped else ()

    @cached_property
    def sizes(self) -> Sizes:
        """Sizes of all quantities along the plan of the previous mesh, at first along the guess."""
        guessed = self._history is None
        plan = self._declared if self._history is None else self._history.plan
        with np.errstate(all="ignore"):
            phases = courses(self.problem.definition, plan)
            rough = [(course.dense.states, course.rough_integrals) for course in phases]
            ends = endpoint(phases, None if guessed else rough)
            return sizes_at(self.problem.definition, phases, ends, guessed=guessed)

    @property
    def _declared(self) -> ControlPlan:
        """Declared guess as a plan."""
        return interpolate(self.layout, guessed_columns(self.layout))

    # -- plans -----------------------------------------------------------------------------------

    def encode(self, plan: ControlPlan) -> Floats:
        """Return the columns that sample `plan`, which satisfies the rows up to the mesh's resolution."""
        return sample(self.layout, self._to_problem(plan))

    def decode(self, point: Floats) -> ControlPlan:
        """Return the plan with the polynomials that the columns represent."""
        return self._to_model(self._plan_at(point))

    def _plan_at(self, point: Floats) -> ControlPlan:
        """Return the plan of the transcribed problem."""
        return interpolate(self.layout, point)

    def explained(self, plan: ControlPlan, point: Floats, duals: Floats) -> ControlPlan:
        """Return the plan with costates from the program's row multipliers."""
        return self._with_costates(plan, duals)

    def _with_costates(self, plan: ControlPlan, duals: Floats) -> ControlPlan:
        phases, row = [], 0
        for layout, part in zip(self.layout.phases, plan.phases, strict=True):
            count = layout.nx * layout.defects
            multipliers = duals[row : row + count].reshape(layout.nx, layout.defects).T
            row += layout.rows
            phases.append(replace(part, costates=layout.costates(multipliers, part.states.knots)))
        return replace(plan, phases=tuple(phases))

    # -- refinement and other starts -------------------------------------------------------------

    def refined(self, point: Floats, tolerance: float, duals: Floats | None = None) -> Self | None:
        """Return the formulation on a finer mesh; None if the plan verifies or no finer mesh helps."""
        plan = interpolate(self.layout, point)
        objective = float(self.program.objective(point))  # type: ignore[attr-defined]
        rounds = len(self._past_rows) + 1
        if duals is not None:
            plan = self._with_costates(plan, duals)
        finding = Finding(None, np.nan, "not refined", settled=True)
        restored = self._restored(plan, tolerance) if self.refine else None
        if restored is not None:
            words = "again with all equations: one that was left out stays broken"
            finding = Finding(self._meshes, np.nan, words)
        elif self.refine:
            finding = next_meshes(
                self.problem, plan, self._meshes, self.rules, tolerance,
                (objective, self.sizes.objective), self._history,
                self.layout.strains(self.sizes, duals, point), self._verifies,
            )  # fmt: skip
        finding = finding.limited(rounds, self.rounds, self.most_nodes)
        row = {
            "mesh": rounds,
            **self._mesh_size,
            "error": finding.error if np.isfinite(finding.error) else None,
            "objective": objective if np.isfinite(objective) else None,
            "change": finding.change if np.isfinite(finding.change) else None,
            "verified": finding.verified,
            "then": finding.words,
        }
        finer = self._following(finding, plan, objective, (*self._past_rows, row))
        return finer if finer is None or restored is None else restored._with(_past_rows=self._rows)

    def _verifies(self, plan: ControlPlan, tolerance: float) -> bool:
        """Return whether a plan passes the verification that decides about the answer."""
        return self.model.verify(self._to_model(plan), tolerance=tolerance).ok

    def _following(
        self, finding: Finding, plan: ControlPlan, objective: float, rows: tuple[Any, ...]
    ) -> Self | None:
        """Store the rows of the history, and return the formulation on the meshes of `finding`."""
        object.__setattr__(self, "_rows", rows)
        object.__setattr__(self, "_settled", finding.settled)
        if finding.meshes is None:
            return None
        history = History(
            plan, objective, self._meshes, finding.errors, finding.accepted, finding.further,
            bool(finding.verified),
        )  # fmt: skip
        return self._with(_meshes=finding.meshes, _history=history, _past_rows=rows)

    @property
    def _mesh_size(self) -> dict[str, int]:
        """Numbers of intervals and nodes over all phases."""
        return {
            "intervals": sum(mesh.intervals for mesh in self._meshes),
            "nodes": sum(mesh.nodes for mesh in self._meshes),
        }

    def counterpart(self, point: Floats) -> Transcription | None:
        """Return the transcription with another scheme, started at `point`; None without refinement."""
        other = self.confirmed_by
        if other is None or not self.refine:
            return None
        transcription = other(self.problem, dependent=self.dependent, most_nodes=self.most_nodes)
        meshes, fixed = self._meshes, other.rules.fixed_degree
        if fixed is not None:
            meshes = tuple(
                Mesh(mesh.fractions, np.full(mesh.intervals, fixed), mesh.calm) for mesh in meshes
            )
        return transcription._with(
            _meshes=meshes, _start=interpolate(self.layout, point), _history=None
        )

    def compared(
        self, point: Floats, objective: float, tolerance: float, better: ControlPlan | None = None
    ) -> Self | None:
        """Return the formulation on a finer mesh if the other scheme has another optimum.

        It starts at the plan of the other scheme if that is `better`.
        """
        current = float(self.program.objective(point))  # type: ignore[attr-defined]
        difference = relative_change(self.sizes.objective, current, objective)
        largest = max(abs(current), abs(objective))
        if difference <= AGREED * tolerance or largest <= ZERO * tolerance * self.sizes.variation:
            return None
        assert self.confirmed_by is not None
        words = f"{self.confirmed_by.name} ends at {objective:.9g}: all intervals refined"
        meshes = denser(self._meshes, self.rules)
        if meshes is None:
            words = "no finer mesh is possible"
        errors = tuple(np.full(mesh.intervals, np.inf) for mesh in self._meshes)
        finding = Finding(meshes, np.nan, words, errors=errors)
        finding = finding.limited(len(self._rows), self.rounds, self.most_nodes)
        rows = (*self._rows[:-1], {**self._rows[-1], "then": finding.words})
        if better is None:
            better, objective = interpolate(self.layout, point), current
        return self._following(finding, better, objective, rows)

    def alternatives(self) -> Iterator[tuple[str, Transcription]]:
        """Yield labels and meshes of the scheme that confirms this one, if its degree is variable."""
        scheme = self.confirmed_by
        if scheme is None or scheme.rules.fixed_degree is not None or not self.refine:
            return iter(())
        return other_meshes(scheme, self)

    def with_fixed_times(self) -> NonlinearProgram | None:
        """Return the program with all times fixed at those of its guess; None if no time is free."""
        program = self.program
        assert isinstance(program, NonlinearProgram)
        columns = np.concatenate([phase.time_columns for phase in self.layout.phases])
        low, high = program.column_lower.copy(), program.column_upper.copy()
        if not (low[columns] < high[columns]).any():
            return None
        low[columns] = high[columns] = program.guess[columns]
        return replace(program, column_lower=low, column_upper=high)

    @property
    def is_restricted(self) -> bool:
        """Whether the controls are linear per interval, so that plans verify more easily."""
        return self._meshes[0].linear

    @property
    def settled(self) -> bool:
        """Whether the last plan verified and its objective converged; True without refinement."""
        return self._settled

    @property
    def history(self) -> tuple[Mapping[str, Any], ...]:
        """One row per mesh so far: size, error, objective and the action taken."""
        return self._rows

    def _restored(self, plan: ControlPlan, tolerance: float) -> Self | None:
        """Return the formulation with all equations if a removed one remains violated, else None."""
        if not self.dropped or self._history is None:
            return None
        complete = self._with(dependent="keep", _history=None)
        before, now = (
            max(
                check.worst / check.scale
                for check in complete.program.verify(sample(complete.layout, item)).checks
            )
            for item in (self._history.plan, plan)
        )
        return complete if now > max(tolerance, SHRINKS * before) else None

    def fitted(self, plan: ControlPlan) -> Self:
        """Return the formulation on the plan's mesh, if the scheme supports its degrees."""
        phases = self._to_problem(plan).phases
        meshes, fixed = tuple(map(mesh_of, phases)), self.rules.fixed_degree
        if fixed is not None and any((mesh.degrees != fixed).any() for mesh in meshes):
            return self
        return self._with(_meshes=meshes)

    def started(self, seed: int) -> Self:
        """Return the formulation with a random start: the guess with waves drawn by `seed`."""
        start = draw_start(self.problem.definition, self._start or self._declared, seed)
        return self._with(_start=start)

    @property
    def is_convex(self) -> bool:
        """Whether the problem is proven to be convex."""
        return is_convex(self.problem.definition)

    def coarse(self) -> Self | None:
        """Return the formulation on a coarse mesh for a comparison of starts; None without refinement."""
        if not self.refine:
            return None
        meshes = (coarse_mesh(self.rules),) * len(self._meshes)
        return self._with(_meshes=meshes, _history=None)

    def draw(self, seed: int) -> Floats:
        """Return a random start of the program: waves for odd seeds, motions for even ones."""
        draw_plan = draw_start if seed % 2 else draw_flight
        plan = draw_plan(self.problem.definition, self._start or self._declared, seed)
        columns = sample(self.layout, plan)
        return np.clip(columns, self.program.column_lower, self.program.column_upper)  # type: ignore[attr-defined]

    def guessed(self, plan: ControlPlan) -> Self:
        """Return the formulation started at `plan`, such as the plan for another initial state."""
        return self._with(_start=self._to_problem(plan))

    def _with(self, **changes: Any) -> Self:
        kept = ("_meshes", "_history", "_start", "_past_rows")
        return self._changed(**{name: getattr(self, name) for name in kept} | changes)

    def statistics(self, plan: ControlPlan) -> dict[str, float | int | str]:
        """Return the size of the mesh, the change of the objective, and the spread of the Hamiltonian."""
        plan = self._to_problem(plan)
        result: dict[str, float | int | str] = {
            "meshes": len(self._past_rows) + 1,
            **self._mesh_size,
            "columns": self.layout.size,
        }
        if self.is_convex:
            result["convex"] = True
        if self.dropped:
            result["dropped"] = self.dropped
        if self._history is not None:
            objective = float(self.program.objective(sample(self.layout, plan)))  # type: ignore[attr-defined]
            result["objective_change"] = relative_change(
                self.sizes.objective, objective, self._history.objective
            )
        reports = hamiltonian_spread(self.problem, plan)
        spreads = [report.relative for report in reports if report.autonomous]
        if spreads and len(reports) == len(plan.phases):
            result["hamiltonian_spread"] = max(spreads)
        return result
