"""Pages about everything at once: the catalogue, the campaign, and what the conformance suite found.

* ``crosstrack-catalogue``: every instance with its size, source and best value, a picture a problem;
* ``crosstrack-campaign FILE``: what the records of a campaign amount to, problem by problem;
* ``crosstrack-example``: Python that is run, with what it prints and draws;
* ``crosstrack-conformance FILE``: the backends of programs beside what the suite found of them.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

from crosstrack_site import Made, executes, markdown_table
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


class Catalogue(Made):
    """Every instance, by problem; above each a picture of its first one."""

    wide = True

    def make(self) -> str:
        from crosstrack.instances import entries
        from crosstrack.models.problems import PROBLEMS

        groups: dict[str, list[Any]] = {}
        for entry in entries():
            groups.setdefault(entry.name.partition("/")[0], []).append(entry)
        folder = Path(self.env.app.srcdir) / "generated" / "catalogue"
        folder.mkdir(parents=True, exist_ok=True)
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
            rows = []
            for entry in found:
                model = entry.build()
                known = entry.published.get("objective", entry.published.get("optimum"))
                value = f"{known:.10g}" if isinstance(known, int | float) else ""
                source = entry.published.get("source", "") if value else ""
                rows.append(
                    (
                        f"`{entry.name}`",
                        entry.title,
                        model.describe(),
                        entry.provenance,
                        value,
                        source,
                    )
                )
            parts.append(self._picture(found[0], folder))
            columns = ("instance", "", "size", "data", "best known", "from")
            parts.append(markdown_table(columns, rows))
        return "\n\n".join(parts)

    def _picture(self, entry: Any, folder: Path) -> str:
        """Return the picture of an instance without a plan; drawn once, for its content has a digest."""
        import crosstrack

        model = entry.build()
        file = folder / f"{model.kind}-{model.digest[:12]}.png"
        if not file.exists():
            crosstrack.plot(model).savefig(file, dpi=60)
        return f"![{entry.name}](generated/catalogue/{file.name})"


class Campaign(Made):
    """What the records of a campaign amount to: verdicts, and for each problem a table and a choice."""

    required_arguments = 1
    wide = True
    #: Backends of a problem that are shown at most.
    most = 12

    def make(self) -> str:
        from crosstrack.solvers.bench import read_records
        from crosstrack.solvers.bench.standing import rank

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
        kinds = sorted({one.solutions[0].model for one in records.verdicts})
        for kind in kinds:
            own = [
                self._without_references(v)
                for v in records.verdicts
                if v.solutions[0].model == kind
            ]
            parts += self._problem(kind, own, rank(own))
        return "\n\n".join(parts)

    @staticmethod
    def _without_references(verdict: Any) -> Any:
        """Return the verdict on those that see no more than a model shows."""
        from crosstrack.solvers import find_backend
        from crosstrack.solvers.verdict import judge

        fair = [
            one
            for one in verdict.solutions
            if not find_backend(one.backend, problem=one.problem or None).sees_hidden
        ]
        same = len(fair) == len(verdict.solutions)
        return verdict if same else judge(verdict.instance, fair)

    def _problem(self, kind: str, verdicts: list[Any], standings: list[Any]) -> list[str]:
        from crosstrack.solvers.report.tables import seconds_text

        counts = Counter(str(one.outcome) for one in verdicts)
        limits = sorted({float(s.options["time_limit"]) for v in verdicts for s in v.solutions})
        # Different estimates have no common best.
        able = [one for one in standings if one.solved and kind != "attractor"]
        parts = [f"## {kind}"]
        words = ", ".join(f"{count} {word}" for word, count in counts.most_common())
        text = f"{len(verdicts)} instances ({words}), {' or '.join(f'{one:g}' for one in limits)} s a job. "
        if able:
            first = able[0]
            text += (
                f"**Take `{first.label}`**: it solved {first.solved} of {first.instances}, typically in "
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
                f"{one.solved} of {one.instances}", one.best, one.fastest,
                seconds_text(one.typical), seconds_text(one.median),
            )
            for one in standings[: self.most]
        ]  # fmt: skip
        left = len(standings) - len(rows)
        columns = (
            "backend",
            "with a plan",
            "solved",
            "best plan",
            "fastest",
            "typical seconds",
            "median seconds",
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
        return f"{data['words']}\n\n{markdown_table(columns, rows)}"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("crosstrack-catalogue", Catalogue)
    app.add_directive("crosstrack-campaign", Campaign)
    app.add_directive("crosstrack-conformance", Conformance)
    app.add_directive("crosstrack-example", Example)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
