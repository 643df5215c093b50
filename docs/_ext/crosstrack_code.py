"""Equations that name the code that writes them.

* ``crosstrack-equation MODULE:OBJECT``: a displayed formula, the content, and below it a link to the source
  of that function, class, method or property; ``:number:`` is the equation's number in the paper, and
  ``:check:`` says that the object does not write it but measures how far a plan breaks it.

An object that does not exist is an error of the build. The pages of source are made here, of those modules only
that an equation names.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import make_refnode

#: Where the modules that a page names are noted, in its metadata, which Sphinx merges and forgets by page.
NOTED = "crosstrack-code"


def located(target: str) -> tuple[str, Path, int]:
    """Return the module, the file and the line of what ``module:object`` names."""
    value = pkgutil.resolve_name(target)
    if isinstance(value, property):
        value = value.fget
    elif isinstance(value, cached_property):
        value = value.func
    value = inspect.unwrap(value)
    return value.__module__, Path(inspect.getfile(value)), inspect.getsourcelines(value)[1]


def source_link(env: BuildEnvironment, target: str) -> nodes.Node:
    """Return a link to the source of the object that ``module:object`` names.

    Raises
    ------
    ImportError, AttributeError, TypeError, ValueError, OSError
        The object does not exist or has no source.
    """
    module, file, line = located(target)
    env.note_dependency(str(file))
    env.metadata[env.docname].setdefault(NOTED, set()).add(module)
    name = target.removeprefix("crosstrack.")
    link = addnodes.pending_xref("", nodes.literal(name, name), reftype=NOTED, refdomain="")
    link.attributes.update(reftarget=target, refdoc=env.docname, module=module, line=line)
    return link


class Equation(SphinxDirective):
    """A displayed formula and the object that writes it."""

    required_arguments = 1
    has_content = True
    option_spec = {"number": directives.unchanged_required, "check": directives.flag}

    def run(self) -> list[nodes.Node]:
        self.assert_has_content()
        target = self.arguments[0]
        try:
            link = source_link(self.env, target)
        except (ImportError, AttributeError, TypeError, ValueError, OSError) as error:
            raise self.error(f"{self.env.docname}: no source of {target!r}: {error}") from error
        latex = "\n".join(self.content)
        formula = nodes.math_block(latex, latex, docname=self.env.docname, number=None, label=None)
        number = self.options.get("number")
        verb = "checked by " if "check" in self.options else "written by "
        said = f"Equation {number}, {verb}" if number else verb.capitalize()
        below = nodes.paragraph("", said, link, classes=["written-by"])
        return [nodes.container("", formula, below, classes=["crosstrack-equation"])]


def _page(module: str) -> str:
    return f"_modules/{module.replace('.', '/')}"


def _linked(app: Sphinx, env: BuildEnvironment, node: Any, text: nodes.Node) -> nodes.Node | None:
    """Return the link to a line of a page of source."""
    if node["reftype"] != NOTED or app.builder.format != "html":
        return None
    line = f"line-{node['line']}"
    return make_refnode(app.builder, node["refdoc"], _page(node["module"]), line, text)


def _sources(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield a page with the source of every module that an equation names."""
    for module in sorted(set().union(*(one.get(NOTED, ()) for one in app.env.metadata.values()))):
        source = inspect.getsource(importlib.import_module(module))
        code = app.builder.highlighter.highlight_block(source, "python", lineanchors="line")  # type: ignore[attr-defined]
        yield _page(module), {"title": module, "body": f"<h1>{module}</h1>{code}"}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive and what makes its links."""
    app.add_directive("crosstrack-equation", Equation)
    app.connect("missing-reference", _linked)
    app.connect("html-collect-pages", _sources)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
