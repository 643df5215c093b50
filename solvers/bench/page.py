"""Report of a campaign as one self-contained HTML file."""

from __future__ import annotations

import json
import math
import os
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InvalidData
from ...files import writable, write_text
from ..contract.repeats import name_backend
from ..contract.solution import Solution
from ..contract.verdict import Outcome, Verdict
from ..report.tables import number, seconds_text
from ..report.web import fill_page, resource
from .cases import OUTCOMES, Case, describe_instance
from .chart import Series, draw_steps
from .conditions import describe_conditions
from .draws import ACCURACY, compare_with_leader, profile_evaluations
from .markup import cell, choices, count_cell, ended, figure, many, numeric, table, tested
from .pictures import Load, draw_plans
from .records import Records
from .standing import REFERENCE, TOO_LATE, Standing, are_rivals, who
from .statistics import success_interval

if TYPE_CHECKING:
    from ..run.crosscheck import Comparison

__all__ = ["write_page"]

#: Headers of the tables of answers with their CSS classes, and headers of those of backends.
_ANSWERS = {
    "Instance": "", "Backend": "", "Ended": "", "Solved": "sign", "Objective": "n", "Bound": "n",
    "Gap": "n", "Solving took": "n", "Building took": "n", "Seed": "n", "Repeat": "n", "Message": "long",
}  # fmt: skip
_STANDING = (
    "Backend", "Runs", "Ran on", "Solved", "Rate (95 %)", "Proven", "Best plan", "Fastest", "Typical",
    "Median", "Gap over time",
)  # fmt: skip
#: Text in place of a leader for problems without one.
_APART = "none: each backend estimates something else"
#: Endings of the reasons for which an answer is not wrong, but not good enough.
_SHORT = ("above best", "below best", "no plan", REFERENCE, TOO_LATE)
#: Default number of pictures: about 0.1 s each.
PICTURES = 20
#: Largest number of characters of a message in a table.
_MESSAGE = 300
#: Options that the command for a contradiction repeats, by flag.
_FLAGS = {
    "--time-limit": "time_limit", "--gap": "gap", "--tolerance": "tolerance",
    "--threads": "threads", "--evaluations": "evaluations", "--target": "target",
}  # fmt: skip


def write_page(
    records: Records | Comparison,
    path: str | os.PathLike[str],
    *,
    title: str = "",
    command: str = "",
    load: Load | None = None,
    pictures: int = PICTURES,
) -> Path:
    """Write the report of a campaign as one self-contained HTML file.

    Parameters
    ----------
    records : Records or Comparison
        The answers.
    path : str or path-like
        Name of the file, ending in ``.html`` or ``.htm``.
    title : str
        Title of the page. Default: title of the records.
    command : str
        Command that repeats the campaign, shown at the foot of the page.
    load : callable, optional
        Function that returns an instance by its name. With it, the best plan of every instance is
        drawn if the digest of the instance is that of the record. Names come from the record.
        :func:`crosstrack.load` also opens files by name, so do not pass it for records from
        untrusted sources.
    pictures : int
        Largest number of pictures, spread over the problems; contradictions come first.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InvalidData
        There is no answer, or the file cannot be written.
    """
    file = writable(path, (".html", ".htm"))
    if not isinstance(records, Records):
        records = Records(tuple(records.solutions))
    if not records.solutions:
        raise InvalidData("records must hold an answer, got none", field="records")
    return write_text(file, _page(records, title or records.title, command, load, pictures))


