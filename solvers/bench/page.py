"""The report of a campaign: one HTML file that needs no network."""

from __future__ import annotations

import base64
import hashlib
import os
import shlex
from collections import Counter
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from ...errors import InvalidData
from ...files import writable, write_text
from ..repeats import name_backend
from ..report.tables import number, seconds_text
from ..solution import Solution
from ..verdict import Outcome, Verdict
from .cases import OUTCOMES, Case, describe_instance
from .chart import Series, draw_steps
from .conditions import describe_conditions
from .draws import ACCURACY, compare_with_leader, profile_evaluations
from .markup import cell, choices, count_cell, ended, figure, many, numeric, table, tested
from .pictures import Load
from .records import Records
from .standing import REFERENCE, TOO_LATE, Standing, are_rivals, who
from .statistics import success_interval

if TYPE_CHECKING:
    from ..crosscheck import Comparison

__all__ = ["write_page"]

#: Heads of the tables of answers, and whether the column holds numbers.
_HEADS = (
    ("Instance", False), ("Backend", False), ("Ended", False), ("Solved", False),
    ("Objective", True), ("Bound", True), ("Gap", True), ("Solving took", True), ("Building took", True),
    ("Seed", True), ("Repeat", True), ("Message", False),
)  # fmt: skip
#: What stands for a leader where there can be none.
_APART = "none: each backend estimates something else"
#: How reasons end for which an answer is not wrong, but not good enough either.
_SHORT = ("above best", "no plan", REFERENCE, TOO_LATE)
#: Characters of a message that are shown in a table.
_MESSAGE = 300
#: Options that the command of a contradiction repeats, by the flag.
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
) -> Path:
    """Write the report of a campaign as one HTML file that needs no network; return the path.

    Parameters
    ----------
    records : Records or Comparison
        The answers.
    path : str or path-like
        The file, ``.html`` or ``.htm``.
    title : str
        The page's title; that of the records where it is empty.
    command : str
        The command that repeats the campaign, shown at the foot.
    load : callable, optional
        What finds an instance by its name: with it the best plan of every instance is drawn. Names are those
        in the record: :func:`crosstrack.load` opens a file where one names a file, which a stranger's
        record must not. An instance whose digest is not the record's is not drawn.

    Returns
    -------
    Path
        Of the file.

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
    return write_text(file, _page(records, title or records.title, command, load))


def _page(records: Records, title: str, command: str, load: Load | None) -> str:
    cases, standings, solutions = _cases(records), records.standings, records.solutions
    kinds = list(standings)
    style, script = _resource("page.css"), _resource("page.js")
    wrong = [case for case in cases if case.verdict.outcome is Outcome.CONTRADICTION]
    sections = [_problem(kind, cases, standings[kind], load) for kind in kinds]
    again = f"<p>To repeat the campaign:</p><pre>{escape(command)}</pre>" if command else ""
    versions = sorted({s.version for s in solutions if s.version})
    return Template(_resource("page.html")).substitute(
        title=escape(title or "Comparison of backends"),
        style=style,
        script=script,
        style_hash=_hash(style),
        script_hash=_hash(script),
        verdict=_verdict(cases, solutions),
        contents=_contents(kinds),
        leading=_leading(kinds, cases, standings),
        contradictions="".join(map(_contradiction, wrong))
        or "<p>None: no proof speaks against any verified plan.</p>",
        measured=describe_conditions(records),
        problems=choices(kinds),
        backends=choices(sorted({s.backend for s in solutions})),
        endings=choices(sorted({ended(s) for s in solutions})),
        count=f"{len(solutions):,}",
        sections="".join(sections),
        footer=f"{again}<p class='soft'>Made by crosstrack {escape(', '.join(versions))}.</p>",
    )


def _cases(records: Records) -> list[Case]:
    """Return the answers by instance, with the verdict on each."""
    # One model may have several names: the first counts. What shares a name but not its data is told apart.
    firsts = [one.solutions[0] for one in records.verdicts]
    shared = Counter((first.model, first.instance) for first in firsts)
    cases = []
    for first, verdict in zip(firsts, records.verdicts, strict=True):
        name = first.instance.replace("\0", "\ufffd") or first.digest[:12]
        if shared[first.model, first.instance] > 1:
            name = f"{name} {first.digest[:12]}"
        cases.append(Case(first.model, name, verdict.solutions, verdict))
    return sorted(cases, key=lambda case: (case.kind, case.name))


def _verdict(cases: Sequence[Case], solutions: Sequence[Solution[Any]]) -> str:
    """Return the verdict in words."""
    counts = {outcome: sum(c.verdict.outcome is outcome for c in cases) for outcome in OUTCOMES}
    backends = len({s.backend for s in solutions})
    agreed, wrong, undecided = counts.values()
    return (
        f"{many(len(solutions), 'answer')} of {many(backends, 'backend')} on "
        f"{many(len(cases), 'instance')} of {many(len({c.kind for c in cases}), 'problem')}. "
        f"On {agreed:,} the answers <span class='good'>agree</span>, on {wrong:,} they "
        f"<span class='bad'>contradict</span> one another, and {undecided:,} "
        f"{'is' if undecided == 1 else 'are'} <span class='open'>open</span>: nothing speaks against the "
        "best plan, but nobody proved that there is no better one."
    )


def _contents(kinds: Sequence[str]) -> str:
    places = {"leading": "Leaders", "contradictions": "Contradictions", "measured": "How measured"}
    links = {**places, **{f"p-{i}": kind for i, kind in enumerate(kinds)}}
    return " ".join(f'<a href="#{place}">{escape(text)}</a>' for place, text in links.items())


def _leading(
    kinds: Sequence[str], cases: Sequence[Case], standings: dict[str, list[Standing]]
) -> str:
    """Return the table of problems: their verdicts and who leads."""
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
    heads = [("Problem", False), ("Leads", False), ("Instances", True)]
    heads += [(word.capitalize(), True) for word, _, _ in OUTCOMES.values()]
    return table(heads, rows, "plain", "Verdicts by problem")


def _leader(standings: Sequence[Standing]) -> str:
    """Return who leads a problem, in words and numbers."""
    able = [one for one in standings if one.solved]
    if not able:
        return "no backend solved an instance"
    words = [
        f"{one.label}: solved {one.solved:,} of {many(one.of, 'instance')}, typically in "
        f"{seconds_text(one.typical)}"
        for one in able[:2]
    ]
    return words[0] + (f"; next {words[1]}" if len(words) > 1 else "; no other solved any")


def _problem(
    kind: str, cases: Sequence[Case], standings: Sequence[Standing], load: Load | None
) -> str:
    """Return the section of one problem."""
    own = [case for case in cases if case.kind == kind]
    anchor = f"p-{sorted({case.kind for case in cases}).index(kind)}"
    why = {id(s): reason for one in standings for s, reason in one.answers}
    rows = [_answer(case, s, why.get(id(s), REFERENCE)) for case in own for s in case.solutions]
    used = [i for i in range(len(_HEADS)) if any(not c[i].endswith("></td>") for _, c in rows)]
    rows = [(attributes, [cells[i] for i in used]) for attributes, cells in rows]
    curves = [Series(one.label, one.profile) for one in standings if one.profile]
    profile = draw_steps(
        curves, title=f"Performance profile of {kind}", share=True,
        across="times as long as the fastest on the same instance", up="instances solved",
    )  # fmt: skip
    note = (
        "Performance profile (Dolan and Moré 2002). A line tells the share of all instances that a "
        "backend solved within so many times the seconds of the fastest backend on each. Far left: how "
        "often it was the fastest. Far right: how much it solved at all. Higher is better."
    )
    return (
        f'<section data-problem="{escape(kind)}" id="{anchor}"><h3>{escape(kind)}</h3>'
        f"{_standing(standings)}"
        + (figure(profile, note) if profile else "<p class='soft'>No instance was solved.</p>")
        + _evaluations(kind, own)
        + _ranks([case.verdict for case in own], standings)
        + '<div data-table><p class="soft"><span data-shown></span> '
        '<button type="button" class="more" data-more hidden>Show all</button></p>'
        + table([_HEADS[i] for i in used], rows, "answers", f"Answers on {kind}", tall=True)
        + "</div><h4>Instances: bounds over time, and the best plan</h4>"
        + "".join(describe_instance(case, load, len(cases)) for case in own)
        + "</section>"
    )


def _evaluations(kind: str, own: Sequence[Case]) -> str:
    """Return the data profile of what counts evaluations, "" where nothing does."""
    found = profile_evaluations([case.verdict for case in own])
    far = max((float(places[-1]) for places, _ in found.values()), default=0.0)
    curves = [
        Series(
            label,
            [
                *((x, y) for x, y in zip(places.tolist(), shares.tolist(), strict=True) if x),
                (far, float(shares[-1])),
            ],
        )
        for label, (places, shares) in found.items()
        if shares[-1]
    ]
    drawn = draw_steps(
        curves, title=f"Data profile of {kind}", share=True,
        across="evaluations per (variables + 1)", up="instances solved",
    )  # fmt: skip
    note = (
        "Data profile (Moré and Wild 2009). A line tells the share of all instances that a backend solved "
        "within so many evaluations of the objective, divided by the number of variables and one. Solved "
        f"is here: {ACCURACY:g} of the way from the worst first value to the best one is left. Higher is "
        "better."
    )
    return figure(drawn, note) if drawn else ""


def _ranks(verdicts: Sequence[Verdict], standings: Sequence[Standing]) -> str:
    """Return the tests of the leading backend against each other one, "" where nothing draws."""
    tests = compare_with_leader(verdicts, standings)
    if not tests:
        return ""
    leader = next(one.label for one in standings if one.solved)
    rows = [[cell(label), *tested(test), count_cell(test.runs)] for label, test in tests.items()]
    heads = [("Compared with", False), ("Better plans", False), ("p", True), ("Effect", True)]
    heads += [("Instances of both", True)]
    return (
        f"<h4>Are the plans of {escape(leader)} better, or is it luck?</h4>"
        "<p class='note'>Some of these backends draw. Wilcoxon's test over the instances that both ran on, "
        "of the medians over seeds, with p corrected by Holm's method for all pairs of backends. Effect: how "
        "much more often, by ranks, the plan of the leading backend is the better one, from −1 to 1.</p>"
        + table(heads, rows, "plain", f"Tests of {leader} against the others")
    )


def _standing(standings: Sequence[Standing]) -> str:
    heads = [("Backend", False)]
    heads += [
        (word, True)
        for word in (
            "Runs",
            "Ran on",
            "Solved",
            "Rate (95 %)",
            "Proven",
            "Best plan",
            "Fastest",
            "Typical",
            "Median",
            "Gap over time",
        )
    ]
    rows = [
        [
            cell(one.label),
            *map(count_cell, (one.runs, one.instances, one.solved)),
            _interval(one),
            *map(count_cell, (one.proven, one.best, one.fastest)),
            numeric(one.typical, seconds_text(one.typical)),
            numeric(one.median, seconds_text(one.median)),
            numeric(one.integral, "" if one.integral is None else f"{100 * one.integral:.3g} %"),
        ]
        for one in standings
    ]
    return table(heads, rows, "plain", "Backends, the leading one first")


def _interval(one: Standing) -> str:
    """Return the cell of the rate of instances solved, by Wilson's interval."""
    low, high = success_interval(one.solved, one.of)
    return numeric(one.solved / one.of, f"{100 * low:.0f} to {100 * high:.0f} %")


