"""Result of :func:`crosstrack.solve`: a verified plan, its bounds, and a record of the run."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.conversion import as_model
from ...models.fields import Real
from ...models.model import Model
from ...models.problems import model_type, resolve
from ...models.verification import ROUNDING, TOLERANCE, Verification, stated
from .enums import CLAIMS_NONE, Guarantee, Limit, Termination

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["Incumbent", "Solution", "relative_gap", "without_rounding"]

PlanT = TypeVar("PlanT")


def relative_gap(primal: float | None, dual: float | None) -> float | None:
    """Return the relative gap ``max(0, primal - dual) / max(|primal|, |dual|, 1e-10)``.

    This formula is used for all solvers, whatever their own definition. A gap of 0 means proven
    optimal. Gaps up to 1e-12 are due to rounding and returned as 0.

    Parameters
    ----------
    primal : float, optional
        Objective of a plan.
    dual : float, optional
        Lower bound on the objective.

    Returns
    -------
    float or None
        None if a bound is missing or not finite.
    """
    for name, bound in (("primal", primal), ("dual", dual)):
        if bound is not None and not isinstance(bound, float):
            Real().coerce(name, bound, {})
    if primal is None or dual is None or not math.isfinite(primal) or not math.isfinite(dual):
        return None
    gap = max(0.0, primal - dual) / max(abs(primal), abs(dual), 1e-10)
    return gap if gap > 1e-12 else 0.0


def without_rounding(dual: float, verification: Verification, tolerance: float) -> float:
    """Return `dual`, or the verified objective if the bound exceeds it by rounding only.

    Rounding includes that of a solver, which satisfies rows and multipliers up to `tolerance`: the
    same share of the objective, at most 1e-6. A larger excess is a contradiction and is kept.

    Parameters
    ----------
    dual : float
        Lower bound.
    verification : Verification
        Verification of the plan.
    tolerance : float
        Tolerance of the run.
    """
    primal = verification.objective
    if primal is None:
        return dual
    share = min(tolerance, TOLERANCE)
    explained = max(share * abs(primal), ROUNDING * verification.scale, verification.negligible)
    return primal if primal < dual <= primal + explained else dual


@dataclass(frozen=True)
class Incumbent(Generic[PlanT]):
    """Improved plan reported during a run.

    Parameters
    ----------
    seconds : float
        Seconds since the start of the run.
    objective : float
        Objective as claimed by the backend.
    plan : PlanT, optional
        The plan if it could be decoded.
    evaluations : int, optional
        Evaluations of the objective up to this plan, if the backend counts them.
    """

    seconds: float
    objective: float
    plan: PlanT | None = None
    evaluations: int | None = None


@dataclass(frozen=True, eq=False)
class Solution(Generic[PlanT]):
    """Verified answer of one backend.

    Parameters
    ----------
    model : str
        Kind of the model.
    instance : str
        Name of the model.
    digest : str
        Digest of the model.
    backend : str
        Name of the backend.
    formulation : str, optional
        Name of the formulation; None for a native algorithm.
    problem : str
        Problem of a native algorithm; empty for a solver of programs.
    guarantee : Guarantee, optional
        Strength of the backend's claims; None in records of versions that did not store it.
    termination : Termination
        Status of the answer.
    limit : Limit, optional
        Limit that ended the run.
    primal_bound : float, optional
        Verified objective of `plan`.
    dual_bound : float, optional
        Lower bound on the objective of every plan, from an exact backend or a relaxation.
    plan : PlanT, optional
        The plan. It has passed verification.
    verification : Verification, optional
        Result of the verification; for a rejected plan, the reason.
    seconds : mapping
        ``total`` is the wall-clock time of the call, including compilation, the start of a worker,
        the building of programs and the verification. The others are parts of it: ``compile`` if
        loops were compiled, ``build``, ``solve``, ``decode``, ``verify``, ``refine``. The parts of
        several starts are summed.
    incumbents : tuple of Incumbent
        Improved plans in the order of their discovery.
    backend_version, version : str
        Versions of the solver and of crosstrack.
    options : mapping
        All options of the run.
    formulation_options : mapping
        Options of the formulation.
    seed : int, optional
        Random seed of the run.
    statistics : mapping
        Counts and measurements of the backend.
    message : str
        Remarks for the user.
    rejected_plan : object, optional
        JSON data of the plan that failed verification.
    starts : tuple of Solution
        All results of a multistart, including this one, the best.
    duals : ndarray, optional
        Row multipliers of a continuous program, with the signs of
        :meth:`crosstrack.models.programs.linear.MixedIntegerProgram.dual_bound`.
    history : tuple of mapping
        One row per program if the formulation is refined: for a mesh its intervals, nodes, error,
        objective, seconds, and the next step with its reason.
    environment : mapping
        Machine of the run, for comparisons: machine, system, processor and number of processors,
        memory (GiB), versions, requested threads, system load at the start, and whether the
        process was warm.
    maximise : bool
        Whether the author of the model maximises the negated objective; see :attr:`value`.
    proof : str
        Kind of evidence for `dual_bound`, or for the claim that a program is infeasible or unbounded:
        a value of :class:`~crosstrack.models.programs.certificates.Proof`; empty for models that are
        not programs.
    source : Model, optional
        The model, for :attr:`values` and :meth:`assign`; None in records loaded without it.
    stored_plan : object
        The plan as JSON data, or a function that returns it. Conversion is deferred because a long
        plan consists of many small lists.
    """

    model: str
    instance: str
    digest: str
    backend: str
    termination: Termination
    formulation: str | None = None
    problem: str = ""
    guarantee: Guarantee | None = None
    limit: Limit | None = None
    primal_bound: float | None = None
    dual_bound: float | None = None
    plan: PlanT | None = None
    verification: Verification | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    incumbents: tuple[Incumbent[PlanT], ...] = ()
    backend_version: str | None = None
    version: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    formulation_options: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    statistics: Mapping[str, Any] = field(default_factory=dict)
    message: str = ""
    rejected_plan: Any = None
    starts: tuple[Solution[PlanT], ...] = ()
    duals: NDArray[np.float64] | None = None
    stored_plan: Any = None
    history: tuple[Mapping[str, Any], ...] = ()
    environment: Mapping[str, Any] = field(default_factory=dict)
    maximise: bool = False
    proof: str = ""
    source: Any = field(default=None, repr=False)

    @cached_property
    def plan_data(self) -> Any:
        """Plan as JSON data; None without a plan."""
        return self.stored_plan() if callable(self.stored_plan) else self.stored_plan

    @property
    def gap(self) -> float | None:
        """Relative gap between the bounds, see :func:`relative_gap`."""
        return relative_gap(self.primal_bound, self.dual_bound)

    @property
    def value(self) -> float | None:
        """Objective of the plan as the author of the model states it: negated for a maximisation."""
        return stated(self.primal_bound, self.maximise)

    @property
    def bound(self) -> float | None:
        """Proven bound on :attr:`value`: from below, or from above for a maximisation."""
        return stated(self.dual_bound, self.maximise)

    @property
    def values(self) -> dict[str, Any]:
        """Values of the plan by name.

        For a program they are the values of the author's variables, for other models the fields of the
        plan. Raises :class:`~crosstrack.errors.InvalidData` without a plan or its model.
        """
        result: dict[str, Any] = self._planned("values").values_of(self.plan)
        return result

    def assign(self) -> None:
        """Set the values of the plan in the object that was converted to the model.

        The variables, the multipliers of the constraints, the value and the status of a
        ``cvxpy.Problem`` are set as by its own ``solve``, also if it is infeasible or unbounded. Variables
        of a CasADi ``Opti`` get initial values.

        Raises
        ------
        InvalidData
            The solution has no plan and is not that of an infeasible or unbounded ``cvxpy.Problem``, or the
            model was not made from an object that stores values.
        """
        source = getattr(self.source, "source", None)
        if self.termination not in CLAIMS_NONE or not getattr(source, "ends", False):
            self._planned("assign")
        if source is None or source.assign is None:
            raise InvalidData(
                f"assign: model {self.model!r} was not made from an object that stores values; read them "
                "from the attribute values",
                field="source",
            )
        source.assign(self.plan, self.duals, self.value, str(self.termination))

    def _planned(self, what: str) -> Any:
        """Return the model of the plan, or raise."""
        if self.plan is None and self.stored_plan is None:
            raise InvalidData(f"{what}: there is no plan ({self.termination})", field="plan")
        if self.source is None:
            raise InvalidData(
                f"{what}: the record was loaded without its model: pass model= to load it",
                field="source",
            )
        return self.source

    def sensitivity(self, name: str) -> Any:
        """Return the derivatives of an optimal control solution with respect to the data `name`.

        The result is a ``Sensitivity``. It raises :class:`~crosstrack.errors.NoDerivative` if the optimum
        is not a differentiable function of the data, and ``InvalidData`` for other solutions or names.
        """
        return resolve(".solvers.optimal_control.optimum:sensitivity")(self, name)

    @property
    def verified(self) -> bool:
        """Whether the solution has a plan, which is always verified."""
        return self.plan is not None

    def lasting(self, seconds: float) -> Solution[PlanT]:
        """Return the solution with `seconds` as its total time."""
        solution = copy.copy(self)
        object.__setattr__(solution, "seconds", {**self.seconds, "total": seconds})
        return solution

    def to_dict(self) -> dict[str, Any]:
        """Return the solution as JSON data, keyed by the names of the fields."""
        from .stored import solution_data

        return solution_data(self)

    def to_json(self, *, indent: int | None = None) -> str:
        """Return the solution as a JSON text.

        Parameters
        ----------
        indent : int, optional
            Spaces per level; None for a single line.
        """
        return json.dumps(self.to_dict(), indent=indent, allow_nan=False, ensure_ascii=False)

    @classmethod
    def from_dict(
        cls, data: Mapping[str, Any], model: Model[PlanT] | None = None
    ) -> Solution[PlanT]:
        """Return the solution written by :meth:`to_dict`.

        The content is not verified again, unlike with :meth:`load` and :func:`crosstrack.verify`.

        Parameters
        ----------
        data : mapping
            JSON data.
        model : Model, optional
            The model of the solution. With it, :attr:`plan` is restored; without it, only
            :attr:`plan_data` is available.

        Raises
        ------
        InvalidData
            The data are invalid, or belong to another model.
        """
        from .stored import solution_fields

        if model is not None:
            model = as_model(model)
        fields = solution_fields(data)
        if model is not None and fields["digest"] != model.digest:
            raise InvalidData(
                f"the solution is for digest {fields['digest'][:12]}, the model has {model.digest[:12]}",
                field="digest",
            )
        plan, verification = fields["plan"], fields["verification"]
        return cls(
            **{
                **fields,
                "plan": None if model is None or plan is None else model.plan_from_data(plan),
                "stored_plan": plan,
                "source": model,
                "verification": None
                if verification is None
                else Verification.from_dict(verification),
                "incumbents": tuple(Incumbent(**entry) for entry in fields["incumbents"]),
                "starts": tuple(cls.from_dict(start, model) for start in fields["starts"]),
                "history": tuple(fields["history"]),
            }
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the solution as JSON and return the path. The file is replaced atomically.

        Parameters
        ----------
        path : str or path-like
            Name of the file.

        Raises
        ------
        InvalidData
            The file cannot be written.
        """
        from ...files import write_text

        return write_text(path, self.to_json(indent=2) + "\n")

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        model: Model[PlanT] | None = None,
        *,
        tolerance: float = TOLERANCE,
    ) -> Solution[PlanT]:
        """Return the solution written by :meth:`save`.

        Parameters
        ----------
        path : str or path-like
            Name of the file.
        model : Model, optional
            The model of the solution. With it, the plan is restored and verified. Without it, only
            :attr:`plan_data` is available, which is not verified.
        tolerance : float
            Largest accepted violation, relative to the scale that each check names. The tolerance
            stored in the file is not used.

        Raises
        ------
        InvalidData
            The file cannot be read, belongs to another model, or contains a false claim.
        """
        from ...files import read_text
        from ...models.json_text import parse_json

        model = None if model is None else as_model(model)
        solution = cls.from_dict(parse_json(read_text(path)), model)
        if model is None or solution.plan is None:
            return solution
        verification = model.verify(solution.plan, tolerance=tolerance)
        claimed, value = solution.primal_bound, verification.objective
        if not verification.ok or value is None:
            raise InvalidData(
                f"{path}: the plan does not hold: {verification.summary()}", field="plan"
            )
        if claimed is None or abs(claimed - value) > ROUNDING * max(abs(value), verification.scale):
            raise InvalidData(
                f"{path}: claims the objective {claimed!r}, its plan has {value!r}",
                field="primal_bound",
            )
        return replace(solution, verification=verification)

    def parts(self) -> list[Any]:
        """Return the printable parts: a table of the answer, the plan, its checks, and the message.

        The plan of a program is a table of its largest values by name.
        """
        from ..report.tables import solutions_table, values_parts, verification_table

        parts: list[Any] = [solutions_table([self], self.instance)]
        if self.proof:
            parts.append(f"proof: {self.proof}")
        if isinstance(self.plan, np.ndarray) and model_type(self.model).has_variables:
            parts += values_parts(self._planned("values").details(self.plan))
        elif self.plan is not None:
            parts.append(f"plan: {self.plan}{self._remark(' ({})')}")
        if self.verification is not None:
            parts.append(verification_table(self.verification))
        return [*parts, f"message: {self.message}"] if self.message else parts

    def summary(self) -> str:
        """Return the answer, the plan and all checks as text."""
        from ..report.tables import render

        return render(*self.parts())

    def to_frame(self) -> DataFrame:
        """Return the answer as a pandas data frame with one row. Requires pandas."""
        from ..report.tables import frame

        return frame([self])

    def _repr_html_(self) -> str:
        from ..report.tables import markup

        text = markup(*self.parts())
        if self.plan is None or self.source is None:
            return text
        view: str = resolve(".solvers.report.view.page:embed")(self)
        return text + view

    def _remark(self, form: str) -> str:
        """Return the model's short remark on the plan, inserted into `form`; empty without one."""
        remark = "" if self.plan is None else model_type(self.model).remark(self.plan)
        return form.format(remark) if remark else ""

    def __str__(self) -> str:
        head = f"{self.instance or self.model}: {self.backend}"
        head += f" on {self.formulation}" if self.formulation else ""
        parts = [f"{head}: {self.termination}"]
        if self.limit is not None:
            parts[0] += (
                f" ({self.limit} limit)" if self.limit != Limit.INTERRUPTED else " (interrupted)"
            )
        if self.proof and self.dual_bound is None:
            parts[0] += f" ({self.proof})"
        if self.primal_bound is not None:
            parts.append(f"objective {self.value:.10g}{self._remark(' ({})')}")
        if self.dual_bound is not None:
            kind = f" ({self.proof})" if self.proof else ""
            parts.append(f"bound {self.bound:.10g}{kind}")
        if self.gap is not None:
            parts.append(f"gap {self.gap:.2g}")
        if "solve" in self.seconds:
            parts.append(f"{self.seconds['solve']:.4g} s")
        if self.verification is not None:
            parts.append(f"verification {self.verification.summary()}")
        if self.message:
            parts.append(self.message)
        return ", ".join(parts)

    def __repr__(self) -> str:
        return f"<Solution {self}>"