def _page(records: Records, title: str, command: str, load: Load | None, pictures: int) -> str:
    cases, standings, solutions = _cases(records), records.standings, records.solutions
    kinds = list(standings)
    wrong = [case for case in cases if case.verdict.outcome is Outcome.CONTRADICTION]
    drawn = draw_plans([case.verdict for case in _in_turn(cases)], load, pictures)
    sections = [_problem(kind, cases, standings[kind]) for kind in kinds]
    answers = [_answers(kind, cases, standings[kind], drawn) for kind in kinds]
    again = f"<p>To repeat the campaign:</p><pre>{escape(command)}</pre>" if command else ""
    versions = sorted({s.version for s in solutions if s.version})
    return fill_page(
        *(resource(__package__, f"page.{suffix}") for suffix in ("html", "css", "js")),
        title=escape(title or "Comparison of backends"),
        verdict=_verdict(cases, solutions),
        contents=_contents(kinds),
        leading=_leading(kinds, cases, standings),
        contradictions="".join(map(_contradiction, wrong))
        or "<p>None: no proof contradicts a verified plan.</p>",
        measured=describe_conditions(records),
        problems=choices(kinds),
        backends=choices(sorted({s.backend for s in solutions})),
        endings=choices(sorted({ended(s) for s in solutions})),
        count=f"{len(solutions):,}",
        sections="".join(sections),
        # No text from outside ends the element of the data.
        data=json.dumps(answers, ensure_ascii=False, separators=(",", ":")).replace("<", r"\u003c"),
        footer=f"{again}<p class='soft'>Made by crosstrack {escape(', '.join(versions))}.</p>",
    )


def _cases(records: Records) -> list[Case]:
    """Return the answers by instance, with the verdict on each."""
    # A model may have several names: the first is used. Equal names of different data get the digest.
    firsts = [verdict.solutions[0] for verdict in records.verdicts]
    shared = Counter((first.model, first.instance) for first in firsts)
    cases = []
    for first, verdict in zip(firsts, records.verdicts, strict=True):
        name = first.instance.replace("\0", "\ufffd") or first.digest[:12]
        if shared[first.model, first.instance] > 1:
            name = f"{name} {first.digest[:12]}"
        cases.append(Case(first.model, name, verdict.solutions, verdict))
    return sorted(cases, key=lambda case: (case.kind, case.name))


def _in_turn(cases: Sequence[Case]) -> list[Case]:
    """Return contradictions, then the first instance of every problem, the second, and so on."""
    counts: Counter[str] = Counter()
    keys = []
    for index, case in enumerate(cases):
        counts[case.kind] += 1
        agreed = case.verdict.outcome is not Outcome.CONTRADICTION
        keys.append((agreed, counts[case.kind], index))
    return [cases[index] for *_, index in sorted(keys)]


def _verdict(cases: Sequence[Case], solutions: Sequence[Solution[Any]]) -> str:
    """Return the verdict as a sentence."""
    counts = {outcome: sum(c.verdict.outcome is outcome for c in cases) for outcome in OUTCOMES}
    backends = len({s.backend for s in solutions})
    agreed, wrong, undecided = counts.values()
    return (
        f"{many(len(solutions), 'answer')} of {many(backends, 'backend')} on "
        f"{many(len(cases), 'instance')} of {many(len({c.kind for c in cases}), 'problem')}. "
        f"On {agreed:,} the answers <span class='good'>agree</span>, on {wrong:,} they "
        f"<span class='bad'>contradict</span> one another, and {undecided:,} "
        f"{'is' if undecided == 1 else 'are'} <span class='open'>open</span>: nothing contradicts the "
        "best plan, but its optimality is not proven."
    )


def _contents(kinds: Sequence[str]) -> str:
    places = {"leading": "Leaders", "contradictions": "Contradictions", "measured": "How measured"}
    links = {**places, **{f"p-{i}": kind for i, kind in enumerate(kinds)}}
    return " ".join(f'<a href="#{place}">{escape(text)}</a>' for place, text in links.items())


def _leading(
    kinds: Sequence[str], cases: Sequence[Case], standings: dict[str, list[Standing]]
) -> str:
    """Return the table of problems: their verdicts and leading backends."""
    rows = []
    for kind in kinds:
        own = [case for case in cases if case.kind == kind]
        counts = [sum(c.verdict.outcome is o for c in own) for o in OUTCOMES]
        rows.append(
            [
                cell(kind),
                cell(_leader(standings[kind]) if are_rivals(kind) else _APART, long=True),
                *map(count_cell, (len(own), *counts)),
            ]
        )
    outcomes = (word.capitalize() for word, _, _ in OUTCOMES.values())
    heads = ["Problem", "Leads", "Instances", *outcomes]
    return table(heads, rows, "plain", "Verdicts by problem")


