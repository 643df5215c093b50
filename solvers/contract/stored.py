"""Schema of a stored solution, as written by :meth:`Solution.to_dict`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...models.fields import Array, Optional, Real, Spec, Text, Whole
from ...models.records import Anything, Member, Sequence, Table, recorded
from .enums import Guarantee, Limit, Termination

__all__ = ["solution_fields"]

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
}
#: Values of absent entries: earlier versions did not write them, and small records omit empty ones.
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
