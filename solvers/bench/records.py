"""The records of a campaign: every answer as it was written, and what they amount to."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ...errors import CrosstrackError, InvalidData
from ...files import as_path, read_text
from ..solution import Solution
from ..verdict import Outcome, Verdict, judge

__all__ = ["Records", "read_records"]


@dataclass(frozen=True)
class Records:
    """Answers of several backends on several instances.

    Parameters
    ----------
    solutions : tuple of Solution
        Every answer, by instance in the order of the first answers.
    title : str
        For people.
    interrupted : bool
        Whether Ctrl-C ended the campaign; what had been finished is there.
    """

    solutions: tuple[Solution[Any], ...]
    title: str = ""
    interrupted: bool = False

    @cached_property
    def verdicts(self) -> tuple[Verdict, ...]:
        """A verdict an instance: the answers to one model, whatever formulation, seed or limit."""
        return tuple(judge(found[0].instance, found) for found in self.by_instance.values())

    @cached_property
    def by_instance(self) -> dict[str, tuple[Solution[Any], ...]]:
        """The answers by the digest of the model that they answer."""
        groups: dict[str, list[Solution[Any]]] = {}
        for one in self.solutions:
            groups.setdefault(one.digest, []).append(one)
        return {digest: tuple(found) for digest, found in groups.items()}

    @property
    def outcome(self) -> Outcome:
        """The worst of the verdicts: one contradiction makes it a contradiction."""
        outcomes = {verdict.outcome for verdict in self.verdicts}
        for outcome in (Outcome.CONTRADICTION, Outcome.INCONCLUSIVE):
            if outcome in outcomes:
                return outcome
        return Outcome.AGREED if outcomes and not self.interrupted else Outcome.INCONCLUSIVE

    def to_dict(self) -> dict[str, Any]:
        """Return the verdicts as JSON data, without the answers, which the record holds."""
        return {
            "title": self.title,
            "verdict": str(self.outcome),
            "interrupted": self.interrupted,
            "answers": len(self.solutions),
            "instances": [
                {
                    "instance": one.instance,
                    "verdict": str(one.outcome),
                    "evidence": one.evidence,
                    "notes": list(one.notes),
                }
                for one in self.verdicts
            ],
        }

    def parts(self) -> list[Any]:
        """Return what to print: the verdicts counted, and each that is a contradiction."""
        counts = Counter(one.outcome for one in self.verdicts)
        words = ", ".join(f"{counts[one]} {one}" for one in Outcome if counts[one])
        lines = [f"{len(self.solutions)} answers on {len(self.verdicts)} instances: {words}"]
        lines += [
            f"{one.outcome}: {one.instance}: {one.evidence}"
            for one in self.verdicts
            if one.outcome is Outcome.CONTRADICTION
        ]
        if self.interrupted:
            lines.append("interrupted: what is missing was not run")
        return ["\n".join(lines)]


def read_records(path: str | os.PathLike[str], *, title: str = "") -> Records:
    """Return the records in a JSON-lines file that a campaign or ``compare(record=…)`` wrote.

    A last line that was cut off in the middle is left out.

    Raises
    ------
    InvalidData
        The file cannot be read, or a line is no answer; the message names it.
    """
    file = as_path(path)
    text = read_text(file)
    found: list[Solution[Any]] = []
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            found.append(Solution.from_dict(json.loads(line)))
        except (ValueError, CrosstrackError, RecursionError) as error:
            if number == len(lines):
                continue
            raise InvalidData(f"{file}, line {number}: no answer of a campaign: {error}") from None
    return Records(tuple(found), title or Path(file).stem)
