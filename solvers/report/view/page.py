"""Page that shows a model, a plan, a solution or a comparison, as one self-contained HTML file."""

from __future__ import annotations

import html
import inspect
import json
import logging
import os
import sys
import tempfile
import webbrowser
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from ....errors import CrosstrackError, InvalidData, UnknownName
from ....files import writable, write_text
from ....models.conversion import as_model
from ....models.fields import show as quoted
from ....models.plots import plot
from ....models.plots.export import export_animation, export_figure
from ....models.plots.style import pretty_unit
from ....models.problems import resolve, table
from ....models.verification import Check, Verification, stated
from ....version import __version__
from ...contract.solution import Solution
from ..tables import number, seconds_text, solutions_table
from ..web import fill_page, resource

__all__ = ["Page", "embed", "show"]

log = logging.getLogger("crosstrack")

#: Number of frames of an animation on a page, and in a notebook.
_FRAMES, _FEWER = 60, 30
#: Largest page in a notebook (characters), and its height there (pixels).
_MOST, _HEIGHT = 2_000_000, 720


@dataclass(frozen=True)
class Page:
    """HTML page in a file.

    Parameters
    ----------
    path : Path
        Path of the file.
    html : str
        The page, which requests nothing.
    """

    path: Path
    html: str

    def __str__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"Page({str(self.path)!r})"

    def _repr_html_(self) -> str:
        return _frame(self.html)


class _View(NamedTuple):
    """Content of one panel: title, model, plan or solution, and the verification of the plan."""

    title: str
    model: Any
    plan: Any
    solution: Any
    result: Verification | None


def show(
    item: Any,
    plan: Any = None,
    *,
    path: str | os.PathLike[str] | None = None,
    open: bool = True,  # noqa: A002 (as in pathlib)
) -> Page:
    """Write a page that shows a plan: pictures, animation, and the checks of its verification.

    Pictures can be moved and zoomed, values are shown under the pointer, entries of the legend hide and show
    curves, and a click on a check points at the place of its worst value.

    Parameters
    ----------
    item : Solution, Comparison, Verdict or Model
        Object to show. The answers of a comparison are side by side, with the same limits of the axes.
    plan : plan, Solution or JSON data, optional
        Plan of a model, valid or not.
    path : str or path-like, optional
        Name of the file, ending in ``.html`` or ``.htm``. Default: a temporary file.
    open : bool
        Whether to open the page in the browser, if the program runs in a terminal.

    Returns
    -------
    Page
        The page and the path of its file. A notebook displays it.

    Raises
    ------
    InvalidData
        The plan does not belong to the model, a solution was loaded without its model, or the file cannot be
        written.
    BackendMissing
        Matplotlib is not installed.
    """
    file = None if path is None else writable(path, (".html", ".htm"))
    text = _page(item, plan, _FRAMES)
    if file is None:
        handle, name = tempfile.mkstemp(suffix=".html", prefix="crosstrack-")
        os.close(handle)
        file = Path(name)
    page = Page(write_text(file, text), text)
    streams = (sys.stdin, sys.stdout)
    if open and all(stream and not stream.closed and stream.isatty() for stream in streams):
        webbrowser.open(file.resolve().as_uri())
    return page


def embed(solution: Any) -> str:
    """Return the view of a solution for a notebook; empty if it has no picture or is too large."""
    try:
        import matplotlib.figure  # noqa: F401

        text = _page(solution, None, _FEWER)
    except (ModuleNotFoundError, CrosstrackError):
        return ""
    return _frame(text) if len(text) <= _MOST else ""


def _frame(text: str) -> str:
    return (
        f'<iframe srcdoc="{html.escape(text)}" width="100%" height="{_HEIGHT}" loading="lazy" '
        'title="Plan" style="border: 0"></iframe>'
    )


# -- content ---------------------------------------------------------------------------------------


def _views(item: Any, plan: Any) -> tuple[str, list[_View], str]:
    """Return the title, the views and the HTML of the verdicts on them."""
    verdicts = getattr(item, "verdicts", None) or (
        [item] if hasattr(item, "solutions") and hasattr(item, "evidence") else None
    )
    if verdicts is not None:
        if plan is not None:
            raise InvalidData("plan must be None for a comparison, which has plans", field="plan")
        views = [_of_solution(s, several=True) for verdict in verdicts for s in verdict.solutions]
        return (
            " and ".join(v.instance for v in verdicts[:3]),
            views,
            "".join(map(_verdict, verdicts)),
        )
    if isinstance(item, Solution):
        if plan is not None:
            raise InvalidData(
                f"plan must be None for a solution, which has one, got {quoted(plan)}; for the file "
                "of the page give path=",
                field="plan",
            )
        view = _of_solution(item)
        return view.title, [view], ""
    model = as_model(item)
    title = model.name or model.kind
    if plan is None:
        return title, [_View(title, model, None, None, None)], ""
    solution = plan if isinstance(plan, Solution) else None
    if solution is not None and solution.source is None:
        plan = solution = Solution.from_dict(solution.to_dict(), model)
    elif solution is not None and solution.digest != model.digest:
        raise InvalidData(
            f"plan is a solution for digest {solution.digest[:12]}, the model has {model.digest[:12]}: "
            "pass its attribute plan to show the plan alone",
            field="plan",
        )
    tolerance = {} if solution is None else _tolerance(solution)
    plan = model.as_plan(plan)
    view = _View(title, model, plan, solution, model.verify(plan, **tolerance))
    return title, [view], ""


