"""What the site makes at build time from crosstrack itself, so that nobody types it.

Directives, all for MyST pages:

* ``crosstrack-backends``: the tables of :func:`crosstrack.backends`;
* ``crosstrack-options``: the backends' own options;
* ``crosstrack-help [commands]``: the real ``--help`` of the command line, or of every subcommand;
* ``crosstrack-problems``: the problems, each a link to its page;
* ``crosstrack-formulations KIND``: the formulations of a model, with the size of an instance;
* ``crosstrack-instances PROBLEM``: the catalogue's instances of a problem;
* ``crosstrack-run COMMAND``: a command line, and what it prints; files are shared by a page.
"""

from __future__ import annotations

import html
import importlib
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

logger = logging.getLogger(__name__)


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table in Markdown."""

    def line(cells: Iterable[Any]) -> str:
        return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(columns), line("---" for _ in columns), *map(line, rows)])


class Made(SphinxDirective):
    """A directive whose content is Markdown that a function makes."""

    has_content = False
    wide = False

    def run(self) -> list[nodes.Node]:
        text = self.make()
        if self.wide:
            # A container about all of it would lose what stands below headings.
            text = re.sub(r"(?:^\|.*\n?)+", r":::{container} wide\n\g<0>\n:::\n", text, flags=re.M)
        return self.parse_text_to_nodes(text, allow_section_headings=True)

    def make(self) -> str:
        raise NotImplementedError


def executes(app: Sphinx) -> bool:
    """Return whether this build runs examples; the quick one does not."""
    return str(app.config.plot_gallery) not in ("0", "False")


class Backends(Made):
    """The backends of this installation, a table for each kind of thing that they accept."""

    wide = True

    def make(self) -> str:
        import crosstrack
        from crosstrack.solvers import find_backend

        tables: dict[str, list[Sequence[str]]] = {}
        for state in crosstrack.backends():
            backend = find_backend(state.name, problem=state.problem)
            comes = f"`{backend.extra}`" if backend.extra else "always there"
            rows = tables.setdefault(state.accepts, [])
            rows.append(
                (
                    f"`{state.name}`",
                    state.summary,
                    state.guarantee,
                    ", ".join(state.features),
                    state.version or "",
                    comes,
                )
            )
        columns = ("backend", "", "proves", "understands", "version", "extra")
        return "\n\n".join(
            f"Backends that accept `{accepts}`:\n\n{markdown_table(columns, rows)}"
            for accepts, rows in tables.items()
        )


class Options(Made):
    """The options that are a backend's own."""

    def make(self) -> str:
        import crosstrack
        from crosstrack.solvers import find_backend

        parts = []
        for state in crosstrack.backends():
            backend = find_backend(state.name, problem=state.problem)
            rows = [
                (f"`{name}`", f"`{option.default!r}`", option.help)
                for name, option in backend.options.items()
            ]
            if rows:
                parts += [
                    f"`{backend.name}`\n",
                    markdown_table(("option", "default", ""), rows),
                    "",
                ]
        return "\n".join(parts)


class Help(Made):
    """The command line's own help; with the argument ``commands``, that of every subcommand."""

    optional_arguments = 1

    def make(self) -> str:
        from crosstrack.__main__ import cli

        if not self.arguments:
            return self.block([])
        parts: list[str] = []
        for name in cli.commands:
            parts += [f"## `crosstrack {name}`", self.block([name])]
        return "\n\n".join(parts)

    @staticmethod
    def block(arguments: list[str]) -> str:
        environment = {**os.environ, "COLUMNS": "88", "NO_COLOR": "1"}
        command = [sys.executable, "-P", "-m", "crosstrack", *arguments, "--help"]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        return f"```text\n{done.stdout.rstrip()}\n```"


class Problems(Made):
    """The problems with the first line of what they are, each a link to its page."""

    def make(self) -> str:
        from crosstrack.models.problems import PROBLEMS

        lines = []
        for problem in PROBLEMS:
            said = (importlib.import_module(f"crosstrack.models.{problem}").__doc__ or "").strip()
            page = problem.replace("_", "-")
            lines.append(f"[{page}](problems/{page}.md)\n: {said.splitlines()[0]}\n")
        return "\n".join(lines)


class Formulations(Made):
    """The formulations of a model, with the size of the program of one instance."""

    required_arguments = 1

    def make(self) -> str:
        import crosstrack

        model = crosstrack.load(self.arguments[0])
        rows = []
        for name in model.formulations:
            written = model.formulate(name)
            program = written.program
            rows.append((f"`{name}`", written.summary, program.row_count, program.size))
        columns = ("formulation", "", f"rows for `{model.name}`", "columns")
        return markdown_table(columns, rows)


