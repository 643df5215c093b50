"""What a comparison ran on and what was asked of every run: whether it is fair."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from .records import Records
from .standing import who

__all__ = ["describe_conditions"]

#: Options that say how fair a comparison is, and what the page calls them.
_FAIRNESS = {
    "gap": "Relative gap asked for", "tolerance": "Tolerance of the check",
    "time_limit": "Time limit (s)", "memory_limit": "Memory limit", "evaluations": "Evaluations granted",
    "threads": "Threads asked for",
}  # fmt: skip
#: What an environment repeats of its answer, of which the page tells elsewhere.
_TOLD = {"backend", "threads", "crosstrack"}


def describe_conditions(records: Records) -> str:
    """Return what the comparison ran on, and what was asked of every run."""
    rows: list[tuple[str, str]] = []
    solutions = records.solutions
    asked = {name: {_plain(s.options.get(name)) for s in solutions} for name in _FAIRNESS}
    rows += [(word, _several(asked[name])) for name, word in _FAIRNESS.items()]
    if records.uneven:
        words = (
            f"on {len(records.uneven):,} of {len(records.verdicts):,} instances limits or tolerances differ: "
            "seconds there do not compare"
        )
        rows.append(("Not asked for alike", words))
    repeats = max(Counter((s.model, s.instance, s.digest, who(s)) for s in solutions).values())
    rows.append(("Runs of a backend on an instance", f"1 to {repeats:,}" if repeats > 1 else "1"))
    rows.append(("Seeds", _several({_plain(s.seed) for s in solutions})))
    facts: dict[str, set[str]] = {}
    for s in solutions:
        for name, value in (getattr(s, "environment", None) or {}).items():
            if isinstance(value, Mapping) or name in _TOLD:
                continue
            facts.setdefault(str(name), set()).add(_plain(value))
    rows += [
        (name.replace("_", " ").capitalize(), _several(found)) for name, found in facts.items()
    ]
    if not facts:
        rows.append(("Machine", "not recorded"))
    rows.append(("crosstrack", _several({s.version for s in solutions})))
    versions: dict[str, set[str]] = {}
    for s in solutions:
        if s.backend_version:
            versions.setdefault(s.backend, set()).add(s.backend_version)
    said = ", ".join(f"{name} {' and '.join(sorted(versions[name]))}" for name in sorted(versions))
    rows.append(("Backends", said or "not recorded"))
    body = "".join(
        f"<tr><th scope='row'>{escape(a)}</th><td class='long'>{escape(b)}</td></tr>"
        for a, b in rows
    )
    return f'<div class="scroll"><table>{body}</table></div>'


def _plain(value: Any) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _several(values: Iterable[str]) -> str:
    """Return values in words; where numbers are many, their range."""
    found = sorted(set(values))
    said = [value for value in found if value]
    none = " (some runs: none)" if said and "" in found else ""
    if len(said) > 6:
        try:
            numbers = sorted(map(float, said))
            return f"{numbers[0]:g} to {numbers[-1]:g}{none}"
        except ValueError:
            return f"{', '.join(said[:6])} and {len(said) - 6} more{none}"
    return ", ".join(said) + none if said else "none"
