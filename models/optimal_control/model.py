"""Optimal control problems in Bolza form, declared in CasADi expressions.

Minimise Φ(x(t0), t0, x(tf), tf) + ∫ g(x, u, t) dt subject to the dynamics ẋ = f(x, u, t), path
constraints on (x, u, t) at every instant and boundary constraints, over one or several phases: eq.
12 and 13 of "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss
Pseudospectral Method" (Mathematical Problems in Engineering, 2016), and Betts, "Practical Methods
for Optimal Control and Estimation Using Nonlinear Programming" (SIAM, 2010), chapter 4.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from ...errors import InvalidData
from ..declaration import Nested
from ..fields import declared
from ..model import Model
from ..programs.compiled import require_casadi
from ..verification import TOLERANCE, Verification
from .algebraic import algebraic_entries
from .checks import verify_control
from .definition import Definition
from .plan import ControlPlan
from .samples import is_sampled, plan_of_samples
from .sampling import courses

__all__ = ["OptimalControlProblem"]

#: Number of verifications that a problem caches: a run compares at most this many plans at a time.
CACHED = 4


@dataclass(frozen=True, eq=False, repr=False, init=False)
class OptimalControlProblem(Model[ControlPlan]):
    """Optimal control problem as it is stored, digested, verified and transcribed.

    Problems are usually declared piece by piece. Without a definition, ``OptimalControlProblem(name)``
    returns a
    :class:`~crosstrack.models.optimal_control.declaration.problem.ControlProblemBuilder`, which all
    functions accept in place of the problem that its ``build()`` returns.

    Parameters
    ----------
    name : str
        Label of the problem.
    definition : Definition
        Definition, for example that of another problem, or its JSON data.

    Raises
    ------
    InvalidData
        A declaration is invalid. Missing declarations, such as a state without dynamics, no
        objective or a free time without bounds, raise at first use.

    Examples
    --------
    Bryson and Denham: the smallest effort that keeps a double integrator below a bound.

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

    definition: Definition = declared(Nested(Definition))

    kind: ClassVar[str] = "optimal-control"
    formulations: ClassVar[dict[str, Any]] = {
        "paper": ".models.optimal_control.transcription.methods:PaperGauss",
        "gauss": ".models.optimal_control.transcription.methods:Gauss",
        "radau": ".models.optimal_control.transcription.methods:Radau",
        "hermite-simpson": ".models.optimal_control.transcription.methods:HermiteSimpson",
        "trapezoid": ".models.optimal_control.transcription.methods:Trapezoid",
    }
    default_formulation: ClassVar[str] = "gauss"
    plan_type: ClassVar[type] = ControlPlan

    if TYPE_CHECKING:
        # Without a definition the result is a builder, which type checkers do not learn from
        # __new__.
        def build(self) -> OptimalControlProblem: ...
        def __getattr__(self, name: str) -> Any: ...

    def __new__(cls, name: str = "", **fields: Any) -> Any:
        """Return a problem, or a builder if no definition is given."""
        require_casadi("an optimal control problem")
        if fields:
            return object.__new__(cls)
        from .declaration.problem import ControlProblemBuilder

        return ControlProblemBuilder(name, cls)

    def __init__(self, name: str = "", *, definition: Any = None) -> None:
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "definition", definition)
        self.__post_init__()

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Definition]]:
        return (self.name,), {"definition": self.definition}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the definition's canonical JSON text, in hexadecimal."""
        return hashlib.sha256(f"{self.kind}\0{self.definition.text}".encode()).hexdigest()

    def given(self, **values: Any) -> OptimalControlProblem:
        """Return the problem with other values of its data, such as ``ocp.given(x0=[1.0, 0.0])``.

        Parameters
        ----------
        **values
            New values by name: a number, or an array of the size of the data.

        Raises
        ------
        InvalidData
            A name is not data of the problem, or a value has another size or is not finite.
        """
        return type(self)(self.name, definition=self.definition.given(values))

    def scenarios(self, data: Any, **options: Any) -> OptimalControlProblem:
        """Return the problem of one control for several realisations of the data; see :func:`.scenarios`."""
        from .scenario import scenarios

        return scenarios(self, data, **options)  # type: ignore[no-any-return]

    @property
    def objective_unit(self) -> str:  # type: ignore[override]
        """Unit of the objective."""
        return self.definition.objective_unit

    def verify(self, plan: ControlPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and every constraint, with the motion re-integrated.

        The control is integrated with DOP853 from the plan's initial state, and the result is compared
        with the plan's states. Bounds and path constraints are evaluated on a dense grid between the
        nodes, boundary conditions at the ends, and invariants along the motion. Integrals are computed
        by adaptive quadrature.

        The last results are cached for equal definition, tolerance and plan.
        """
        definition = self.definition
        return cached_verification(
            self, (definition, tolerance), plan, lambda: verify_control(definition, plan, tolerance)
        )

    def plan_from_data(self, data: Any) -> ControlPlan:
        """Return the plan in `data`, with the declarations of the problem if they fit.

        `data` may also be samples of another tool, such as ``{"time": …, "x": …, "u": …}``; see
        ``samples.plan_of_samples``.
        """
        if is_sampled(self.definition, data):
            return plan_of_samples(self.definition, data)
        plan = super().plan_from_data(data)
        try:
            return self.attach(plan)
        except InvalidData:  # the verification reports the reason
            return plan

    def attach(self, plan: ControlPlan) -> ControlPlan:
        """Return `plan` with the declarations, so that ``plan[name]`` also gives outputs and path constraints.

        Raises
        ------
        InvalidData
            The phases, names or parameters of the plan differ from those of the problem.
        """
        courses(self.definition, plan)
        return plan.attached(self.definition)

    def details(self, plan: ControlPlan) -> list[dict[str, Any]]:
        """Return the switching structure of `plan`, one row per arc; see :func:`.structure`."""
        from .arcs import structure

        return [asdict(arc) for arc in structure(self, plan)]

    def describe(self) -> str:
        """Return the size in a few words."""
        phases = self.definition.phases
        states = sum(len(phase.state_names) for phase in phases)
        algebraic = sum(algebraic_entries(phase.controls).size for phase in phases)
        controls = sum(len(phase.control_names) for phase in phases) - algebraic
        text = f"{len(phases)} phase{'s' * (len(phases) > 1)}, {states} states, {controls} controls"
        return text + (f", {algebraic} algebraic variables" if algebraic else "")


def cached_verification(
    model: Model[ControlPlan], key: Any, plan: Any, verify: Callable[[], Verification]
) -> Verification:
    """Return the cached verification of an equal plan with an equal `key`, otherwise the result of `verify`."""
    whole = key, _fingerprint(plan)
    cached: list[tuple[Any, Verification]] = model.__dict__.setdefault("_verified", [])
    for known, verification in cached if isinstance(plan, ControlPlan) else ():
        if known == whole:
            return verification
    result = verify()
    cached[:] = [(whole, result), *cached[: CACHED - 1]]
    return result


def _fingerprint(plan: Any) -> bytes:
    """Return a digest of all numbers of a plan that its motion depends on, without costates."""
    hasher = hashlib.sha256()
    if isinstance(plan, ControlPlan):
        for name, value in sorted(plan.parameters.items()):
            hasher.update(repr((name, value.shape)).encode() + value.tobytes())
        for phase in plan.phases:
            hasher.update(repr((phase.name, phase.state_names, phase.control_names)).encode())
            for part in (phase.states, phase.controls):
                for array in (part.knots, *part.nodes, *part.values, part.lower, part.upper):
                    hasher.update(b"none" if array is None else repr(array.shape).encode())
                    hasher.update(b"" if array is None else array.tobytes())
    return hasher.digest()