def _answer(case: Case, s: Solution[Any], why: str) -> tuple[str, list[str]]:
    """Return the attributes and the cells of an answer's row."""
    repeat = s.options.get("repeat")
    gap = "" if s.gap is None else f"{s.gap:.1e}" if s.gap else "0"
    solve, build = s.seconds.get("solve"), s.seconds.get("build")
    message = s.message if len(s.message) <= _MESSAGE else s.message[: _MESSAGE - 1] + "…"
    attributes = f' data-backend="{escape(s.backend)}" data-ended="{escape(ended(s))}"'
    look, sign = (
        ("good", "✓") if not why else ("open", "○") if why.endswith(_SHORT) else ("bad", "✗")
    )
    return attributes, [
        cell(case.name), cell(who(s)), cell(ended(s)),
        f"<td class='{look}'>{sign} {escape(why or 'solved')}</td>",
        numeric(s.primal_bound, number(s.primal_bound)),
        numeric(s.dual_bound, number(s.dual_bound)),
        numeric(s.gap, gap),
        numeric(solve, seconds_text(solve)), numeric(build, seconds_text(build)),
        numeric(s.seed, "" if s.seed is None else str(s.seed)),
        numeric(repeat, "" if repeat is None else str(repeat)),
        cell(message, long=True),
    ]  # fmt: skip