def _of_solution(solution: Any, *, several: bool = False) -> _View:
    model = solution.source
    if model is None:
        raise InvalidData(
            "the solution was loaded without its model: pass model= to load it, or call show(model, solution)",
            field="source",
        )
    title = solution.backend + (f" : {solution.formulation}" if solution.formulation else "")
    if not several:
        title = solution.instance or model.kind
    return _View(title, model, solution.plan, solution, solution.verification)


def _tolerance(solution: Any) -> dict[str, Any]:
    options: Mapping[str, Any] = solution.options
    return {"tolerance": options["tolerance"]} if options.get("tolerance") else {}


def _page(item: Any, plan: Any, frames: int) -> str:
    title, views, remark = _views(item, plan)
    scenes: list[dict[str, Any]] = []
    parts = []
    digests: dict[str, list[dict[str, Any]]] = {}
    for view in views:
        first = len(scenes)
        parts.append(_section(view, scenes, frames, len(views) > 1))
        digests.setdefault(view.model.digest, []).extend(scenes[first:])
    for alike in digests.values():
        _share_limits(alike)
    css = (
        resource("crosstrack.solvers.bench", "page.css"), resource(__package__, "view.css"),
    )  # fmt: skip
    scripts = [resource(__package__, name) for name in ("draw.js", "panel.js", "view.js")]
    # "<" would end the element if a text contains "</script>".
    data = json.dumps(scenes, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
    return fill_page(
        resource(__package__, "view.html"), "".join(css), "".join(scripts),
        title=escape(title), scenes=data, footer=f"Made by crosstrack {escape(__version__)}.",
        body=f"{remark}<div class='{'views' if len(views) > 1 else 'alone'}'>{''.join(parts)}</div>",
    )  # fmt: skip


def _section(view: _View, scenes: list[dict[str, Any]], frames: int, several: bool) -> str:
    """Return the HTML of a view, and append its scenes."""
    first, drawn = len(scenes), []
    group = view.model.digest[:12] if several else ""
    try:
        picture = plot(view.model, view.plan if view.plan is None else view.solution or view.plan)
        scene = export_figure(picture)
        moving = _motion(view, frames)
        if moving is not None and not _names(scene) - _names(moving):
            # The animation is the picture with moving marks.
            scene, moving = {**moving, "pins": scene["pins"], "title": scene["title"]}, None
        drawn.append(_host(first, group, scene["title"]))
        scenes.append(scene)
        if moving is not None:
            drawn.append("<h3>In motion</h3>" + _host(len(scenes), group and f"{group} moving", ""))
            scenes.append(moving)
    except UnknownName:
        drawn.append(f"<p>Models of kind {escape(view.model.kind)} have no picture.</p>")
    except CrosstrackError:
        raise
    except Exception as error:  # such as coordinates of an invalid plan that overflow
        log.warning("picture of %r: %s", view.title, error)
        drawn.append(f"<p>No picture: {escape(str(error))}</p>")
    pins = scenes[first]["pins"] if len(scenes) > first else []
    head = f"<h2>{escape(view.title)}</h2>" if several else ""
    return (
        f'<section class="view" aria-label="{escape(view.title)}">{head}<div class="parts">'
        f'<div class="pictures">{"".join(drawn)}</div>'
        f'<div class="facts">{_facts(view)}{_checks(view.result, pins, first)}</div></div></section>'
    )


def _names(scene: Mapping[str, Any]) -> Counter[tuple[Any, ...]]:
    """Return the kinds and names of the artists of a scene."""
    return Counter(
        tuple(artist[key] for key in ("a", "t", "g", "l")) for artist in scene["artists"]
    )


def _host(index: int, group: str, caption: str) -> str:
    lines = "<br>".join(escape(line) for line in caption.splitlines())
    look = "bad" if "NOT VALID" in caption else "soft"
    text = f'<p class="{look}">{lines}</p>' if caption else ""
    return f'{text}<div class="scene" data-scene="{index}" data-group="{group}"></div>'


def _motion(view: _View, frames: int) -> dict[str, Any] | None:
    """Return the animation of a plan as data; None without one."""
    target = table(f"{__package__.partition('.')[0]}.models", "ANIMATIONS").get(view.model.kind)
    if target is None or view.plan is None:
        return None
    function = resolve(target)
    content = view.plan
    if "incumbents" in inspect.signature(function).parameters:
        incumbents = () if view.solution is None else view.solution.incumbents
        content = [entry for entry in incumbents if entry.plan is not None]
        if len(content) < 2:
            return None
    try:
        return export_animation(function(view.model, content, frames=frames, title=""))
    except Exception as error:  # the picture shows what is wrong with an invalid plan
        is_fault = (
            view.result is not None and view.result.ok and not isinstance(error, CrosstrackError)
        )
        log.log(
            logging.WARNING if is_fault else logging.INFO, "animation of %r: %s", view.title, error
        )
        return None


def _share_limits(scenes: Sequence[dict[str, Any]]) -> None:
    """Give the axes of pictures of a model with the same labels the same limits."""
    for moving in (False, True):
        alike = [scene for scene in scenes if ("frames" in scene) is moving]
        for twins in zip(*(scene["axes"] for scene in alike), strict=False):
            for name in "xyz":
                key = f"{name}lim"
                if len({twin.get(f"{name}label") for twin in twins}) > 1 or key not in twins[0]:
                    continue
                limits = [twin[key] for twin in twins if key in twin]
                ends = [min(map(min, limits)), max(map(max, limits))]
                for twin in twins:
                    twin[key] = ends if limits[0][0] <= limits[0][1] else ends[::-1]


# -- tables ----------------------------------------------------------------------------------------


def _verdict(verdict: Any) -> str:
    """Return the verdict on several answers, and their table."""
    answers = solutions_table(verdict.solutions)
    notes = "".join(f"<p class='soft'>{escape(note)}</p>" for note in verdict.notes)
    return (
        f"<p>{escape(f'{verdict.instance}: {verdict.outcome}, {verdict.evidence}')}</p>{notes}"
        + _table(answers.columns, (map(str, row) for row in answers.rows), "Answers")
    )


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]], label: str) -> str:
    """Return a table of texts in a box that scrolls."""
    top = "".join(f'<th scope="col"><span>{escape(head)}</span></th>' for head in heads)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(label)}"><table>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _facts(view: _View) -> str:
    """Return the table of the answer."""
    model, solution, result = view.model, view.solution, view.result
    unit = model.objective_unit if isinstance(model.objective_unit, str) else ""
    unit = f" {pretty_unit(unit)}" if unit else ""
    sense = "maximised" if model.maximise else "minimised"
    objective = None if result is None else stated(result.objective, model.maximise)
    text = model.describe()
    rows = [("Problem", text if isinstance(text, str) else model.outline())]
    if objective is not None:
        rows.append(("Objective", f"{number(objective)}{unit}, {sense}"))
    if solution is not None:
        ended = str(solution.termination).replace("_", " ")
        limit = f", {solution.limit} limit" if solution.limit is not None else ""
        gap = solution.gap
        rows += [
            ("Ended", ended + limit),
            ("Bound", "" if solution.bound is None else f"{number(solution.bound)}{unit}"),
            ("Gap", "" if gap is None else f"{100 * gap:.3g} %"),
            ("Evidence", solution.proof),
            ("Guarantee", "" if solution.guarantee is None else str(solution.guarantee)),
            ("Backend", solution.backend + (f" on {solution.formulation}" if solution.formulation else "")),
            ("Time", seconds_text(solution.seconds.get("total", solution.seconds.get("solve")))),
            ("Seed", "" if solution.seed is None else str(solution.seed)),
            ("Message", solution.message),
        ]  # fmt: skip
    body = "".join(
        f'<tr><th scope="row">{name}</th><td>{escape(text)}</td></tr>'
        for name, text in rows
        if text
    )
    return f'<div class="scroll"><table><tbody>{body}</tbody></table></div>'


