"""The records of a campaign: every answer as it was written, and what they amount to."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from ...errors import CrosstrackError, InvalidData
from ...files import as_path, read_bytes
from ...models.fields import show
from ..campaign import lines_of
from ..solution import Solution
from ..verdict import Outcome, Verdict, judge
from .markup import many
from .standing import Standing, rank, standings_table, who

__all__ = ["Records", "read_records"]

#: Bytes that a record may hold: about a million short answers.
LARGEST = 4 << 30


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

    @cached_property
    def standings(self) -> dict[str, list[Standing]]:
        """How the backends stand, by kind of model; the leading one first."""
        kinds = sorted({one.solutions[0].model for one in self.verdicts})
        return {
            kind: rank([one for one in self.verdicts if one.solutions[0].model == kind])
            for kind in kinds
        }

    @cached_property
    def uneven(self) -> tuple[str, ...]:
        """Instances whose answers were asked for under different limits of time or tolerances."""
        return tuple(
            one.instance
            for one in self.verdicts
            if any(
                len({s.options.get(name) for s in one.solutions}) > 1
                for name in ("time_limit", "tolerance")
            )
        )

    @property
    def outcome(self) -> Outcome:
        """The worst of the verdicts: one contradiction makes it a contradiction."""
        outcomes = {verdict.outcome for verdict in self.verdicts}
        for outcome in (Outcome.CONTRADICTION, Outcome.INCONCLUSIVE):
            if outcome in outcomes:
                return outcome
        return Outcome.AGREED if outcomes and not self.interrupted else Outcome.INCONCLUSIVE

    def among(self, *backends: str) -> Records:
        """Return the answers of some backends alone, on the instances that all of them ran on.

        Parameters
        ----------
        *backends : str
            Names; ``"name:formulation"`` where one of several formulations is meant.

        Raises
        ------
        InvalidData
            The records have no answer of one of them, or there is no instance of all.
        """
        ran: dict[str, set[str]] = {name: set() for name in backends}
        for one in self.solutions:
            for name in {one.backend, who(one)} & ran.keys():
                ran[name].add(one.digest)
        for name, digests in ran.items():
            if not digests:
                known = sorted({who(one) for one in self.solutions})
                raise InvalidData(
                    f"backends: the records have no answer of {show(name)}; they have {', '.join(known)}",
                    field="backends",
                )
        shared = set.intersection(*ran.values()) if ran else set()
        if not shared:
            raise InvalidData(
                f"backends: no instance was run by all of {', '.join(backends) or 'none'}",
                field="backends",
            )
        kept = [
            one
            for one in self.solutions
            if one.digest in shared and {one.backend, who(one)} & ran.keys()
        ]
        return replace(self, solutions=tuple(kept))

    def to_dict(self) -> dict[str, Any]:
        """Return verdicts and standings as JSON data, without the answers, which the record holds."""
        return {
            "title": self.title,
            "verdict": str(self.outcome),
            "interrupted": self.interrupted,
            "uneven": list(self.uneven),
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
            "problems": [
                {"problem": kind, "backends": [one.to_dict() for one in standings]}
                for kind, standings in self.standings.items()
            ],
        }

    def parts(self) -> list[Any]:
        """Return what to print: who leads each problem, the verdicts counted, each contradiction."""
        counts = Counter(one.outcome for one in self.verdicts)
        words = ", ".join(f"{counts[one]} {one}" for one in Outcome if counts[one])
        lines = [
            f"{many(len(self.solutions), 'answer')} on {many(len(self.verdicts), 'instance')}: {words}"
        ]
        lines += [
            f"{one.outcome}: {one.instance}: {one.evidence}"
            for one in self.verdicts
            if one.outcome is Outcome.CONTRADICTION
        ]
        if self.uneven:
            lines.append(
                f"not asked for alike, so that seconds do not compare: {len(self.uneven)} of the instances, "
                f"such as {self.uneven[0]}"
            )
        if self.interrupted:
            lines.append("interrupted: what is missing was not run")
        return [standings_table(self.standings), "\n".join(lines)]


def read_records(path: str | os.PathLike[str], *, title: str = "") -> Records:
    """Return the records in a JSON-lines file that a campaign or ``compare(record=…)`` wrote.

    A last line that was cut off in the middle is left out; where a job was run again, its last answer counts.

    Raises
    ------
    InvalidData
        The file cannot be read, or a line is no answer; the message names it.
    """
    file = as_path(path)
    content = read_bytes(file, LARGEST)
    if len(content) > LARGEST:
        raise InvalidData(f"{file}: holds more than {LARGEST} bytes")
    found: dict[Any, Solution[Any]] = {}
    for number, data in lines_of(content, file)[0]:
        key = data.get("key")
        try:
            found[key if isinstance(key, str) else number] = Solution.from_dict(data)
        except CrosstrackError as error:
            raise InvalidData(f"{file}, line {number}: no answer of a campaign: {error}") from None
    return Records(tuple(found.values()), title or file.stem)
