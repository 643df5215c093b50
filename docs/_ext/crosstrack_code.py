"""Directive for equations with links to the code that implements them.

* ``crosstrack-equation MODULE:OBJECT``: a displayed formula (the content) with a link to the source of the
  function, class, method or property below. ``:number:`` is the equation number in the paper. ``:check:`` marks
  an object that computes the violation of the equation instead of implementing it.

An unknown object is a build error. The extension generates source pages for the referenced modules only.
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

#: Reference type of the links, and metadata key of the modules referenced by a page. Sphinx merges and
#: purges metadata per page.
LINK_TYPE = "crosstrack-code"


def locate(target: str) -> tuple[str, Path, int]:
    """Return the module, the file and the line number of the object ``module:object``."""
    value = pkgutil.resolve_name(target)
    if isinstance(value, property):
        value = value.fget
    elif isinstance(value, cached_property):
        value = value.func
    value = inspect.unwrap(value)
    return value.__module__, Path(inspect.getfile(value)), inspect.getsourcelines(value)[1]


def source_link(env: BuildEnvironment, target: str) -> nodes.Node:
    """Return a link to the source of the object ``module:object``.

    Raises
    ------
    ImportError, AttributeError, TypeError, ValueError, OSError
        The object does not exist or its source is not available.
    """
    module, file, line = locate(target)
    env.note_dependency(str(file))
    env.metadata[env.docname].setdefault(LINK_TYPE, set()).add(module)
    name = target.removeprefix("crosstrack.")
    link = addnodes.pending_xref("", nodes.literal(name, name), reftype=LINK_TYPE, refdomain="")
    link.attributes.update(reftarget=target, refdoc=env.docname, module=module, line=line)
    return link


class Equation(SphinxDirective):
    """Displayed formula with a link to the implementing object."""

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
        verb = "checked in " if "check" in self.options else "implemented in "
        caption = f"Equation {number}, {verb}" if number else verb.capitalize()
        below = nodes.paragraph("", caption, link, classes=["written-by"])
        return [nodes.container("", formula, below, classes=["crosstrack-equation"])]


def _page(module: str) -> str:
    return f"_modules/{module.replace('.', '/')}"


def _linked(app: Sphinx, env: BuildEnvironment, node: Any, text: nodes.Node) -> nodes.Node | None:
    """Return the link to a line of a source page."""
    if node["reftype"] != LINK_TYPE or app.builder.format != "html":
        return None
    line = f"line-{node['line']}"
    return make_refnode(app.builder, node["refdoc"], _page(node["module"]), line, text)


def _sources(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield a page with the source of every referenced module."""
    for module in sorted(
        set().union(*(page.get(LINK_TYPE, ()) for page in app.env.metadata.values()))
    ):
        source = inspect.getsource(importlib.import_module(module))
        code = app.builder.highlighter.highlight_block(source, "python", lineanchors="line")  # type: ignore[attr-defined]
        yield _page(module), {"title": module, "body": f"<h1>{module}</h1>{code}"}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive and the event handlers for its links."""
    app.add_directive("crosstrack-equation", Equation)
    app.connect("missing-reference", _linked)
    app.connect("html-collect-pages", _sources)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
