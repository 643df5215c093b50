"""Sphinx directives that generate tables and outputs from crosstrack at build time.

All directives are for MyST pages:

* ``crosstrack-backends``: the tables of :func:`crosstrack.backends`;
* ``crosstrack-options``: the options of each backend;
* ``crosstrack-help [commands]``: the output of ``--help`` of the command line, or of every subcommand;
* ``crosstrack-formulations KIND``: the formulations of a model, with the size of an instance;
* ``crosstrack-instances PROBLEM``: the catalogue's instances of a problem;
* ``crosstrack-formats``: the formats of files that can become models;
* ``crosstrack-run COMMAND``: a command line and its output. All commands of a page share a folder.
"""

from __future__ import annotations

import html
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
    """Base of directives with generated Markdown content."""

    has_content = False
    wide = False

    def run(self) -> list[nodes.Node]:
        text = self.make()
        if self.wide:
            # A container around the whole text would lose the content below headings.
            text = re.sub(r"(?:^\|.*\n?)+", r":::{container} wide\n\g<0>\n:::\n", text, flags=re.M)
        return self.parse_text_to_nodes(text, allow_section_headings=True)

    def make(self) -> str:
        raise NotImplementedError


def executes(app: Sphinx) -> bool:
    """Return True if this build runs the examples (``plot_gallery`` is enabled)."""
    return str(app.config.plot_gallery) not in ("0", "False")


class Backends(Made):
    """Tables of the installed backends, one per accepted type."""

    wide = True

    def make(self) -> str:
        import crosstrack
        from crosstrack.solvers import find_backend

        tables: dict[str, list[Sequence[str]]] = {}
        for state in crosstrack.backends():
            backend = find_backend(state.name, problem=state.problem)
            extra = f"`{backend.extra}`" if backend.extra else "always installed"
            rows = tables.setdefault(state.accepts, [])
            rows.append(
                (
                    f"`{state.name}`",
                    state.summary,
                    state.guarantee,
                    ", ".join(state.features),
                    state.version or "",
                    extra,
                )
            )
        columns = ("backend", "", "proves", "features", "version", "extra")
        return "\n\n".join(
            f"Backends that accept `{accepts}`:\n\n{markdown_table(columns, rows)}"
            for accepts, rows in tables.items()
        )


class Options(Made):
    """Tables of the options of each backend."""

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
    """Help text of the command line, or of every subcommand with the argument ``commands``."""

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
        process = subprocess.run(
            command, capture_output=True, text=True, check=True, env=environment
        )
        return f"```text\n{process.stdout.rstrip()}\n```"


class Formulations(Made):
    """Table of the formulations of a model, with the program size for one instance."""

    required_arguments = 1

    def make(self) -> str:
        import crosstrack
        from crosstrack.errors import UnsupportedFormulation

        model = crosstrack.load(self.arguments[0])
        rows = []
        for name in model.formulations:
            try:
                written = model.formulate(name)
            except UnsupportedFormulation:  # for other features than those of this instance
                continue
            program = written.program
            rows.append((f"`{name}`", written.summary, program.row_count, program.size))
        columns = ("formulation", "", f"rows for `{model.name}`", "columns")
        return markdown_table(columns, rows)


class Instances(Made):
    """Table of the catalogue's instances of a problem."""

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


class Formats(Made):
    """Table of the formats of files, and table of those that are refused with advice."""

    wide = True

    def make(self) -> str:
        from crosstrack.instances import file_formats

        rows, refused = [], []
        for form in file_formats():
            head = (f"`{form.name}`", form.title, ", ".join(f"`{item}`" for item in form.suffixes))
            if not form.targets:
                refused.append((*head, form.remedy.replace("{file}", "FILE")))
            for kind, target in form.targets.items():
                needs, may = (", ".join(f"`{key}`" for key in part) for part in target[1:])
                rows.append((*head, f"`{kind}`" if kind else "", needs, may))
                head = ("", "", "")
        heads = (
            "format",
            "file",
            "suffixes",
            "model",
            "data that it needs",
            "data that it may need",
        )
        reasons = ("format", "file", "suffixes", "what to do")
        return f"{markdown_table(heads, rows)}\n\n## Files that are refused\n\n" + markdown_table(
            reasons, refused
        )


class Run(Made):
    """A command line and its output, run in a folder that all commands of the page share."""

    required_arguments = 1
    final_argument_whitespace = True
    #: Maximum number of lines shown. The middle of a longer output is omitted.
    limit = 60

    def make(self) -> str:
        line = self.arguments[0]
        if not executes(self.env.app):
            return f"```console\n$ crosstrack {line}\n```"
        folders = self.env.temp_data.setdefault("crosstrack-run", tempfile.TemporaryDirectory())
        environment = {**os.environ, "COLUMNS": "88", "NO_COLOR": "1"}
        # The output depends on the code, not only on the page.
        self.env.note_reread()
        process = subprocess.run(
            [sys.executable, "-P", "-m", "crosstrack", *shlex.split(line)],
            cwd=folders.name, capture_output=True, text=True, env=environment, timeout=300,
        )  # fmt: skip
        # Standard error explains a failure, and the output includes a non-zero exit code.
        lines = [text.rstrip() for text in process.stdout.rstrip().split("\n")]
        if len(lines) > self.limit:
            half = self.limit // 2
            lines = [*lines[:half], "…", *lines[-half:]]
        output = "\n".join(lines)
        if process.returncode in (1, 2) or "Traceback" in process.stderr:
            raise self.error(f"crosstrack {line}: exit code {process.returncode}\n{process.stderr}")
        code = f"\n$ echo $?\n{process.returncode}" if process.returncode else ""
        return f"```text\n$ crosstrack {line}\n{output}{code}\n```"


class _Pictures:
    """Image scraper that saves the figures of a block of an example.

    :func:`crosstrack.plot` returns a figure that is not registered in pyplot's global state.
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


#: Accented letter with an index, which docutils would typeset below the letter.
_ACCENTED = re.compile(
    r"(\\(?:bar|d?dot|hat|tilde|vec)(?![a-zA-Z]) *(?:\{[^{}]*\}|\\[a-zA-Z]+|\w))(?= *[_^])"
)


def _formula(self: Any, node: nodes.math | nodes.math_block) -> None:
    """Write a formula as MathML, which browsers render without scripts or network access."""
    from docutils.utils.math import MathError
    from docutils.utils.math.latex2mathml import tex2mathml

    block = isinstance(node, nodes.math_block)
    latex = node.astext().strip()
    try:
        markup = tex2mathml(_ACCENTED.sub(r"{\1{}}", latex), as_block=block)
    except MathError as error:
        logger.warning("formula %r: %s", latex, error, location=node)
        markup = html.escape(latex)
    # TeX inserts a thin space between a function name and its argument, and after operators such as max.
    space = 'rspace="0.1667em"'
    markup = re.sub(r"<mo(?=>&ApplyFunction;</mo>(?!\s*<mo[^>]*>\())", f"<mo {space}", markup)
    # Bars are delimiters, not relations.
    markup = re.sub(r"<mo(?=[^>]*>[|‖]<)", '<mo lspace="0" rspace="0"', markup)
    markup = re.sub(r"<mo(?=[^>]*>[a-z]{2,}<)", f'<mo lspace="0" {space}', markup)
    self.body.append(f'<div class="formula">{markup}</div>' if block else markup)
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
    app.add_directive("crosstrack-formulations", Formulations)
    app.add_directive("crosstrack-instances", Instances)
    app.add_directive("crosstrack-formats", Formats)
    app.add_directive("crosstrack-run", Run)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
