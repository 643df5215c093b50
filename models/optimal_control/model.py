"""Optimal control problems in Bolza form, declared in CasADi expressions.

Minimise Φ(x(t0), t0, x(tf), tf) + ∫ g(x, u, t) dt subject to the dynamics ẋ = f(x, u, t), path
constraints on (x, u, t) at every instant and boundary constraints, over one or several phases: eq.
12 and 13 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method" (Mathematical Problems in Engineering, 2016), and Betts, "Practical Methods
for Optimal Control and Estimation Using Nonlinear Programming" (SIAM, 2010), chapter 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

from ...errors import InvalidData
from ..fields import declared, show
from ..model import Model
from ..verification import TOLERANCE, Verification
from .definition import Definition, Stated
from .plan import ControlPlan

if TYPE_CHECKING:
    import casadi

    from .declaration.problem import Draft, PhaseDraft

__all__ = ["OptimalControlProblem"]


@dataclass(frozen=True, eq=False, repr=False, init=False)
class OptimalControlProblem(Model[ControlPlan]):
    """An optimal control problem, declared piece by piece.

    Declare phases, states, controls, dynamics and what is to be minimised; then hand it to
    :func:`crosstrack.solve` like any model. Expressions are CasADi's (``casadi.sin(x)``, ``x**2``).
    Declaring more afterwards is allowed, and makes it another problem with another digest.

    Parameters
    ----------
    name : str
        A label for people.
    definition : Definition, optional
        A finished definition, such as another problem's; nothing more can be declared then.

    Raises
    ------
    InvalidData
        At the declaration at fault, or at the first use for what is missing: a state without
        dynamics, no objective, a free time without bounds.

    Examples
    --------
    Bryson and Denham: the least effort that keeps a double integrator below a bound.

    >>> import crosstrack as ct
    >>> from crosstrack.models import OptimalControlProblem
    >>> ocp = OptimalControlProblem("bryson-denham")
    >>> phase = ocp.phase(time=(0, 1))
    >>> x = phase.state("x", initial=0, final=0, upper=1 / 9)
    >>> v = phase.state("v", initial=1, final=-1)
    >>> u = phase.control("u")
    >>> phase.dynamics({x: v, v: u})
    >>> ocp.minimise(phase.integral(u**2 / 2))
    >>> answer = ct.solve(ocp, tolerance=1e-6)
    >>> round(answer.primal_bound, 5)
    4.0
    """

    definition: Definition = declared(Stated())

    kind: ClassVar[str] = "optimal-control"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.optimal_control.transcription.gauss:PaperGauss",
        "gauss": ".models.optimal_control.transcription.gauss:Gauss",
        "radau": ".models.optimal_control.transcription.radau:Radau",
        "hermite-simpson": ".models.optimal_control.transcription.low_order:HermiteSimpson",
        "trapezoid": ".models.optimal_control.transcription.low_order:Trapezoid",
    }
    default_formulation: ClassVar[str] = "gauss"

    def __init__(self, name: str = "", *, definition: Definition | None = None) -> None:
        from ..programs.compiled import require_casadi

        require_casadi("an optimal control problem")
        if not isinstance(name, str):
            raise InvalidData(f"name must be a string, got {show(name)}", field="name")
        object.__setattr__(self, "name", name)
        if definition is not None:
            ready = Stated().coerce("definition", definition, {})
            object.__setattr__(self, "definition", ready)
        else:
            from .declaration.problem import Draft

            object.__setattr__(self, "_draft", Draft())

    def __getattr__(self, name: str) -> Any:
        # Only asked for what is not there: a definition that must be drawn up from what was declared.
        if name == "definition" and "_draft" in self.__dict__:
            ready = self._draft.finished()
            object.__setattr__(self, "definition", ready)
            return ready
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __getstate__(self) -> dict[str, Any]:
        return {"name": self.name, "definition": self.definition}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)

    @property
    def digest(self) -> str:
        """SHA-256 of the content as it is declared now, in hexadecimal."""
        import hashlib

        if "_digest" not in self.__dict__:
            text = f"{OptimalControlProblem.kind}\0{self.definition.text}"
            object.__setattr__(self, "_digest", hashlib.sha256(text.encode()).hexdigest())
        found: str = self.__dict__["_digest"]
        return found

    # -- declaring -------------------------------------------------------------------------------

    def _open(self) -> Draft:
        """Return the draft to declare in; what was drawn up from it before is void."""
        if "_draft" not in self.__dict__:
            raise InvalidData(
                f"problem {self.name!r} was read or copied in its finished form: nothing more can be "
                "declared in it",
                field="definition",
            )
        for stale in ("definition", "_digest"):
            self.__dict__.pop(stale, None)
        draft: Draft = self.__dict__["_draft"]
        return draft

    def phase(
        self,
        name: str = "",
        *,
        time: tuple[Any, Any] = (0.0, 1.0),
        unit: str = "s",
        equation: str = "",
    ) -> PhaseDraft:
        """Add a phase, and return it to declare states, controls and dynamics in.

        Parameters
        ----------
        name : str
            Its name; ``"phase 1"``, ``"phase 2"`` … where none is given.
        time : tuple
            When it starts and when it ends: each a number, or ``(lower, upper)`` where it is free.
        unit : str
            Unit of time.
        equation : str
            The paper's number of the equation of motion.
        """
        return self._open().phase(self._open, name, time, unit, equation)

    def parameter(
        self,
        name: str,
        size: int = 1,
        *,
        lower: Any = None,
        upper: Any = None,
        guess: Any = None,
        scale: Any = None,
        unit: str = "",
    ) -> casadi.MX:
        """Declare a constant that is chosen with the motion, and return its symbol.

        Parameters
        ----------
        name : str
            Its name.
        size : int
            Number of entries.
        lower, upper : float or array_like, optional
            Bounds.
        guess : float or array_like, optional
            Where a search starts.
        scale : float or array_like, optional
            Typical size.
        unit : str
            Unit, for people.
        """
        symbol: casadi.MX = self._open().parameter(name, size, lower, upper, guess, scale, unit)
        return symbol

    def minimise(self, objective: Any, *, unit: str = "") -> None:
        """Declare what is minimised.

        Parameters
        ----------
        objective : casadi expression
            In integrals (``phase.integral(…)``), values at the ends (``phase.final(x)``), times
            (``phase.end``) and parameters.
        unit : str
            Its unit.
        """
        self._open().minimise(objective, unit)

    def subject_to(
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
        """Declare a boundary constraint: on values at the ends, integrals, times and parameters.

        Parameters
        ----------
        expression : casadi expression
            What is bounded, or a relation such as ``phase.final(x) <= 2 * p``.
        lower, upper, equals : float or array_like, optional
            Its bounds, or the value it must have.
        name, equation, unit : str
            In the words of the paper.
        scale : float or array_like, optional
            Typical size of the expression.
        """
        self._open().subject_to(expression, lower, upper, equals, (name, equation, unit), scale)

    def link(self, first: PhaseDraft, second: PhaseDraft, *states: str) -> None:
        """Let `second` begin when and where `first` ends.

        Parameters
        ----------
        first, second : phase
            The two phases.
        *states : str
            Names of the states that go on; all that both phases have, where none is named.
        """
        self._open().link(first, second, states)

    # -- the model -------------------------------------------------------------------------------

    @classmethod
    def from_data(cls, data: Mapping[str, Any], *, name: str = "") -> Self:
        """Return the problem that :meth:`data` wrote."""
        if isinstance(data, Mapping) and not isinstance(data.get("definition"), Mapping):
            raise InvalidData(
                f"key 'definition' must be an object in the data of model {cls.kind!r}, "
                f"got {show(data.get('definition'))}",
                field="definition",
            )
        return super().from_data(data, name=name)

    @property
    def objective_unit(self) -> str:  # type: ignore[override]
        """Unit of the objective."""
        return self.definition.objective_unit

    def renamed(self, name: str) -> Self:
        """Return the same problem under another name."""
        return type(self)(name, definition=self.definition)

    def verify(self, plan: ControlPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective by quadrature and every constraint, the motion integrated anew.

        The control is integrated with DOP853 from the plan's first state and held against the
        plan's own; bounds and path constraints are measured on a dense grid between the nodes; the
        boundary conditions at the ends; integrals by adaptive quadrature; invariants along the way.
        """
        from .checks import verify_control

        return verify_control(self, plan, tolerance)

    def plan_to_data(self, plan: ControlPlan) -> Any:
        """Return ``{"phases": […], "parameters": {…}}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> ControlPlan:
        """Return the plan in `data`."""
        return ControlPlan.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""
        if "_draft" in self.__dict__ and "definition" not in self.__dict__:
            return "being declared"
        phases = self.definition.phases
        states = sum(len(one.state_names) for one in phases)
        controls = sum(len(one.control_names) for one in phases)
        return f"{len(phases)} phase{'s' * (len(phases) > 1)}, {states} states, {controls} controls"
