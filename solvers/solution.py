"""What :func:`crosstrack.solve` returns: a plan, what was proven about it, and how it came about."""

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

from ..errors import InvalidData
from ..files import read_text, write_text
from ..models.fields import Array, Optional, Real, Spec, Text, Whole
from ..models.model import Model, as_model, parse_json
from ..models.problems import model_type
from ..models.records import Anything, Member, Sequence, Table, recorded
from ..models.verification import ROUNDING, TOLERANCE, Verification
from .enums import Guarantee, Limit, Termination
from .report.tables import frame, markup, render, solutions_table, verification_table

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["NOTHING", "Incumbent", "Solution", "relative_gap", "without_rounding"]

PlanT = TypeVar("PlanT")

#: Difference between objective and bound, in the objective's unit, that rounding explains.
NOTHING = 1e-9


def relative_gap(primal: float | None, dual: float | None) -> float | None:
    """Return ``max(0, primal - dual) / max(|primal|, |dual|, 1e-10)``, None without both bounds.

    The one formula for the gap, whatever a solver's own may be; 0 means proven optimal. What
    rounding explains (1e-12) is 0.
    """
    for name, bound in (("primal", primal), ("dual", dual)):
        if bound is not None and not isinstance(bound, float):
            Real().coerce(name, bound, {})
    if primal is None or dual is None or not math.isfinite(primal) or not math.isfinite(dual):
        return None
    gap = max(0.0, primal - dual) / max(abs(primal), abs(dual), 1e-10)
    return gap if gap > 1e-12 else 0.0


def without_rounding(dual: float, verification: Verification, tolerance: float) -> float:
    """Return `dual`, or the verified objective where the bound stands above it by rounding alone.

    Rounding is a solver's too, which keeps rows and multipliers to `tolerance`: a share of the
    objective as large, and never more than 1e-6. What is more stays: the two contradict one another,
    which must be seen.
    """
    primal = verification.objective
    if primal is None:
        return dual
    share = min(tolerance, TOLERANCE)
    explained = max(share * abs(primal), ROUNDING * verification.scale, NOTHING)
    return primal if primal < dual <= primal + explained else dual


_WORD, _NUMBER, _TABLE = Text(), Optional(Real()), Table()
#: What a stored solution holds, as :meth:`Solution.to_dict` writes it.
_RECORD: dict[str, Spec] = {
    **dict.fromkeys(("model", "instance", "digest", "backend", "version", "message"), _WORD),
    **dict.fromkeys(("formulation", "backend_version"), Optional(_WORD)),
    "problem": _WORD,
    "guarantee": Optional(Member(Guarantee)),
    "termination": Member(Termination),
    "limit": Optional(Member(Limit)),
    **dict.fromkeys(("primal_bound", "dual_bound"), _NUMBER),
    **dict.fromkeys(("plan", "rejected_plan", "verification"), Anything()),
    "seconds": Table(others=Real()),
    "options": Table(
        {
            **dict.fromkeys(("gap", "tolerance", "time_limit", "memory_limit"), _NUMBER),
            "repeat": Optional(Whole(0)),
        }
    ),
    **dict.fromkeys(("formulation_options", "statistics", "environment"), _TABLE),
    **dict.fromkeys(("incumbents", "starts", "history"), Sequence()),
    "seed": Optional(Whole()),
    "duals": Optional(Array(("rows",))),
}
#: What stands for an entry that is absent: earlier versions did not write it, or who keeps records small
#: has left out what says nothing.
_ABSENT: dict[str, Any] = {
    **dict.fromkeys(("problem", "message"), ""),
    **dict.fromkeys(("guarantee", "formulation", "backend_version", "limit", "dual_bound"), None),
    **dict.fromkeys(("rejected_plan", "seed", "duals"), None),
    "environment": {},
    "formulation_options": {},
    "statistics": {},
    **dict.fromkeys(("incumbents", "starts", "history"), ()),
}
_INCUMBENT: dict[str, Spec] = {
    "seconds": Real(),
    "objective": Real(),
    "evaluations": Optional(Whole(1)),
}


@dataclass(frozen=True)
class Incumbent(Generic[PlanT]):
    """A better plan met on the way.

    Parameters
    ----------
    seconds : float
        Since the start of the run.
    objective : float
        As the backend claims it.
    plan : PlanT, optional
        The plan, where it could be decoded.
    evaluations : int, optional
        Of the objective, up to this plan, where the backend counts them.
    """

    seconds: float
    objective: float
    plan: PlanT | None = None
    evaluations: int | None = None


