"""Directives for the pages on the catalogue, the campaign and the conformance suite, and for examples.

* ``crosstrack-catalogue FILE``: every instance with a picture, a link to its page, its sizes, and its best known value
  from a source or from the records of a campaign;
* ``crosstrack-campaign FILE``: the summary of the records of a campaign by problem;
* ``crosstrack-example``: Python code that is run, with its output and its last figure;
* ``crosstrack-conformance FILE``: the results of the conformance suite by backend.
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

from crosstrack_pictures import model_of, picture
from crosstrack_site import Made, executes, markdown_table
from crosstrack_tables import best, competes
from sphinx.application import Sphinx

#: Remarks on the recommended backend of a problem, beyond the numbers of the records.
REASONS = {
    "attractor": "The backends estimate different quantities (an embedding, an exponent or a dimension), so they do "
    "not compete: select the one with the required quantity, or `full-analysis` for all of them.",
    "black-box": "Without a model of the function no backend can prove a bound. Use a deterministic method in few "
    "dimensions, and run randomised methods with several seeds.",
    "error-correction": "Label setting exploits the structure of a route. A program has a row and a column per leg, and "
    "grows with the square of the number of points. Use a solver of programs only for constraints that the model "
    "does not have.",
    "fleet-mission": "The paper's pipeline optimises each stage without verification in between; "
    "`staged` repairs infeasible results of later stages.",
    "fleet-routing": "Exact backends prove small fleets. For larger ones use `fleet-search`, or the "
    "routing solvers if the objective is the total length.",
    "grid-path": "Searches on the grid take milliseconds, programs take seconds. `any-angle` solves another "
    "problem: the shortest polyline instead of the shortest path along grid moves.",
    "guided-path-tour": "Both exact searches prove optimality. The dynamic program is faster for loose precedence, "
    "and A* for tight precedence or many customers.",
    "messenger-tour": "Heuristics find tours and relaxations prove bounds: run both to obtain the gap.",
    "minimum-derivative": "The native solver uses the band structure; general solvers first build the program.",
    "minimum-snap": "Without corridors the native banded solver is exact and builds no program, which would take "
    "longer than the solution. With corridors, compare two solvers.",
    "optimal-control": "Only Ipopt solves nearly all instances. Use other solvers as a second opinion on "
    "small meshes.",
    "resource-routing": "Labels exploit the structure; use programs for constraints that the model does not have.",
    "satellite-slew": "Steering laws return a feasible slew immediately, but not an optimum. Ipopt finds a local optimum.",
    "sequential-ordering": "The exact search begins with the local search, so its plans are at least as good and have a "
    "bound. Programs are for few nodes.",
    "sideslip": "Estimates are evaluated by their distance from the truth, which is hidden from backends. Filters run "
    "online; smoothers run offline, and moving horizons use a window of past samples.",
    "time-allocation": "The native descent uses the gradient of the banded system; the transcribed problem takes longer.",
    "unknown-grid": "`oracle`, which reads the whole map, is omitted: it is a reference, not a competitor. Networks "
    "were trained on similar maps and lead on them; replanning by A* needs no training and makes no assumptions on "
    "the map.",
}  # fmt: skip


#: Labels of further published values in the catalogue, by key.
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


def number_text(value: Any) -> str:
    """Return one or several numbers as text."""
    if isinstance(value, list | tuple):
        return " and ".join(map(number_text, value))
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)


def sizes_of(words: str) -> tuple[dict[str, str], str]:
    """Return the counts in a model's description by noun, and the remaining words.

    >>> sizes_of("3 robots, 40 × 40 cells, any direction")
    ({'robots': '3', 'cells': '40 × 40'}, 'any direction')
    """
    counts: dict[str, str] = {}
    rest = []
    for part in re.split(r"[,;:] ", words):
        match = re.match(r"(\d+(?: × \d+)?) ([a-z]+)\b ?(.*)", part)
        if match:
            counts[match[2]] = match[1]
        rest.append(match[3] if match else part)
    return counts, ", ".join(filter(None, rest))


def best_known(entry: Any, verdict: Any) -> tuple[str, str]:
    """Return the best known value of an instance and its source."""
    known = entry.published.get("objective", entry.published.get("optimum"))
    source = entry.published.get("source", entry.published.get("formula", ""))
    # Without a source, the value of a seeded instance is the paper's, for data that it does not print.
    if known is not None and (source or entry.provenance != "seeded"):
        return number_text(known), source or "stated"
    from crosstrack.solvers.bench.standing import are_rivals

    if verdict is None or not are_rivals(entry.model):
        return "", ""
    if verdict.evidence.startswith("infeasible"):
        return "infeasible", "campaign, proven"
    leader = best([answer for answer in verdict.solutions if competes(answer)])
    if leader is None:
        return "", ""
    proven = "proven" if verdict.evidence.startswith("optimum") else "not proven"
    return f"{leader.primal_bound:.7g}", f"campaign, `{leader.backend}`, {proven}"


def figures_of(entry: Any) -> str:
    """Return the other published values of an instance, with the source of an instance without values."""
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
    """Tables of all instances by problem: picture, sizes, best known value and its source."""

    required_arguments = 1
    wide = True

    def make(self) -> str:
        from crosstrack.instances import entries
        from crosstrack.models.problems import PROBLEMS
        from crosstrack.solvers.bench import read_records

        path = Path(self.env.app.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        verdicts = {verdict.solutions[0].digest: verdict for verdict in read_records(path).verdicts}
        groups: dict[str, list[Any]] = {}
        for entry in entries():
            groups.setdefault(entry.name.partition("/")[0], []).append(entry)
        parts = [
            "## Contents",
            f"{sum(map(len, groups.values()))} instances of {len(groups)} problems: "
            + ", ".join(f"[{name}](#{name}) ({len(members)})" for name, members in groups.items())
            + ".",
        ]
        pages = {problem.replace("_", "-") for problem in PROBLEMS}
        for name, members in groups.items():
            parts.append(f"## {name}")
            if name in pages:
                parts.append(
                    f"[Description of the problem](problems/{name}.md) with equations and backends."
                )
            parts.append(self._table(members, verdicts))
        return "\n\n".join(parts)

    def _table(self, entries: list[Any], verdicts: dict[str, Any]) -> str:
        """Return the table of a problem, with a column for each size that at least two instances have."""
        models = [model_of(entry.name) for entry in entries]
        source = Path(self.env.app.srcdir)
        sizes = [sizes_of(model.describe()) for model in models]
        words = {word for counts, _ in sizes for word in counts}
        # "1 vehicle" belongs to the column "vehicles".
        sizes = [
            ({f"{word}s" if f"{word}s" in words else word: n for word, n in counts.items()}, rest)
            for counts, rest in sizes
        ]
        count = Counter(word for counts, _ in sizes for word in counts)
        columns = [word for word, number in count.items() if number > 1]
        rows = []
        for entry, model, (counts, rest) in zip(entries, models, sizes, strict=True):
            value, origin = best_known(entry, verdicts.get(model.digest))
            unit = f" {model.objective_unit}" if value and value != "infeasible" else ""
            further = [f"{n} {word}" for word, n in counts.items() if word not in columns]
            link = f'<a href="instances/{entry.name}.html"><code>{entry.name}</code></a>'
            rows.append(
                {
                    "": f"![{entry.name}]({picture(source, model)})",
                    "instance": f"{link}<br>{entry.title}",
                    **{word: counts.get(word, "") for word in columns},
                    "further": ", ".join([*further, rest] if rest else further),
                    "data": entry.provenance,
                    "best known": f"{value}{unit}<br>{origin}" if value else "",
                    "other printed values": figures_of(entry),
                }
            )
        heads = [head for head in rows[0] if any(row[head] for row in rows)]
        return markdown_table(heads, ([row[head] for head in heads] for row in rows))


class Campaign(Made):
    """Summary of the records of a campaign: verdicts, and a table and a recommendation per problem."""

    required_arguments = 1
    wide = True
    #: Maximum number of backends shown per problem.
    limit = 12

    def make(self) -> str:
        from crosstrack.solvers.bench import read_records

        path = Path(self.env.app.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        records = read_records(path)
        counts = Counter(str(verdict.outcome) for verdict in records.verdicts)
        words = ", ".join(f"{count} {word}" for word, count in counts.most_common())
        where = records.solutions[0].environment
        head = (
            f"{len(records.solutions)} answers of {len({s.backend for s in records.solutions})} backends on "
            f"{len(records.verdicts)} instances: {words}. Run on {where.get('processors')} processors "
            f"({where.get('processor')}, {where.get('memory')} GiB), Python {where.get('python')}, one thread "
            "per job, relative gap and tolerance 1e-6."
        )
        parts = ["## Summary", head]
        for kind in records.standings:
            own = [v for v in records.verdicts if v.solutions[0].model == kind]
            parts += self._problem(kind, own, records.standings[kind])
        return "\n\n".join(parts)

    def _problem(self, kind: str, verdicts: list[Any], standings: list[Any]) -> list[str]:
        from crosstrack.solvers.bench.standing import are_rivals
        from crosstrack.solvers.report.tables import seconds_text

        counts = Counter(str(verdict.outcome) for verdict in verdicts)
        limits = sorted({float(s.options["time_limit"]) for v in verdicts for s in v.solutions})
        able = [standing for standing in standings if standing.solved and are_rivals(kind)]
        parts = [f"## {kind}"]
        words = ", ".join(f"{count} {word}" for word, count in counts.most_common())
        text = f"{len(verdicts)} instances ({words}), {' or '.join(f'{limit:g}' for limit in limits)} s per job. "
        if able:
            first = able[0]
            text += (
                f"**Recommended: `{first.label}`**. It solved {first.solved} of {first.of}, typically in "
                f"{seconds_text(first.typical)}"
            )
            # The fastest backend among those that solve every instance they accept.
            whole = [
                standing
                for standing in able
                if 2 * standing.solved >= first.solved and standing.solved == standing.instances
            ]
            quick = min(whole, key=lambda standing: standing.median, default=first)
            if quick is not first and quick.median < first.median:
                text += (
                    f"; `{quick.label}` solved {quick.solved} of {quick.instances} accepted instances, with a "
                    f"median of {seconds_text(quick.median)} instead of {seconds_text(first.median)}"
                )
            text += ". "
        parts.append(text + REASONS.get(kind, ""))
        rows = [
            (
                f"`{standing.label}`",
                len({s.instance for s, _ in standing.answers if s.stored_plan is not None}),
                f"{standing.solved}\u00a0of\u00a0{standing.of}", standing.instances,
                standing.proven, standing.best, standing.fastest,
                seconds_text(standing.typical), seconds_text(standing.median),
                "" if standing.integral is None else f"{100 * standing.integral:.3g} %",
            )
            for standing in standings[: self.limit]
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
            parts.append(f"Backends with fewer solved instances, shown in the report only: {left}.")
        return parts


class Example(Made):
    """Python code that is run, with its output and its last figure."""

    has_content = True

    def make(self) -> str:
        from matplotlib.figure import Figure

        code = "\n".join(self.content)
        if not executes(self.env.app):
            return f"```python\n{code}\n```"
        names: dict[str, Any] = {}
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            exec(compile(code, "<example>", "exec"), names)  # noqa: S102 - the page is the site's own
        parts = [f"```python\n{code}\n```", f"```text\n{output.getvalue().rstrip()}\n```"]
        figures = [value for value in names.values() if isinstance(value, Figure)]
        if figures:
            folder = Path(self.env.app.srcdir) / "generated"
            folder.mkdir(parents=True, exist_ok=True)
            name = (
                f"{Path(self.env.docname).name}-{hashlib.sha256(code.encode()).hexdigest()[:8]}.png"
            )
            figures[-1].savefig(folder / name, dpi=110)
            parts.append(f"![Figure of the example](generated/{name})")
        return "\n\n".join(parts)


class Conformance(Made):
    """Table of the results of the conformance suite by backend."""

    required_arguments = 1
    wide = True

    def make(self) -> str:
        path = Path(self.env.app.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        data = json.loads(path.read_text())
        rows = [
            (
                f"`{backend['name']}`", backend["version"] or "", backend["passed"], backend["unsupported"],
                backend["failed"], ", ".join(backend["features"]),
            )
            for backend in data["backends"]
        ]  # fmt: skip
        columns = ("backend", "version", "passed", "unsupported", "failed", "declares")
        failures = [
            (f"`{backend['name']}`", *failure.split(": ", 2))
            for backend in data["backends"]
            for failure in backend["failures"]
        ]
        parts = [data["words"], markdown_table(columns, rows)]
        if failures:
            parts.append("Failures:")
            parts.append(markdown_table(("backend", "programs", "case", "result"), failures))
        return "\n\n".join(parts)


def _report(app: Sphinx, error: Exception | None) -> None:
    """Write the campaign's report to the site, with pictures if the build runs examples."""
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
        pictures=len(records.verdicts),
    )  # fmt: skip


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("crosstrack-catalogue", Catalogue)
    app.add_directive("crosstrack-campaign", Campaign)
    app.add_directive("crosstrack-conformance", Conformance)
    app.add_directive("crosstrack-example", Example)
    app.connect("build-finished", _report)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