def _leader(standings: Sequence[Standing]) -> str:
    """Return the leading backends of a problem with their results, as text."""
    able = [standing for standing in standings if standing.solved]
    if not able:
        return "no backend solved an instance"
    words = [
        f"{standing.label}: solved {standing.solved:,} of {many(standing.of, 'instance')}, typically in "
        f"{seconds_text(standing.typical)}"
        for standing in able[:2]
    ]
    return words[0] + (f"; next {words[1]}" if len(words) > 1 else "; no other solved any")


def _answers(
    kind: str,
    cases: Sequence[Case],
    standings: Sequence[Standing],
    drawn: Mapping[int, tuple[str, str]],
) -> dict[str, Any]:
    """Return the data of a problem: columns with CSS classes, rows, and instances with HTML details.

    The last entry of a row is the backend without formulation and options.
    """
    own = [case for case in cases if case.kind == kind]
    why = {id(s): reason for standing in standings for s, reason in standing.answers}
    rows = [_answer(case, s, why.get(id(s), REFERENCE)) for case in own for s in case.solutions]
    empty = ("", [None, ""])
    used = [i for i in range(len(_ANSWERS)) if any(row[i] not in empty for row in rows)]
    return {
        "columns": [(head, look) for i, (head, look) in enumerate(_ANSWERS.items()) if i in used],
        "rows": [[*(row[i] for i in used), row[-1]] for row in rows],
        "instances": [
            (case.name, *OUTCOMES[case.verdict.outcome], describe_instance(case, *drawn[id(case.verdict)]))
            for case in own
        ],
    }  # fmt: skip


def _problem(kind: str, cases: Sequence[Case], standings: Sequence[Standing]) -> str:
    """Return the section of one problem."""
    own = [case for case in cases if case.kind == kind]
    anchor = f"p-{sorted({case.kind for case in cases}).index(kind)}"
    curves = [
        Series(standing.label, standing.profile) for standing in standings if standing.profile
    ]
    profile = draw_steps(
        curves, title=f"Performance profile of {kind}", share=True,
        across="times as long as the fastest on the same instance", up="instances solved",
    )  # fmt: skip
    note = (
        "Performance profile (Dolan and Moré 2002). A line shows the share of all instances that a "
        "backend solved within a multiple of the seconds of the fastest backend on each. Far left: how "
        "often it was the fastest. Far right: how much it solved at all. Higher is better."
    )
    return (
        f'<section data-problem="{escape(kind)}" id="{anchor}"><h3>{escape(kind)}</h3>'
        f"{_standing(standings)}"
        + (figure(profile, note) if profile else "<p class='soft'>No instance was solved.</p>")
        + _evaluations(kind, own)
        + _ranks([case.verdict for case in own], standings)
        + "</section>"
    )


def _evaluations(kind: str, own: Sequence[Case]) -> str:
    """Return the data profile of the backends that count evaluations, empty without any."""
    profiles = profile_evaluations([case.verdict for case in own])
    far = max((float(places[-1]) for places, _ in profiles.values()), default=0.0)
    curves = []
    for label, (places, shares) in profiles.items():
        if shares[-1]:
            pairs = zip(places.tolist(), shares.tolist(), strict=True)
            points = [(x, y) for x, y in pairs if x]
            curves.append(Series(label, [*points, (far, float(shares[-1]))]))
    drawn = draw_steps(
        curves, title=f"Data profile of {kind}", share=True,
        across="evaluations per (variables + 1)", up="instances solved",
    )  # fmt: skip
    note = (
        "Data profile (Moré and Wild 2009). A line shows the share of all instances that a backend solved "
        "within a number of evaluations of the objective, divided by the number of variables plus one. An "
        f"instance is solved when {ACCURACY:g} of the distance from the worst first value to the best one "
        "remains. Higher is better."
    )
    return figure(drawn, note) if drawn else ""


def _ranks(verdicts: Sequence[Verdict], standings: Sequence[Standing]) -> str:
    """Return the tests of the leading backend against the others, empty without randomised runs."""
    tests = compare_with_leader(verdicts, standings)
    if not tests:
        return ""
    leader = next(standing.label for standing in standings if standing.solved)
    rows = [[cell(label), *tested(test), count_cell(test.runs)] for label, test in tests.items()]
    heads = ["Compared with", "Better plans", "p", "Effect", "Instances of both"]
    return (
        f"<h4>Are the plans of {escape(leader)} better, or is it chance?</h4>"
        "<p class='note'>Some of these backends are randomised. Wilcoxon's test over the instances that both "
        "ran on, of the medians over seeds, with p corrected by Holm's method for all pairs of backends. "
        "Effect: how much more often, by ranks, the plan of the leading backend is better, from −1 to 1.</p>"
        + table(heads, rows, "plain", f"Tests of {leader} against the others")
    )


