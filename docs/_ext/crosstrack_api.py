"""API reference with one page per public class and one page per problem.

* ``crosstrack-api MODULE``: the public names of a module, without those in ``:not:``, or only those in ``:only:``.
  Functions and exceptions are documented in place. Each class has a separate page, which is generated before
  Sphinx reads the sources;
* ``crosstrack-problem-api``: links to the generated pages of the problems.

A role with an alias of a public name, such as ``crosstrack.models.MinimumSnap``, is resolved to the documented
object.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from crosstrack_site import Made
from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain
from sphinx.environment import BuildEnvironment

#: Folder of the generated pages, relative to the source folder.
FOLDER = "generated/api"

#: Additional entries of a problem's page: heading, module and names.
MORE = {
    "messenger": [("Relaxation", "models.messenger.relaxation", "euclidean_relaxation")],
    "minimum_snap": [
        ("Formulations", "models.minimum_snap.formulations.piecewise", "PiecewiseFormulation"),
        ("", "models.minimum_snap.formulations.paper", ""),
        ("", "models.minimum_snap.formulations.bases", "MonomialFormulation LegendreFormulation"),
        ("", "models.minimum_snap.formulations.hermite", ""),
    ],
    "optimal_control": [
        ("Declaration", "models.optimal_control.declaration.problem", "ControlProblemBuilder"),
        ("", "models.optimal_control.declaration.phase", "PhaseBuilder"),
        ("", "models.optimal_control.declaration.guess", "Guessed"),
        ("Transcriptions", "models.optimal_control.transcription.base", "Transcription"),
        ("", "models.optimal_control.transcription.methods", ""),
        ("Prepared solvers", "solvers.optimal_control.prepared", "PreparedSolver Step"),
        ("", "solvers.optimal_control.sensitivity", "Sensitivity"),
    ],
    "satellite_slew": [
        ("Gyros and attitudes", "models.satellite_slew.gyros", ""),
        ("", "models.satellite_slew.quaternions", ""),
    ],
    "black_box": [("Landscapes", "models.black_box.functions", "Landscape")],
    "unknown_grid": [
        ("Observations and camera", "models.unknown_grid.world", "Looks"),
        ("", "models.unknown_grid.camera", "Pinhole"),
        ("Gymnasium environment", "solvers.unknown_grid.gymnasium", ""),
    ],
}
#: Module and name of the plot function if it is not ``plot`` with all its public names.
PLOTS = {
    "minimum_snap": ("plot.picture", ""),
    "error_correction": ("plot", "draw"),
    "optimal_control": ("plot", "draw"),
}


def public(name: str, only: str = "", left_out: str = "") -> dict[str, Any]:
    """Return the public objects of a module by name."""
    module = importlib.import_module(name)
    chosen = only.replace(",", " ").split() or getattr(module, "__all__", ())
    without = left_out.replace(",", " ").split()
    return {n: getattr(module, n) for n in chosen if n not in without and not n.startswith("__")}


def has_page(value: Any) -> bool:
    """Return True if the object is documented on a separate page."""
    return inspect.isclass(value) and not issubclass(value, BaseException)


class Api(Made):
    """Public names of a module: a table, documented functions, and links to the pages of classes."""

    required_arguments = 1
    option_spec = {"not": directives.unchanged, "only": directives.unchanged}

    def make(self) -> str:
        name = self.arguments[0]
        objects = public(name, self.options.get("only", ""), self.options.get("not", ""))
        # Only a complete module is registered as a link target.
        directive = "currentmodule" if "only" in self.options else "module"
        lines = ["```{eval-rst}", f".. {directive}:: {name}", "", ".. autosummary::", ""]
        lines += [f"   {n}" for n in objects]
        if any(map(has_page, objects.values())):
            lines += ["", ".. toctree::", "   :hidden:", ""]
        lines += [f"   /{FOLDER}/{name}.{n}" for n, value in objects.items() if has_page(value)]
        for n, value in objects.items():
            if inspect.isclass(value):
                if not has_page(value):
                    lines += ["", f".. autoclass:: {n}", "   :show-inheritance:"]
            elif inspect.isroutine(value):
                lines += ["", f".. autofunction:: {n}"]
            else:
                lines += ["", f".. autodata:: {n}"]
        return "\n".join([*lines, "", "```"])


class ProblemApi(Made):
    """Links to the reference pages of the problems."""

    def make(self) -> str:
        from crosstrack.models.problems import PROBLEMS

        lines = (f"/{FOLDER}/{problem}" for problem in PROBLEMS)
        return "\n".join(["```{toctree}", ":maxdepth: 1", "", *lines, "```"])


def problem_page(problem: str) -> str:
    """Return the reference page of a problem as Markdown."""

    def part(heading: str, module: str, only: str = "") -> str:
        options = f":only: {only}\n" if only else ""
        text = f"```{{crosstrack-api}} crosstrack.{module}\n{options}```"
        return f"## {heading}\n\n{text}" if heading else text

    page = problem.replace("_", "-")
    plot, drawn = PLOTS.get(problem, ("plot", ""))
    parts = [
        f"# {problem.replace('_', ' ').capitalize()}",
        f"[Description of the problem](../../problems/{page}.md) with equations and backends.",
        part("Models and plans", f"models.{problem}"),
        *(part(*entry) for entry in MORE.get(problem, ())),
        part("Plots", f"models.{problem}.{plot}", drawn),
    ]
    if public(f"crosstrack.instances.{problem}"):
        parts.append(part("Instances, readers and writers", f"instances.{problem}"))
    return "\n\n".join(parts) + "\n"


def class_page(module: str, name: str, value: type) -> str:
    """Return the reference page of a class as reStructuredText."""
    lines = [
        name,
        "=" * len(name),
        "",
        f".. currentmodule:: {module}",
        "",
        f".. autoclass:: {name}",
    ]
    if value.__bases__ != (object,):
        lines.append("   :show-inheritance:")
    return "\n".join([*lines, "   :members:", ""])


def _classes_on(pages: list[str]) -> Iterator[tuple[str, str, type]]:
    """Yield module, name and class of each class that the pages reference."""
    pattern = r"^```\{crosstrack-api\} (\S+)\n((?::.*\n)*)```$"
    for page in pages:
        for name, options in re.findall(pattern, page, re.M):
            given = dict(re.findall(r"^:(\w+): (.*)$", options, re.M))
            for n, value in public(name, given.get("only", ""), given.get("not", "")).items():
                if inspect.isclass(value):
                    yield name, n, value


def _write(app: Sphinx) -> None:
    """Write changed pages and remove obsolete ones."""
    from crosstrack.models.problems import PROBLEMS

    problems = {f"{problem}.md": problem_page(problem) for problem in PROBLEMS}
    source = Path(app.srcdir)
    by_hand = [path.read_text("utf-8") for path in sorted((source / "api").glob("*.md"))]
    listed = list(_classes_on([*by_hand, *problems.values()]))
    classes = {f"{module}.{n}": class_page(module, n, v) for module, n, v in listed if has_page(v)}
    pages = {**problems, **{f"{name}.rst": text for name, text in classes.items()}}
    # Unique class names, which docstrings use in Parameters, Returns and Raises.
    count = Counter(n for _, n, _ in listed)
    named = {n: f"{module}.{n}" for module, n, _ in listed if count[n] == 1}
    app.config.numpydoc_xref_aliases_complete = named
    folder = source / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for path in folder.iterdir():
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def _same(target: str) -> tuple[str, str] | None:
    """Return the defining module and qualified name of a class or function, or None."""
    try:
        value = pkgutil.resolve_name(target)
    except (ImportError, AttributeError, ValueError):
        return None
    known = inspect.isclass(value) or inspect.isfunction(value)
    return (value.__module__, value.__qualname__) if known else None


@cache
def _homes(domain: PythonDomain) -> dict[tuple[str, str] | None, str]:
    """Return the documented path of each class and function by its defining name."""
    return {_same(name): name for name, entry in domain.objects.items() if not entry.aliased}


def _elsewhere(app: Sphinx, env: BuildEnvironment, node: Any, text: nodes.Node) -> Any:
    """Resolve a role to the documented path of the same class or function."""
    target = node.get("reftarget", "")
    target = app.config.numpydoc_xref_aliases_complete.get(target, target)
    if node.get("refdomain") != "py" or not target.startswith("crosstrack."):
        return None
    domain = env.domains.python_domain
    owner, _, member = target.rpartition(".")
    for path, rest in ((target, ""), (owner, f".{member}")):
        known = _same(path)
        home = f"{_homes(domain)[known]}{rest}" if known in _homes(domain) and known else ""
        if home in domain.objects:
            return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", home, node, text)
    return None


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives and the event handlers that write pages and resolve links."""
    app.add_directive("crosstrack-api", Api)
    app.add_directive("crosstrack-problem-api", ProblemApi)
    app.connect("builder-inited", _write)
    app.connect("missing-reference", _elsewhere)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
