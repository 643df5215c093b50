"""API reference with one page per public class, verb and problem.

* ``crosstrack-api MODULE``: the public names of a module, without those in ``:not:``, or only those in ``:only:``.
  Each class has a separate page, which is generated before Sphinx reads the sources. Functions and exceptions are
  documented in place. With ``:pages:`` functions have separate pages too, which the search of the site ranks first
  for ``ct.NAME`` and ``NAME``;
* ``crosstrack-problem-api``: links to the generated pages of the problems.

A role with an alias of a public name, such as ``crosstrack.models.MinimumSnap``, or with the name of a verb or class is
resolved to the documented object, and a role with the name of a field to the page of its class.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Generic, get_origin

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
        ("", "models.minimum_snap.formulations.cones", "ConeProgramFormulation"),
        ("", "models.minimum_snap.formulations.vehicles", ""),
        ("Vehicles", "models.minimum_snap.vehicle_base", "Vehicle Measure Extreme"),
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
    "grid_path": [("Prepared maps", "solvers.grid_path.prepared", "PreparedMap PathAnswer")],
    "sideslip": [("Online estimators", "solvers.sideslip.online", "OnlineFilter OnlineEstimate")],
    "satellite_slew": [
        ("Gyros and attitudes", "models.satellite_slew.gyros", ""),
        ("", "models.satellite_slew.quaternions", ""),
    ],
    "black_box": [
        ("Landscapes", "models.black_box.functions", "Landscape OnError"),
        ("Ask and tell", "solvers.black_box.asking", "AskTell"),
    ],
    "unknown_grid": [
        ("Observations and camera", "models.unknown_grid.world", "Looks"),
        ("", "models.unknown_grid.camera", "Pinhole"),
        ("Gymnasium environment", "solvers.unknown_grid.gymnasium", ""),
        ("", "solvers.unknown_grid.vector", "UnknownGridVectorEnv"),
        ("", "solvers.unknown_grid.registration", "register"),
    ],
}
#: Module and name of the plot function if it is not ``plot`` with all its public names.
PLOTS = {
    "minimum_snap": ("plot.picture", ""),
    "error_correction": ("plot", "draw, animate_route"),
    "optimal_control": ("plot", "draw, animate_control"),
}


def public(name: str, only: str = "", left_out: str = "") -> dict[str, Any]:
    """Return the public objects of a module by name."""
    module = importlib.import_module(name)
    chosen = only.replace(",", " ").split() or getattr(module, "__all__", ())
    without = left_out.replace(",", " ").split()
    return {n: getattr(module, n) for n in chosen if n not in without and not n.startswith("__")}


def has_page(value: Any, pages: bool = False) -> bool:
    """Return True if the object is documented on a separate page; `pages` includes functions."""
    if inspect.isclass(value):
        return not issubclass(value, BaseException)
    return pages and inspect.isroutine(value)


class Api(Made):
    """Public names of a module: a table, documented functions, and links to the pages of classes."""

    required_arguments = 1
    option_spec = {
        "not": directives.unchanged,
        "only": directives.unchanged,
        "pages": directives.flag,
    }

    def make(self) -> str:
        name, pages = self.arguments[0], "pages" in self.options
        objects = public(name, self.options.get("only", ""), self.options.get("not", ""))
        # Only a complete module is registered as a link target.
        directive = "currentmodule" if "only" in self.options else "module"
        lines = ["```{eval-rst}", f".. {directive}:: {name}", "", ".. autosummary::", ""]
        lines += [f"   {n}" for n in objects]
        separate = [n for n, value in objects.items() if has_page(value, pages)]
        if separate:
            lines += ["", ".. toctree::", "   :hidden:", ""]
        lines += [f"   /{FOLDER}/{name}.{n}" for n in separate]
        for n, value in objects.items():
            if n in separate:
                continue
            if inspect.isclass(value):
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


def object_page(module: str, name: str, value: Any) -> str:
    """Return the reference page of a class or function as reStructuredText."""
    lines = [name, "=" * len(name), ""]
    if not inspect.isclass(value):
        # The search ranks an exact main entry of the index above objects, titles and text.
        lines += [f".. index:: ! ct.{name}, ! {module}.{name}, ! {name}", ""]
        lines += [f".. currentmodule:: {module}", "", f".. autofunction:: {name}", ""]
        return "\n".join(lines)
    lines += [f".. currentmodule:: {module}", "", f".. autoclass:: {name}"]
    if value.__bases__ != (object,):
        lines.append("   :show-inheritance:")
    return "\n".join([*lines, "   :members:", ""])


def _listed(pages: list[str]) -> Iterator[tuple[str, str, Any, bool]]:
    """Yield module, name, object, and whether it has a separate page, of the objects on the pages."""
    pattern = r"^```\{crosstrack-api\} (\S+)\n((?::.*\n)*)```$"
    for page in pages:
        for name, options in re.findall(pattern, page, re.M):
            given = dict(re.findall(r"^:(\w+):(?: (.*))?$", options, re.M))
            for n, value in public(name, given.get("only", ""), given.get("not", "")).items():
                yield name, n, value, has_page(value, "pages" in given)


def unique_classes(listed: Iterable[tuple[str, str, Any]]) -> dict[str, str]:
    """Return the paths of classes with a unique name, which docstrings use in Parameters, Returns and Raises."""
    classes = [(module, n) for module, n, value in listed if inspect.isclass(value)]
    count = Counter(n for _, n in classes)
    return {n: f"{module}.{n}" for module, n in classes if count[n] == 1}


def _write(app: Sphinx) -> None:
    """Write changed pages and remove obsolete ones."""
    from crosstrack.models.problems import PROBLEMS

    problems = {f"{problem}.md": problem_page(problem) for problem in PROBLEMS}
    source = Path(app.srcdir)
    by_hand = [path.read_text("utf-8") for path in sorted((source / "api").glob("*.md"))]
    listed = list(_listed([*by_hand, *problems.values()]))
    objects = {
        f"{module}.{n}.rst": object_page(module, n, value)
        for module, n, value, separate in listed
        if separate
    }
    pages = {**problems, **objects}
    app.config.numpydoc_xref_aliases_complete = unique_classes(entry[:3] for entry in listed)
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


def homes(documented: Iterable[str]) -> dict[tuple[str, str], str]:
    """Return the documented path of each class and function by its defining module and name."""
    return {known: name for name in documented if (known := _same(name))}


def home_of(
    target: str,
    scope: Iterable[str | None],
    named: Mapping[str, str],
    known: Mapping[tuple[str, str], str],
) -> tuple[str, str] | None:
    """Return the documented object that a role means, and the name of its member or ``""``.

    Parameters
    ----------
    target : str
        Target of the role, such as ``"crosstrack.models.MinimumSnap"``, ``"Backend.run"`` or ``"accepts"``.
    scope : iterable of str or None
        Module and class of the docstring.
    named : mapping
        Paths of classes with unique names by name.
    known : mapping
        Result of :func:`homes`.
    """
    first, dot, rest = target.partition(".")
    module, owner = scope
    places = (module, f"{module}.{owner}", "crosstrack")
    for path in (f"{named.get(first, first)}{dot}{rest}", *(f"{at}.{target}" for at in places)):
        if (home := known.get(_same(path) or ("", ""))) is not None:
            return home, ""
        above, _, member = path.rpartition(".")
        if (home := known.get(_same(above) or ("", ""))) is not None:
            value = pkgutil.resolve_name(home)
            if hasattr(value, member) or member in getattr(value, "__annotations__", ()):
                return home, member
    return None


@cache
def _known(domain: PythonDomain) -> dict[tuple[str, str], str]:
    return homes(name for name, entry in domain.objects.items() if not entry.aliased)


def _elsewhere(app: Sphinx, env: BuildEnvironment, node: Any, text: nodes.Node) -> Any:
    """Resolve a role to the documented path of the same object, or to the class of a field."""
    if node.get("refdomain") != "py":
        return None
    domain = env.domains.python_domain
    scope = (node.get("py:module"), node.get("py:class"))
    named = app.config.numpydoc_xref_aliases_complete
    found = home_of(node.get("reftarget", ""), scope, named, _known(domain))
    if found is None:
        return None
    home, member = found
    path = f"{home}.{member}" if f"{home}.{member}" in domain.objects else home
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", path, node, text)


def _bases(app: Sphinx, name: str, value: Any, options: Any, bases: list[Any]) -> None:
    """Show the documented bases of a class only, without their type parameters."""
    plain = [get_origin(base) or base for base in bases]
    outside = [
        base
        for base in plain
        if not base.__module__.startswith("crosstrack.") and base is not Generic
    ]
    listed = [base for base in plain if base.__name__ in app.config.numpydoc_xref_aliases_complete]
    bases[:] = [base for base in plain if base in outside or base in listed] or [object]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives and the event handlers that write pages and resolve links."""
    app.add_directive("crosstrack-api", Api)
    app.add_directive("crosstrack-problem-api", ProblemApi)
    app.connect("builder-inited", _write)
    app.connect("missing-reference", _elsewhere)
    app.connect("autodoc-process-bases", _bases)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
