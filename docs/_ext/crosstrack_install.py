"""Table of extras, generated from ``pyproject.toml`` and the declarations of the backends.

* ``crosstrack-extras``: the packages of each extra, and the backends or functions that it enables.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from crosstrack_site import Made, markdown_table
from sphinx.application import Sphinx

#: Extras for development of crosstrack.
OWN = {"test", "docs", "benchmark", "release"}
#: Functions that an extra enables in addition to backends, or remarks on its backends.
WORDS = {
    "gpu": "particle swarms on a GPU",
    "learn": "training and learned policies",
    "ecos": "licensed under the GNU GPL, unlike all others",
    "gurobi": "small programs only without a licence",
    "plot": "plots: `ct.plot`, `--plot`",
    "xlsx": "tables in Excel files",
    "pandas": "answers as data frames: `to_frame`",
    "cluster": "campaigns on other machines: `--cluster`",
}


class Extras(Made):
    """Table of the extras for users with their packages and functions."""

    wide = True

    def make(self) -> str:
        import crosstrack
        from crosstrack.solvers import find_backend

        file = Path(self.env.app.srcdir).parent / "pyproject.toml"
        declared = tomllib.loads(file.read_text("utf-8"))["project"]["optional-dependencies"]
        backends: dict[str, list[str]] = {}
        for state in crosstrack.backends():
            extra = find_backend(state.name, problem=state.problem).extra
            names = backends.setdefault(extra, [])
            if f"`{state.name}`" not in names:
                names.append(f"`{state.name}`")
        rows = []
        for extra, packages in declared.items():
            if extra in OWN:
                continue
            (joined,) = re.findall(r"^crosstrack\[(.+)\]$", packages[0]) or ("",)
            members = joined.split(",") if joined else packages
            named = ", ".join(f"`{package}`" for package in members)
            uses = [", ".join(backends.get(extra, [])), WORDS.get(extra, "")]
            rows.append(
                (
                    f"`{extra}`",
                    f"the extras {named}" if joined else named,
                    "; ".join(filter(None, uses)),
                )
            )
        return markdown_table(("extra", "packages", "adds"), rows)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("crosstrack-extras", Extras)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