def _standing(standings: Sequence[Standing]) -> str:
    """Return the table of the backends of a problem."""
    rows = []
    for standing in standings:
        share = standing.integral
        # Wilson's interval of the rate of solved instances.
        low, high = success_interval(standing.solved, standing.of)
        interval = f"{100 * low:.0f} to {100 * high:.0f} %"
        rows.append(
            [
                cell(standing.label),
                *map(count_cell, (standing.runs, standing.instances, standing.solved)),
                numeric(standing.solved / standing.of, interval),
                *map(count_cell, (standing.proven, standing.best, standing.fastest)),
                numeric(standing.typical, seconds_text(standing.typical)),
                numeric(standing.median, seconds_text(standing.median)),
                numeric(share, "" if share is None else f"{100 * share:.3g} %"),
            ]
        )
    return table(_STANDING, rows, "plain", "Backends, the leading one first")


def _answer(case: Case, s: Solution[Any], why: str) -> list[Any]:
    """Return the row of an answer: texts, pairs of number and text, and the backend."""
    repeat = s.options.get("repeat")
    gap = "" if s.gap is None else f"{s.gap:.1e}" if s.gap else "0"
    solve, build = s.seconds.get("solve"), s.seconds.get("build")
    message = s.message if len(s.message) <= _MESSAGE else s.message[: _MESSAGE - 1] + "…"
    sign = "✓" if not why else "○" if why.endswith(_SHORT) else "✗"
    return [
        case.name, who(s), ended(s), f"{sign} {why or 'solved'}",
        *(
            [value if value is not None and math.isfinite(value) else None, text]
            for value, text in (
                (s.value, number(s.value)), (s.bound, number(s.bound)), (s.gap, gap),
                (solve, seconds_text(solve)), (build, seconds_text(build)),
                (s.seed, "" if s.seed is None else str(s.seed)),
                (repeat, "" if repeat is None else str(repeat)),
            )
        ),
        message, s.backend,
    ]  # fmt: skip


def _contradiction(case: Case) -> str:
    """Return a contradiction with its evidence and the command that reproduces it."""
    words = case.verdict.evidence.replace(",", " ").split()
    named = [s for s in case.solutions if _asked(s) in words] or case.solutions
    rows = []
    for s in named:
        checks = [] if s.verification is None else s.verification.checks
        off = [str(check) for check in checks if not check.ok or check.within_tolerance]
        state = "; ".join(off) or ("every check holds" if checks else "no plan to check")
        proves = "" if s.guarantee is None else str(s.guarantee)
        cells = [who(s), proves, ended(s), number(s.value), number(s.bound)]
        rows.append([*map(cell, cells), cell(state, long=True)])
    heads = ("Backend", "Guarantee", "Ended", "Objective", "Bound", "Checks of its plan")
    given = named[0].options
    backends = ",".join(dict.fromkeys(map(_asked, named)))
    line = ["crosstrack", "compare", named[0].instance or case.name, "--backends", backends]
    own = {s.backend: options for s in named if (options := s.options.get("backend_options"))}
    hint = f" with <code>backend_options={escape(repr(own))}</code> in Python" if own else ""
    for flag, option in _FLAGS.items():
        if given.get(option) is not None:
            line += [flag, str(given[option])]
    if named[0].seed is not None:
        line += ["--seed", str(named[0].seed)]
    return (
        f"<h3>{escape(case.name)}</h3><p><span class='bad'>✗ contradict</span>: "
        f"{escape(case.verdict.evidence)}.</p>"
        + table(heads, rows, "plain", f"Evidence on {case.name}")
        + f"<p>To reproduce it{hint}:</p><pre>{escape(shlex.join(line))}</pre>"
    )


def _asked(solution: Solution[Any]) -> str:
    """Return the name of an answer's backend on the command line."""
    return name_backend(solution.backend, solution.formulation)
