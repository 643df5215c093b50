"""Records of a campaign: all answers, verdicts and standings."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from ...errors import CrosstrackError, InvalidData
from ...files import as_path, read_bytes
from ...models.fields import show
from ..contract.solution import Solution
from ..contract.verdict import Outcome, Verdict, judge, worst_outcome
from ..run.recording import lines_of
from .markup import many
from .standing import Standing, rank, standings_table, who

__all__ = ["Records", "read_records"]

#: Largest size of a record in bytes: about a million short answers.
LARGEST = 4 << 30


@dataclass(frozen=True)
class Records:
    """Answers of several backends on several instances.

    Parameters
    ----------
    solutions : tuple of Solution
        All answers, by instance in the order of the first answers.
    title : str
        Title of the report.
    interrupted : bool
        Whether Ctrl-C ended the campaign. Finished answers are included.
    """

    solutions: tuple[Solution[Any], ...]
    title: str = ""
    interrupted: bool = False

    @cached_property
    def verdicts(self) -> tuple[Verdict, ...]:
        """One verdict per instance: on the answers to one model with any formulation, seed or limit."""
        return tuple(judge(answers[0].instance, answers) for answers in self.by_instance.values())

    @cached_property
    def by_instance(self) -> dict[str, tuple[Solution[Any], ...]]:
        """Answers by digest of the model."""
        groups: dict[str, list[Solution[Any]]] = {}
        for solution in self.solutions:
            groups.setdefault(solution.digest, []).append(solution)
        return {digest: tuple(answers) for digest, answers in groups.items()}

    @cached_property
    def standings(self) -> dict[str, list[Standing]]:
        """Standings of the backends by kind of model, the leading one first."""
        kinds = sorted({verdict.solutions[0].model for verdict in self.verdicts})
        return {
            kind: rank([v for v in self.verdicts if v.solutions[0].model == kind]) for kind in kinds
        }

    @cached_property
    def uneven(self) -> tuple[str, ...]:
        """Instances whose answers have different time limits or tolerances."""
        return tuple(
            verdict.instance
            for verdict in self.verdicts
            if any(
                len({s.options.get(name) for s in verdict.solutions}) > 1
                for name in ("time_limit", "tolerance")
            )
        )

    @property
    def outcome(self) -> Outcome:
        """Worst outcome of all verdicts, so a single contradiction decides."""
        return worst_outcome(self.verdicts, self.interrupted)

    def among(self, *backends: str) -> Records:
        """Return the answers of some backends on the instances that all of them ran on.

        Parameters
        ----------
        *backends : str
            Names, or ``"name:formulation"`` for one of several formulations.

        Raises
        ------
        InvalidData
            The records have no answer of one of them, or no instance that all of them ran on.
        """
        ran: dict[str, set[str]] = {name: set() for name in backends}
        for solution in self.solutions:
            for name in {solution.backend, who(solution)} & ran.keys():
                ran[name].add(solution.digest)
        for name, digests in ran.items():
            if not digests:
                known = sorted({who(solution) for solution in self.solutions})
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
        selected = [
            solution
            for solution in self.solutions
            if solution.digest in shared and {solution.backend, who(solution)} & ran.keys()
        ]
        return replace(self, solutions=tuple(selected))

    def to_dict(self) -> dict[str, Any]:
        """Return verdicts and standings as JSON data, without the answers."""
        return {
            "title": self.title,
            "verdict": str(self.outcome),
            "interrupted": self.interrupted,
            "uneven": list(self.uneven),
            "answers": len(self.solutions),
            "instances": [
                {
                    "instance": item.instance,
                    "verdict": str(item.outcome),
                    "evidence": item.evidence,
                    "notes": list(item.notes),
                }
                for item in self.verdicts
            ],
            "problems": [
                {"problem": kind, "backends": [standing.to_dict() for standing in standings]}
                for kind, standings in self.standings.items()
            ],
        }

    def parts(self) -> list[Any]:
        """Return the printable parts: leaders per problem, counts of verdicts, contradictions."""
        counts = Counter(item.outcome for item in self.verdicts)
        words = ", ".join(f"{counts[item]} {item}" for item in Outcome if counts[item])
        lines = [
            f"{many(len(self.solutions), 'answer')} on {many(len(self.verdicts), 'instance')}: {words}"
        ]
        lines += [
            f"{item.outcome}: {item.instance}: {item.evidence}"
            for item in self.verdicts
            if item.outcome is Outcome.CONTRADICTION
        ]
        if self.uneven:
            lines.append(
                f"unequal options, so that seconds are not comparable: {len(self.uneven)} of the instances, "
                f"such as {self.uneven[0]}"
            )
        if self.interrupted:
            lines.append("interrupted: missing answers were not run")
        return [standings_table(self.standings), "\n".join(lines)]


def read_records(path: str | os.PathLike[str], *, title: str = "") -> Records:
    """Return the records in a JSON-lines file of a campaign or of ``compare(record=…)``.

    A truncated last line is ignored. If a job was run again, its last answer is used.

    Parameters
    ----------
    path : str or path-like
        Name of the file.
    title : str
        Title of the report. Default: name of the file.

    Raises
    ------
    InvalidData
        The file cannot be read, or a line is not an answer; the message gives its number.
    """
    file = as_path(path)
    content = read_bytes(file, LARGEST)
    if len(content) > LARGEST:
        raise InvalidData(f"{file}: holds more than {LARGEST} bytes")
    solutions: dict[Any, Solution[Any]] = {}
    for number, data in lines_of(content, file)[0]:
        key = data.get("key")
        try:
            solutions[key if isinstance(key, str) else number] = Solution.from_dict(data)
        except CrosstrackError as error:
            raise InvalidData(
                f"{file}, line {number}: not an answer of a campaign: {error}"
            ) from None
    return Records(tuple(solutions.values()), title or file.stem)
