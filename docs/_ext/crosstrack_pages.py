"""Pages about everything at once: the catalogue, the campaign, and what the conformance suite found.

* ``crosstrack-catalogue FILE``: every instance with a picture, its sizes, and its best value, which a source states
  or the records of a campaign hold;
* ``crosstrack-campaign FILE``: what the records of a campaign amount to, problem by problem;
* ``crosstrack-example``: Python that is run, with what it prints and draws;
* ``crosstrack-conformance FILE``: the backends of programs beside what the suite found of them.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

from crosstrack_site import Made, executes, markdown_table
from docutils import nodes
from sphinx.application import Sphinx

#: Why the leader of a problem leads, where numbers do not say it; the numbers come from the records.
REASONS = {
    "attractor": "Each backend estimates something else, an embedding, an exponent or a dimension, so they are "
    "no rivals: take the one that is named after what you want, or `full-analysis` for all of it.",
    "black-box": "Without a model of the function nobody proves anything. Take a deterministic search in few "
    "dimensions, and run whatever draws from several seeds.",
    "error-correction": "Label setting uses what a route is; a program has a row and a column for every leg, and "
    "grows with the square of the points. Take a solver of programs only for what the model does not know.",
    "fleet-mission": "The paper's pipeline optimises stage after stage and verifies nothing in between; "
    "`staged` repairs what a later stage broke.",
    "fleet-routing": "Exact backends prove small fleets; for others take `fleet-search`, and the "
    "routing solvers where the objective is the plain sum.",
    "grid-path": "Searches on the grid need milliseconds where programs need seconds. `any-angle` answers another "
    "question: shortest among all polylines, not among the moves of the grid.",
    "guided-path-tour": "Both exact searches prove; the dynamic programme is quicker where the precedence is "
    "loose, and A* where it is tight or the customers are many.",
    "messenger-tour": "Heuristics find the tour, relaxations bound it: run both, and read the gap.",
    "minimum-derivative": "The native solver uses the band of the system; general solvers build the program first.",
    "minimum-snap": "Without corridors the native banded solver is exact and needs no program, whose building takes "
    "longer than its solving. With corridors, have two solvers check one another.",
    "optimal-control": "Ipopt is the only one that solves nearly all of it. Others are worth a second opinion on "
    "small meshes.",
    "resource-routing": "Labels use the structure; programs are for what the model does not know.",
    "satellite-slew": "Steering laws give a flight at once and no optimum; Ipopt gives the optimum.",
    "sideslip": "Estimates are judged by their distance from the truth, which a backend never sees. Filters run "
    "along with the car; smoothers and moving horizons look back.",
    "time-allocation": "The native descent has the gradient of the banded system; transcribed, the same "
    "problem takes longer.",
    "unknown-grid": "`oracle`, which sees the whole map, is left out: it is what others are measured against, and "
    "no choice. Networks were trained on maps of this making and lead on them; replanning by A* needs no training "
    "and asks nothing of the map.",
}  # fmt: skip


#: What else the catalogue's published figures hold: a figure's key, and the words that stand before it.
FIGURES = {
    "optimum": "on other data",
    "printed": "printed",
    "final_time": "final time (s)",
    "exponent": "exponent",
    "exponent_bits": "exponent (bits)",
    "correlation": "correlation dimension",
    "delay": "delay",
    "dimension": "embedding dimension",
    "horizon": "horizon (s)",
    "mean": "mean error (°)",
    "deviation": "its deviation (°)",
    "range": "lengths (m)",
    "lengths": "lengths (m)",
    "greedy": "greedy (m)",
    "eight neighbours": "along eight neighbours",
}
#: Width and height of a small picture at most, in pixels; it is shown at two fifths of that.
SMALL = (320, 240)


def number_text(value: Any) -> str:
    """Return a figure, or several, as the catalogue shows them."""
    if isinstance(value, list | tuple):
        return " and ".join(map(number_text, value))
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)


def sizes_of(words: str) -> tuple[dict[str, str], str]:
    """Return the counts in a model's own words, by what is counted, and the words that are left.

    >>> sizes_of("3 robots, 40 × 40 cells, any direction")
    ({'robots': '3', 'cells': '40 × 40'}, 'any direction')
    """
    counts: dict[str, str] = {}
    rest = []
    for part in re.split(r"[,;:] ", words):
        found = re.match(r"(\d+(?: × \d+)?) ([a-z]+)\b ?(.*)", part)
        if found:
            counts[found[2]] = found[1]
        rest.append(found[3] if found else part)
    return counts, ", ".join(filter(None, rest))


def best_known(entry: Any, verdict: Any) -> tuple[str, str]:
    """Return the best value of an instance, and who says so: a source, or the campaign."""
    known = entry.published.get("objective", entry.published.get("optimum"))
    source = entry.published.get("source", entry.published.get("formula", ""))
    # Without a source, a value beside seeded data is the paper's, about data that it does not print.
    if known is not None and (source or entry.provenance != "seeded"):
        return number_text(known), source or "stated"
    from crosstrack.solvers.bench.standing import are_rivals

    if verdict is None or not are_rivals(entry.model):
        return "", ""
    if verdict.evidence.startswith("infeasible"):
        return "infeasible", "campaign, proven"
    if verdict.best is None:
        return "", ""
    proven = "proven" if verdict.evidence.startswith("optimum") else "not proven"
    return f"{verdict.best.primal_bound:.7g}", f"campaign, `{verdict.best.backend}`, {proven}"


def figures_of(entry: Any) -> str:
    """Return what else is printed of an instance, with its source even where there is no figure."""
    known = dict(entry.published)
    parts = []
    if "source" in known and not known.keys() & {"objective", "optimum"}:
        parts.append(str(known["source"]))
    elif "optimum" in known and (known.get("source") or entry.provenance != "seeded"):
        del known["optimum"]
    if "table" in known:
        parts.append(f"table {known['table']}, row {known['row']}")
    parts += [
        f"{words} {number_text(known[key])}" for key, words in FIGURES.items() if key in known
    ]
    return "; ".join(parts)


class Catalogue(Made):
    """Every instance, by problem: a picture, its sizes, its best known value and where that is from."""

    required_arguments = 1
    wide = True

    def make(self) -> str:
        from crosstrack.instances import entries
        from crosstrack.models.problems import PROBLEMS
        from crosstrack.solvers.bench import read_records

        path = Path(self.env.app.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        verdicts = {one.solutions[0].digest: one for one in read_records(path).verdicts}
        groups: dict[str, list[Any]] = {}
        for entry in entries():
            groups.setdefault(entry.name.partition("/")[0], []).append(entry)
        parts = [
            "## Contents",
            f"{sum(map(len, groups.values()))} instances of {len(groups)} problems: "
            + ", ".join(f"[{name}](#{name}) ({len(found)})" for name, found in groups.items())
            + ".",
        ]
        pages = {problem.replace("_", "-") for problem in PROBLEMS}
        for name, found in groups.items():
            parts.append(f"## {name}")
            if name in pages:
                parts.append(f"[The problem](problems/{name}.md), with its equations and backends.")
            parts.append(self._table(found, verdicts))
        return "\n\n".join(parts)

    def _table(self, entries: list[Any], verdicts: dict[str, Any]) -> str:
        """Return the table of a problem, with a column for each size that two instances have."""
        models = [entry.build() for entry in entries]
        sizes = [sizes_of(model.describe()) for model in models]
        words = {word for counts, _ in sizes for word in counts}
        # One vehicle belongs to the column of those that have several.
        sizes = [
            ({f"{word}s" if f"{word}s" in words else word: n for word, n in counts.items()}, rest)
            for counts, rest in sizes
        ]
        count = Counter(word for counts, _ in sizes for word in counts)
        columns = [word for word, number in count.items() if number > 1]
        rows = []
        for entry, model, (counts, rest) in zip(entries, models, sizes, strict=True):
            value, source = best_known(entry, verdicts.get(model.digest))
            unit = f" {model.objective_unit}" if value and value != "infeasible" else ""
            left = [f"{n} {word}" for word, n in counts.items() if word not in columns]
            rows.append(
                {
                    "": self._picture(entry, model),
                    "instance": f"`{entry.name}`<br>{entry.title}",
                    **{word: counts.get(word, "") for word in columns},
                    "further": ", ".join([*left, rest] if rest else left),
                    "data": entry.provenance,
                    "best known": f"{value}{unit}<br>{source}" if value else "",
                    "printed besides": figures_of(entry),
                }
            )
        heads = [head for head in rows[0] if any(row[head] for row in rows)]
        return markdown_table(heads, ([row[head] for head in heads] for row in rows))

    def _picture(self, entry: Any, model: Any) -> str:
        """Return the picture of an instance without a plan; drawn once, for its content has a digest."""
        import crosstrack

        folder = Path(self.env.app.srcdir) / "generated" / "catalogue"
        file = folder / f"{model.kind}-{model.digest[:12]}.webp"
        if not file.exists():
            folder.mkdir(parents=True, exist_ok=True)
            figure = crosstrack.plot(model)
            dpi = min(SMALL[0] / figure.get_figwidth(), SMALL[1] / figure.get_figheight())
            figure.savefig(file, dpi=dpi, pil_kwargs={"quality": 75})
        return f"![{entry.name}](generated/catalogue/{file.name})"


def _lazy(app: Sphinx, tree: nodes.document) -> None:
    """Say how large the small pictures are, so that those out of sight wait until they come into it."""
    from PIL import Image

    for node in tree.findall(nodes.image):
        if "generated/catalogue/" in node["uri"]:
            with Image.open(Path(app.srcdir) / node["uri"]) as image:
                width, height = (f"{size * 2 // 5}px" for size in image.size)
            node.attributes.update(loading="lazy", width=width, height=height)


class Campaign(Made):
    """What the records of a campaign amount to: verdicts, and for each problem a table and a choice."""

    required_arguments = 1
    wide = True
    #: Backends of a problem that are shown at most.
    most = 12

    def make(self) -> str:
        from crosstrack.solvers.bench import read_records

        path = Path(self.env.app.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        records = read_records(path)
        counts = Counter(str(one.outcome) for one in records.verdicts)
        words = ", ".join(f"{count} {word}" for word, count in counts.most_common())
        where = records.solutions[0].environment
        head = (
            f"{len(records.solutions)} answers of {len({s.backend for s in records.solutions})} backends on "
            f"{len(records.verdicts)} instances: {words}. Run on {where.get('processors')} processors "
            f"({where.get('processor')}, {where.get('memory')} GiB), Python {where.get('python')}, one thread "
            "a job, at a relative gap and a tolerance of 1e-6."
        )
        parts = ["## All together", head]
        for kind in records.standings:
            own = [v for v in records.verdicts if v.solutions[0].model == kind]
            parts += self._problem(kind, own, records.standings[kind])
        return "\n\n".join(parts)

    def _problem(self, kind: str, verdicts: list[Any], standings: list[Any]) -> list[str]:
        from crosstrack.solvers.bench.standing import are_rivals
        from crosstrack.solvers.report.tables import seconds_text

        counts = Counter(str(one.outcome) for one in verdicts)
        limits = sorted({float(s.options["time_limit"]) for v in verdicts for s in v.solutions})
        able = [one for one in standings if one.solved and are_rivals(kind)]
        parts = [f"## {kind}"]
        words = ", ".join(f"{count} {word}" for word, count in counts.most_common())
        text = f"{len(verdicts)} instances ({words}), {' or '.join(f'{one:g}' for one in limits)} s a job. "
        if able:
            first = able[0]
            text += (
                f"**Take `{first.label}`**: it solved {first.solved} of {first.of}, typically in "
                f"{seconds_text(first.typical)}"
            )
            # Of those that solve all that they accept, the quickest one.
            whole = [
                one
                for one in able
                if 2 * one.solved >= first.solved and one.solved == one.instances
            ]
            quick = min(whole, key=lambda one: one.median, default=first)
            if quick is not first and quick.median < first.median:
                text += (
                    f"; where `{quick.label}` fits, it solved {quick.solved} of {quick.instances}, with a "
                    f"median of {seconds_text(quick.median)} against {seconds_text(first.median)}"
                )
            text += ". "
        parts.append(text + REASONS.get(kind, ""))
        rows = [
            (
                f"`{one.label}`", len({s.instance for s, _ in one.answers if s.stored_plan is not None}),
                f"{one.solved}\u00a0of\u00a0{one.of}", one.instances, one.proven, one.best, one.fastest,
                seconds_text(one.typical), seconds_text(one.median),
                "" if one.integral is None else f"{100 * one.integral:.3g} %",
            )
            for one in standings[: self.most]
        ]  # fmt: skip
        left = len(standings) - len(rows)
        columns = (
            "backend",
            "with a plan",
            "solved",
            "ran on",
            "proven",
            "best plan",
            "fastest",
            "typical seconds",
            "median seconds",
            "gap over time",
        )
        parts.append(markdown_table(columns, rows))
        if left > 0:
            parts.append(f"{left} more solved fewer; the report shows all.")
        return parts


class Example(Made):
    """Python that is run as it stands, with what it prints, and the last figure that it makes."""

    has_content = True

    def make(self) -> str:
        from matplotlib.figure import Figure

        code = "\n".join(self.content)
        if not executes(self.env.app):
            return f"```python\n{code}\n```"
        names: dict[str, Any] = {}
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "<example>", "exec"), names)  # noqa: S102 - the page is the site's own
        parts = [f"```python\n{code}\n```", f"```text\n{printed.getvalue().rstrip()}\n```"]
        figures = [value for value in names.values() if isinstance(value, Figure)]
        if figures:
            folder = Path(self.env.app.srcdir) / "generated"
            folder.mkdir(parents=True, exist_ok=True)
            name = (
                f"{Path(self.env.docname).name}-{hashlib.sha256(code.encode()).hexdigest()[:8]}.png"
            )
            figures[-1].savefig(folder / name, dpi=110)
            parts.append(f"![What the example draws](generated/{name})")
        return "\n\n".join(parts)


class Conformance(Made):
    """The backends of programs, beside what the conformance suite found of each."""

    required_arguments = 1
    wide = True

    def make(self) -> str:
        path = Path(self.env.app.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        data = json.loads(path.read_text())
        rows = [
            (
                f"`{one['name']}`", one["version"] or "", one["passed"], one["unsupported"],
                one["failed"], ", ".join(one["features"]),
            )
            for one in data["backends"]
        ]  # fmt: skip
        columns = ("backend", "version", "passed", "unsupported", "failed", "declares")
        failures = [
            (f"`{one['name']}`", *failure.split(": ", 2))
            for one in data["backends"]
            for failure in one["failures"]
        ]
        parts = [data["words"], markdown_table(columns, rows)]
        if failures:
            parts.append("What failed:")
            parts.append(markdown_table(("backend", "programs", "case", "what came out"), failures))
        return "\n\n".join(parts)


def _report(app: Sphinx, error: Exception | None) -> None:
    """Write the campaign's report beside the pages, with its pictures where examples are run."""
    if error is not None or app.builder.format != "html":
        return
    import crosstrack
    from crosstrack.solvers.bench import read_records, write_page

    records = read_records(Path(app.srcdir) / "campaign" / "records.jsonl")
    command = "crosstrack bench docs/campaign/campaign.toml --record records.jsonl --workers 2"
    load = crosstrack.load if executes(app) else None
    write_page(
        records, Path(app.outdir) / "campaign-report.html",
        title="Every problem, every backend", command=command, load=load,
    )  # fmt: skip


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("crosstrack-catalogue", Catalogue)
    app.add_directive("crosstrack-campaign", Campaign)
    app.connect("doctree-read", _lazy)
    app.add_directive("crosstrack-conformance", Conformance)
    app.add_directive("crosstrack-example", Example)
    app.connect("build-finished", _report)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
