"""The table of extras, made from ``pyproject.toml`` and from the backends that name an extra.

* ``crosstrack-extras``: for each extra its packages, and the backends or the uses that it brings.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from crosstrack_site import Made, markdown_table
from sphinx.application import Sphinx

#: Extras for work on crosstrack itself.
OWN = {"test", "docs", "benchmark"}
#: What extras bring beside backends, or what to know of their backends.
WORDS = {
    "gpu": "swarms on a graphics card",
    "learn": "training, and policies that learn",
    "ecos": "under the GNU GPL, unlike all others",
    "gurobi": "without a licence, small programs only",
    "plot": "pictures: `ct.plot`, `--plot`",
    "xlsx": "tables in Excel files",
    "pandas": "answers as data frames: `to_frame`",
    "cluster": "campaigns on other machines: `--cluster`",
}


class Extras(Made):
    """The extras that people install: their packages, and what each brings."""

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
            held = joined.split(",") if joined else packages
            named = ", ".join(f"`{one}`" for one in held)
            brings = [", ".join(backends.get(extra, [])), WORDS.get(extra, "")]
            rows.append(
                (
                    f"`{extra}`",
                    f"the extras {named}" if joined else named,
                    "; ".join(filter(None, brings)),
                )
            )
        return markdown_table(("extra", "packages", "brings"), rows)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("crosstrack-extras", Extras)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