def _checks(result: Verification | None, pins: Sequence[Mapping[str, Any]], scene: int) -> str:
    """Return the table of the checks, with a button for each check that has a place in the picture."""
    if result is None:
        return ""
    places = {pin["check"]: k for k, pin in reversed(list(enumerate(pins)))}
    rows = []
    for check in result.checks:
        name = escape(check.name)
        if check.name in places:
            spot = escape(f"{check.name}: {check.where or 'the place of its worst value'}")
            name = (
                f'<button type="button" data-of="{scene}" data-pin="{places[check.name]}" '
                f'aria-pressed="false" title="{spot}">{name}</button>'
            )
        rows.append(f"<tr><td>{name}</td>{_cells(check)}</tr>")
    heads = "".join(
        f'<th scope="col"><span>{head}</span></th>'
        for head in ("Check", "State", "Worst", "Limit", "Place")
    )
    state = (
        '<span class="good">verified</span>' if result.ok else '<span class="bad">NOT valid</span>'
    )
    return (
        f'<h3>Checks: {state}</h3><div class="scroll tall" tabindex="0" role="region" aria-label="Checks">'
        f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _cells(check: Check) -> str:
    look, state = ("good", "✓ ok") if check.ok else ("bad", "✗ violated")
    if check.within_tolerance:
        look, state = "open", "○ within tolerance"
    unit = pretty_unit(check.unit)
    limit = "" if check.limit is None else f"{check.limit:.6g} {unit}"
    numbers = f"{check.worst + 0.0:.3g} {unit}", limit
    return (
        f"<td class='{look}'>{state}</td>"
        + "".join(f"<td class='number'>{escape(text)}</td>" for text in numbers)
        + f"<td>{escape(check.where)}</td>"
    )
