"""Conditions of a comparison: machine, versions and options, which determine whether it is fair."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from .records import Records
from .standing import who

__all__ = ["describe_conditions"]

#: Options that determine the fairness of a comparison, with their names on the page.
_FAIRNESS = {
    "gap": "Requested relative gap", "tolerance": "Tolerance of the check",
    "time_limit": "Time limit (s)", "memory_limit": "Memory limit (MiB)", "evaluations": "Evaluation limit",
    "threads": "Requested threads",
}  # fmt: skip
#: Names of entries of an environment, with their units.
_NAMES = {"memory": "Memory (GiB)"}
#: Entries of an environment that the page shows in other places.
_TOLD = {"backend", "threads", "crosstrack"}


def describe_conditions(records: Records) -> str:
    """Return an HTML table of the conditions of all runs.

    Parameters
    ----------
    records : Records
        The answers.
    """
    rows: list[tuple[str, str]] = []
    solutions = records.solutions
    values = {name: {_plain(s.options.get(name)) for s in solutions} for name in _FAIRNESS}
    rows += [(word, _several(values[name])) for name, word in _FAIRNESS.items()]
    if records.uneven:
        words = (
            f"on {len(records.uneven):,} of {len(records.verdicts):,} instances limits or tolerances differ: "
            "seconds there are not comparable"
        )
        rows.append(("Unequal options", words))
    repeats = max(Counter((s.model, s.instance, s.digest, who(s)) for s in solutions).values())
    rows.append(("Runs of a backend on an instance", f"1 to {repeats:,}" if repeats > 1 else "1"))
    rows.append(("Seeds", _several({_plain(s.seed) for s in solutions})))
    facts: dict[str, set[str]] = {}
    for s in solutions:
        for name, entry in (getattr(s, "environment", None) or {}).items():
            if isinstance(entry, Mapping) or name in _TOLD:
                continue
            facts.setdefault(str(name), set()).add(_plain(entry))
    rows += [
        (_NAMES.get(name, name.replace("_", " ").capitalize()), _several(entries))
        for name, entries in facts.items()
    ]
    if not facts:
        rows.append(("Machine", "not recorded"))
    rows.append(("crosstrack", _several({s.version for s in solutions})))
    versions: dict[str, set[str]] = {}
    for s in solutions:
        if s.backend_version:
            versions.setdefault(s.backend, set()).add(s.backend_version)
    backends = ", ".join(
        f"{name} {' and '.join(sorted(versions[name]))}" for name in sorted(versions)
    )
    rows.append(("Backends", backends or "not recorded"))
    body = "".join(
        f"<tr><th scope='row'>{escape(a)}</th><td class='long'>{escape(b)}</td></tr>"
        for a, b in rows
    )
    return f'<div class="scroll"><table>{body}</table></div>'


def _plain(value: Any) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _several(values: Iterable[str]) -> str:
    """Return values as text; more than 6 numbers as their range."""
    distinct = sorted(set(values))
    texts = [value for value in distinct if value]
    none = " (some runs: none)" if texts and "" in distinct else ""
    if len(texts) > 6:
        try:
            numbers = sorted(map(float, texts))
            return f"{numbers[0]:g} to {numbers[-1]:g}{none}"
        except ValueError:
            return f"{', '.join(texts[:6])} and {len(texts) - 6} more{none}"
    return ", ".join(texts) + none if texts else "none"
