"""Page of each catalogue entry: picture, data, best verified plan and bound, and files to download.

The pages are written at the end of the build, without the sidebar's links to each other. The values come from the
records of the campaign and from ``docs/campaign/plans.jsonl``; the build solves nothing.
"""

from __future__ import annotations

import html
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crosstrack_pages import best_known, figures_of
from crosstrack_pictures import QUICK, answers_to, best_plan, model_of, picture
from crosstrack_tables import EQUAL, best, proof
from sphinx.application import Sphinx

#: Sentence on the source of the data and their licence, by provenance.
SOURCES = {
    "paper": "The paper prints all data.",
    "completed": "The paper prints the data except for a part, which crosstrack supplies.",
    "seeded": "crosstrack generates the data from a fixed seed, under its own licence (Apache 2.0).",
    "ours": "crosstrack computes the data from a formula, under its own licence (Apache 2.0).",
    "public": "The data are published elsewhere, under the licence of their source.",
}


def table(rows: dict[str, str]) -> str:
    """Return an HTML table with a row for each label with text."""
    lines = (f"<tr><th>{name}</th><td>{text}</td></tr>" for name, text in rows.items() if text)
    return f'<table class="docutils"><tbody>{"".join(lines)}</tbody></table>'


def value_of(model: Any, value: float | None) -> str:
    """Return an objective with its unit."""
    return "" if value is None else f"{value:.9g} {model.objective_unit}".strip()


def plan_rows(model: Any, answers: list[Any]) -> dict[str, str]:
    """Return the rows on the best verified plan of all answers and on the best bound."""
    from crosstrack.solvers.bench.standing import are_rivals

    answer = best(answers)
    if not are_rivals(model.kind):
        return {
            "result": "The backends estimate different quantities, which no objective compares."
        }
    if answer is None:
        return {"result": proof(answers, None) or "no verified plan on record"}
    bounds = [a.dual_bound for a in answers if a.dual_bound is not None]
    bounds = [bound for bound in bounds if bound <= answer.primal_bound + EQUAL * abs(bound)]
    form = f", formulation <code>{answer.formulation}</code>" if answer.formulation else ""
    seconds = answer.seconds.get("total")
    return {
        "objective": value_of(model, answer.primal_bound),
        "lower bound": value_of(model, max(bounds, default=None)),
        "proof": proof(answers, answer) or "none: another plan may be better",
        "found by": f"<code>{answer.backend}</code> {answer.backend_version or ''}{form}",
        "seconds": "" if seconds is None else f"{seconds:.2g}, on one thread of a shared machine",
        "seed": "" if answer.seed is None else str(answer.seed),
        "recorded with": f"crosstrack {answer.version}" if answer.version else "",
    }


def body_of(
    entry: Any, model: Any, answers: list[Any], image: str, shown: str, files: dict[str, str]
) -> str:
    """Return the content of the page of an entry as HTML.

    Parameters
    ----------
    entry : CatalogueEntry
        The entry.
    model : Model
        Its model.
    answers : list of Solution
        All recorded answers to the model.
    image, shown : str
        URL of the picture, relative to the page, and the backend of the plan in it; ``""`` without a plan.
    files : dict
        Label of each file to download by its URL, relative to the page.
    """
    problem = entry.name.partition("/")[0]
    page = {"minimum-derivative": "minimum-snap", "time-allocation": "minimum-snap"}
    link = f'<a href="../../problems/{page.get(problem, problem)}.html">{problem}</a>'
    name = html.escape(entry.name)
    data = {
        "problem": link,
        "size": html.escape(str(model.describe())),
        "paper": html.escape(entry.paper),
        "source of the data": SOURCES[str(entry.provenance)],
        "remark": html.escape(entry.note),
        "digest": f"<code>{model.digest}</code>",
    }
    value, origin = best_known(entry, None)
    other = figures_of(entry)
    published = {"objective": value, "source": html.escape(origin), "other": html.escape(other)}
    caption = (
        f"Picture: plan of <code>{shown}</code>." if shown else "Picture: data without a plan."
    )
    commands = [f"crosstrack solve {name}"]
    commands += [f"crosstrack check {name} {file}" for file in files if file.endswith(".plan.json")]
    links = "".join(f'<li><a href="{url}" download>{text}</a></li>' for url, text in files.items())
    parts = [
        f"<h1>{name}</h1><p>{html.escape(entry.title)}</p>",
        f'<p><img src="{image}" alt="Picture of {name}"><br>{caption}</p>',
        f"<h2>Data</h2>{table(data)}",
        f"<h2>Best verified plan</h2>{table(plan_rows(model, answers))}",
        f"<h2>Published values</h2>{table(published)}" if any(published.values()) else "",
        f"<h2>Download</h2><ul>{links}</ul>",
        f'<div class="highlight"><pre>{"<br>".join(commands)}</pre></div>',
        '<p><a href="../../catalogue.html">All instances</a></p>',
    ]
    return "".join(parts)


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield the page of each entry, and write the files to download."""
    from crosstrack.instances import entries

    source = Path(app.srcdir)
    for entry in entries():
        model = model_of(entry.name)
        answers, planned = answers_to(source, model), best_plan(source, model)
        folder = Path(app.outdir, "instances", entry.name).parent
        folder.mkdir(parents=True, exist_ok=True)
        short = entry.name.partition("/")[2]
        texts = {f"{short}.json": (model.to_json(), "instance")}
        if planned is not None:
            objective = value_of(model, planned.primal_bound)
            words = f"plan with objective {objective} of <code>{planned.backend}</code>"
            texts[f"{short}.plan.json"] = (json.dumps(planned.stored_plan), words)
        for file, (text, _) in texts.items():
            (folder / file).write_text(text + "\n", "utf-8")
        # The catalogue has the same picture.
        image = app.env.images[picture(source, model)][1]
        files = {file: f"{words} (JSON)" for file, (_, words) in texts.items()}
        shown = QUICK.get(entry.name, "") if planned is None else planned.backend
        body = body_of(entry, model, answers, f"../../_images/{image}", shown, files)
        yield f"instances/{entry.name}", {"title": entry.name, "body": body}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the event handler that writes the pages."""
    app.connect("html-collect-pages", _pages)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
