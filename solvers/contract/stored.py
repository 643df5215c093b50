"""Schema of a stored solution, as written by :meth:`Solution.to_dict`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ...models.fields import Array, Flag, Optional, Real, Spec, Text, Whole
from ...models.records import Anything, Member, Sequence, Table
from ...models.stored import recorded
from .enums import Guarantee, Limit, Termination

__all__ = ["solution_data", "solution_fields"]

_WORD, _NUMBER, _TABLE = Text(), Optional(Real()), Table()
#: Specification of each entry.
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
    "maximise": Flag(),
    "proof": _WORD,
}
#: Values of absent entries: earlier versions did not write them, and small records omit empty ones.
_ABSENT: dict[str, Any] = {
    **dict.fromkeys(("problem", "message"), ""),
    **dict.fromkeys(("guarantee", "formulation", "backend_version", "limit", "dual_bound"), None),
    **dict.fromkeys(("rejected_plan", "seed", "duals"), None),
    "environment": {},
    "maximise": False,
    "proof": "",
    "formulation_options": {},
    "statistics": {},
    **dict.fromkeys(("incumbents", "starts", "history"), ()),
}
_INCUMBENT: dict[str, Spec] = {
    "seconds": Real(),
    "objective": Real(),
    "evaluations": Optional(Whole(1)),
}


def solution_fields(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the checked entries of a stored solution by field, its incumbents as entries, too.

    Raises
    ------
    InvalidData
        An entry is missing or invalid.
    """
    fields = recorded("a solution", data, _RECORD, _ABSENT)
    fields["incumbents"] = [
        recorded("an incumbent", incumbent, _INCUMBENT, {"evaluations": None})
        for incumbent in fields["incumbents"]
    ]
    return fields


def solution_data(solution: Any) -> dict[str, Any]:
    """Return a :class:`~.solution.Solution` as JSON data, keyed by the names of the fields."""
    return {
        "model": solution.model,
        "instance": solution.instance,
        "digest": solution.digest,
        "backend": solution.backend,
        "formulation": solution.formulation,
        "problem": solution.problem,
        "guarantee": None if solution.guarantee is None else str(solution.guarantee),
        "termination": str(solution.termination),
        "limit": None if solution.limit is None else str(solution.limit),
        "primal_bound": _finite(solution.primal_bound),
        "dual_bound": _finite(solution.dual_bound),
        "gap": _finite(solution.gap),
        "plan": solution.plan_data,
        "verification": None if solution.verification is None else solution.verification.to_dict(),
        "seconds": dict(solution.seconds),
        "incumbents": [
            {"seconds": i.seconds, "objective": i.objective}
            | ({} if i.evaluations is None else {"evaluations": i.evaluations})
            for i in solution.incumbents
        ],
        "backend_version": solution.backend_version,
        "version": solution.version,
        "options": dict(solution.options),
        "formulation_options": dict(solution.formulation_options),
        "seed": solution.seed,
        "statistics": {
            name: _finite(value) if isinstance(value, float) else value
            for name, value in solution.statistics.items()
        },
        "message": solution.message,
        "rejected_plan": solution.rejected_plan,
        "starts": [start.to_dict() for start in solution.starts],
        "duals": None if solution.duals is None else solution.duals.tolist(),
        # Written only if not empty, so that records of earlier versions keep their keys.
        **({"history": [dict(row) for row in solution.history]} if solution.history else {}),
        **({"environment": dict(solution.environment)} if solution.environment else {}),
        **({"maximise": True} if solution.maximise else {}),
        **({"proof": solution.proof} if solution.proof else {}),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