@dataclass(frozen=True, eq=False)
class Solution(Generic[PlanT]):
    """One answer of one backend, verified.

    Parameters
    ----------
    model : str
        The model's kind.
    instance : str
        The model's name.
    digest : str
        The model's digest.
    backend : str
        Name of the backend.
    formulation : str, optional
        Name of the formulation; None for a native algorithm.
    problem : str
        The problem whose native algorithm the backend is; empty for a solver of programs.
    guarantee : Guarantee, optional
        What the backend's answers prove; None in records of versions that did not say.
    termination : Termination
        How the run ended.
    limit : Limit, optional
        The limit that ended it.
    primal_bound : float, optional
        The verified objective of `plan`.
    dual_bound : float, optional
        Lower bound on every plan's objective, of an exact backend or a relaxation.
    plan : PlanT, optional
        The plan; only ever one that passed verification.
    verification : Verification, optional
        What the independent check measured; for a rejected plan, why.
    seconds : mapping
        ``total`` is the whole call as the caller waited for it: compiling, the start of a worker,
        the building of programs and the verification included. The others are parts of it:
        ``compile`` where loops were compiled, ``build``, ``solve``, ``decode``, ``verify``,
        ``refine``. Parts of several starts are added up.
    incumbents : tuple of Incumbent
        Better plans over time.
    backend_version, version : str
        Versions of the solver and of crosstrack.
    options : mapping
        Everything that was asked of the run.
    formulation_options : mapping
        Options of the formulation.
    seed : int, optional
        The seed given.
    statistics : mapping
        Counts of the backend's own.
    message : str
        What a person should know.
    rejected_plan : object, optional
        JSON data of a plan that failed verification.
    starts : tuple of Solution
        All results of a multistart, this best one included.
    duals : ndarray, optional
        Row multipliers of a continuous program, signed as
        :meth:`crosstrack.models.programs.linear.MixedIntegerProgram.dual_bound` wants them.
    history : tuple of mapping
        A row for each program that was solved, where the formulation refines its program and tells of
        it: for a mesh its intervals, nodes, error, objective, seconds, and what was done then and why.
    environment : mapping
        Where it ran, for what several backends are compared on: machine, system, processor and how many
        there are, memory (GiB), versions, threads asked for, the system's load when it began, and
        whether the process was warm.
    stored_plan : object
        The plan as JSON data, or a function that returns it: a long plan is many small lists, which
        nobody should wait for who does not ask.
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

    @cached_property
    def plan_data(self) -> Any:
        """The plan as JSON data, None without one."""
        return self.stored_plan() if callable(self.stored_plan) else self.stored_plan

    @property
    def gap(self) -> float | None:
        """Relative gap between the bounds, by :func:`relative_gap`."""
        return relative_gap(self.primal_bound, self.dual_bound)

    @property
    def verified(self) -> bool:
        """Whether there is a plan (which is always a verified one)."""
        return self.plan is not None

    def lasting(self, seconds: float) -> Solution[PlanT]:
        """Return the solution of a call that took so many seconds in all."""
        found = copy.copy(self)
        object.__setattr__(found, "seconds", {**self.seconds, "total": seconds})
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the solution as JSON data, keyed by the fields' names."""
        return {
            "model": self.model,
            "instance": self.instance,
            "digest": self.digest,
            "backend": self.backend,
            "formulation": self.formulation,
            "problem": self.problem,
            "guarantee": None if self.guarantee is None else str(self.guarantee),
            "termination": str(self.termination),
            "limit": None if self.limit is None else str(self.limit),
            "primal_bound": _finite(self.primal_bound),
            "dual_bound": _finite(self.dual_bound),
            "gap": _finite(self.gap),
            "plan": self.plan_data,
            "verification": None if self.verification is None else self.verification.to_dict(),
            "seconds": dict(self.seconds),
            "incumbents": [
                {"seconds": i.seconds, "objective": i.objective}
                | ({} if i.evaluations is None else {"evaluations": i.evaluations})
                for i in self.incumbents
            ],
            "backend_version": self.backend_version,
            "version": self.version,
            "options": dict(self.options),
            "formulation_options": dict(self.formulation_options),
            "seed": self.seed,
            "statistics": {
                name: _finite(value) if isinstance(value, float) else value
                for name, value in self.statistics.items()
            },
            "message": self.message,
            "rejected_plan": self.rejected_plan,
            "starts": [start.to_dict() for start in self.starts],
            "duals": None if self.duals is None else self.duals.tolist(),
            # Written where there is one, so that records of earlier versions keep their keys.
            **({"history": [dict(row) for row in self.history]} if self.history else {}),
            **({"environment": dict(self.environment)} if self.environment else {}),
        }

    def to_json(self, *, indent: int | None = None) -> str:
        """Return the solution as JSON."""
        return json.dumps(self.to_dict(), indent=indent, allow_nan=False, ensure_ascii=False)

    @classmethod
    def from_dict(
        cls, data: Mapping[str, Any], model: Model[PlanT] | None = None
    ) -> Solution[PlanT]:
        """Return the solution that :meth:`to_dict` wrote.

        The plan comes back as an object where `model` is given, and only as :attr:`plan_data`
        otherwise. What the data claims stands, its verification too: :meth:`load` and
        :func:`crosstrack.verify` look at the plan anew.
        """
        if model is not None:
            model = as_model(model)
        found = recorded("a solution", data, _RECORD, _ABSENT)
        if model is not None and found["digest"] != model.digest:
            raise InvalidData(
                f"the solution is for digest {found['digest'][:12]}, the model has {model.digest[:12]}",
                field="digest",
            )
        plan, checked = found["plan"], found["verification"]
        return cls(
            **{
                **found,
                "plan": None if model is None or plan is None else model.plan_from_data(plan),
                "stored_plan": plan,
                "verification": None if checked is None else Verification.from_dict(checked),
                "incumbents": tuple(
                    Incumbent(**recorded("an incumbent", one, _INCUMBENT, {"evaluations": None}))
                    for one in found["incumbents"]
                ),
                "starts": tuple(cls.from_dict(start, model) for start in found["starts"]),
                "history": tuple(found["history"]),
            }
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the solution as JSON, in one step; return the path.

        Raises
        ------
        InvalidData
            The file cannot be written.
        """
        return write_text(path, self.to_json(indent=2) + "\n")

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        model: Model[PlanT] | None = None,
        *,
        tolerance: float = TOLERANCE,
    ) -> Solution[PlanT]:
        """Return the solution that :meth:`save` wrote.

        Parameters
        ----------
        path : str or path-like
            The file.
        model : Model, optional
            What it is a solution of. The plan comes back as an object then, and is verified anew;
            without it there is only :attr:`plan_data`, which nobody has looked at.
        tolerance : float
            Largest violation accepted, relative to the scale that each check names. It is yours to
            say: what the file was solved with does not count.

        Raises
        ------
        InvalidData
            The file cannot be read, is for another model, or claims what does not hold.
        """
        found = cls.from_dict(parse_json(read_text(path)), model)
        if model is None or found.plan is None:
            return found
        checked = model.verify(found.plan, tolerance=tolerance)
        claimed, value = found.primal_bound, checked.objective
        if not checked.ok or value is None:
            raise InvalidData(f"{path}: the plan does not hold: {checked.summary()}", field="plan")
        if claimed is None or abs(claimed - value) > ROUNDING * max(abs(value), checked.scale):
            raise InvalidData(
                f"{path}: claims the objective {claimed!r}, its plan has {value!r}",
                field="primal_bound",
            )
        return replace(found, verification=checked)

    def parts(self) -> list[Any]:
        """Return what to print: a table of the answer, the plan, its checks, and the message."""
        return [
            solutions_table([self], self.instance),
            *([f"plan: {self.plan}{self._remark(' ({})')}"] if self.plan is not None else []),
            *([verification_table(self.verification)] if self.verification is not None else []),
            *([f"message: {self.message}"] if self.message else []),
        ]

    def summary(self) -> str:
        """Return the answer, the plan and every check as text."""
        return render(*self.parts())

    def to_frame(self) -> DataFrame:
        """Return the answer as a pandas frame of one row; needs pandas."""
        return frame([self])

    def _repr_html_(self) -> str:
        return markup(*self.parts())

    def _remark(self, form: str) -> str:
        """Return what the model's type says of the plan in short, put into `form`."""
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
        if self.primal_bound is not None:
            parts.append(f"objective {self.primal_bound:.10g}{self._remark(' ({})')}")
        if self.dual_bound is not None:
            parts.append(f"bound {self.dual_bound:.10g}")
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


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