def _contradiction(case: Case) -> str:
    """Return a contradiction with its evidence and the command that repeats it."""
    words = case.verdict.evidence.replace(",", " ").split()
    named = [s for s in case.solutions if _asked(s) in words] or case.solutions
    rows = []
    for s in named:
        checks = [] if s.verification is None else s.verification.checks
        off = [str(check) for check in checks if not check.ok or check.within_tolerance]
        state = "; ".join(off) or ("every check holds" if checks else "no plan to check")
        proves = "" if s.guarantee is None else str(s.guarantee)
        cells = [who(s), proves, ended(s), number(s.primal_bound), number(s.dual_bound)]
        rows.append([*map(cell, cells), cell(state, long=True)])
    heads = ("Backend", "Guarantee", "Ended", "Objective", "Bound", "Checks of its plan")
    asked = named[0].options
    line = [
        "crosstrack",
        "compare",
        named[0].instance or case.name,
        "--backends",
        ",".join(dict.fromkeys(map(_asked, named))),
    ]
    own = {s.backend: found for s in named if (found := s.options.get("backend_options"))}
    options = f" with <code>backend_options={escape(repr(own))}</code> in Python" if own else ""
    for flag, option in _FLAGS.items():
        if asked.get(option) is not None:
            line += [flag, str(asked[option])]
    if named[0].seed is not None:
        line += ["--seed", str(named[0].seed)]
    return (
        f"<h3>{escape(case.name)}</h3><p><span class='bad'>✗ contradict</span>: "
        f"{escape(case.verdict.evidence)}.</p>"
        + table([(head, False) for head in heads], rows, "plain", f"Evidence on {case.name}")
        + f"<p>To see it again{options}:</p><pre>{escape(shlex.join(line))}</pre>"
    )


def _asked(solution: Solution[Any]) -> str:
    """Return what the command line calls the backend of an answer."""
    return name_backend(solution.backend, solution.formulation)


def _resource(name: str) -> str:
    return files(__package__).joinpath(name).read_text("utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return "sha256-" + base64.b64encode(digest).decode("ascii")