class Instances(Made):
    """The catalogue's instances of a problem."""

    required_arguments = 1
    wide = True

    def make(self) -> str:
        from crosstrack.instances import entries

        problem = self.arguments[0]
        rows = [
            (f"`{entry.name}`", f"{entry.title}. *{entry.note}*", entry.provenance)
            for entry in entries()
            if entry.name.startswith(f"{problem}/")
        ]
        if not rows:
            raise self.error(f"the catalogue has no instance of {problem!r}")
        return markdown_table(("instance", "", "data"), rows)


class Run(Made):
    """A command line and what it printed, run in a folder that the whole page shares."""

    required_arguments = 1
    final_argument_whitespace = True
    #: Lines shown at most; what is longer loses its middle.
    most = 60

    def make(self) -> str:
        line = self.arguments[0]
        if not executes(self.env.app):
            return f"```console\n$ crosstrack {line}\n```"
        folders = self.env.temp_data.setdefault("crosstrack-run", tempfile.TemporaryDirectory())
        environment = {**os.environ, "COLUMNS": "88", "NO_COLOR": "1"}
        # What is printed depends on the code, not on the page.
        self.env.note_reread()
        done = subprocess.run(
            [sys.executable, "-P", "-m", "crosstrack", *shlex.split(line)],
            cwd=folders.name, capture_output=True, text=True, env=environment, timeout=300,
        )  # fmt: skip
        # What stands on standard error is why it failed; the exit code of a failure is part of it.
        lines = [text.rstrip() for text in done.stdout.rstrip().split("\n")]
        if len(lines) > self.most:
            half = self.most // 2
            lines = [*lines[:half], "…", *lines[-half:]]
        printed = "\n".join(lines)
        if done.returncode in (1, 2) or "Traceback" in done.stderr:
            raise self.error(f"crosstrack {line}: exit code {done.returncode}\n{done.stderr}")
        code = f"\n$ echo $?\n{done.returncode}" if done.returncode else ""
        return f"```text\n$ crosstrack {line}\n{printed}{code}\n```"


class _Pictures:
    """Saves the figures that a block of an example has made.

    :func:`crosstrack.plot` returns a figure of its own, which no global state knows.
    """

    def __repr__(self) -> str:
        return "crosstrack_site"

    def __call__(self, block: Any, block_vars: Any, gallery_conf: Any) -> str:
        from matplotlib.figure import Figure
        from sphinx_gallery.scrapers import figure_rst

        saved = []
        for value in block_vars["example_globals"].values():
            if isinstance(value, Figure) and not hasattr(value, "crosstrack_saved"):
                path = next(block_vars["image_path_iterator"])
                value.savefig(path, dpi=110)
                value.crosstrack_saved = True  # type: ignore[attr-defined]
                saved.append(path)
        return figure_rst(saved, gallery_conf["src_dir"])


_pictures = _Pictures()


#: An accented letter with an index, which docutils would write below the letter.
_ACCENTED = re.compile(
    r"(\\(?:bar|d?dot|hat|tilde|vec)(?![a-zA-Z]) *(?:\{[^{}]*\}|\\[a-zA-Z]+|\w))(?= *[_^])"
)


def _formula(self: Any, node: nodes.math | nodes.math_block) -> None:
    """Write a formula as MathML, which browsers draw without a script and a network."""
    from docutils.utils.math import MathError
    from docutils.utils.math.latex2mathml import tex2mathml

    block = isinstance(node, nodes.math_block)
    latex = node.astext().strip()
    try:
        made = tex2mathml(_ACCENTED.sub(r"{\1{}}", latex), as_block=block)
    except MathError as error:
        logger.warning("formula %r: %s", latex, error, location=node)
        made = html.escape(latex)
    # TeX sets a thin space between the name of a function and its argument, and after operators such as max.
    space = 'rspace="0.1667em"'
    made = re.sub(r"<mo(?=>&ApplyFunction;</mo>(?!\s*<mo[^>]*>\())", f"<mo {space}", made)
    # Bars stand about what they enclose, and are no relation.
    made = re.sub(r"<mo(?=[^>]*>[|‖]<)", '<mo lspace="0" rspace="0"', made)
    made = re.sub(r"<mo(?=[^>]*>[a-z]{2,}<)", f'<mo lspace="0" {space}', made)
    self.body.append(f'<div class="formula">{made}</div>' if block else made)
    raise nodes.SkipNode


def _get_sg_image_scraper() -> _Pictures:
    return _pictures


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_html_math_renderer(
        "mathml", inline_renderers=(_formula, None), block_renderers=(_formula, None)
    )
    app.add_directive("crosstrack-backends", Backends)
    app.add_directive("crosstrack-options", Options)
    app.add_directive("crosstrack-help", Help)
    app.add_directive("crosstrack-problems", Problems)
    app.add_directive("crosstrack-formulations", Formulations)
    app.add_directive("crosstrack-instances", Instances)
    app.add_directive("crosstrack-run", Run)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
