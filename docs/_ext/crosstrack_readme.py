"""Write the table of the problems in README.md: ``python docs/_ext/crosstrack_readme.py``."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

README = Path(__file__).resolve().parents[2] / "README.md"
#: Table in README.md, from its head to the blank line after it.
TABLE = re.compile(r"(?<=\| problem \| task \|\n\|---\|---\|\n)(?:\|.*\n)*")


def rows() -> str:
    """Return a row for each problem: its page, and the first line of the docstring of its model folder."""
    from crosstrack.models.problems import PROBLEMS

    lines = []
    for problem in PROBLEMS:
        doc = importlib.import_module(f"crosstrack.models.{problem}").__doc__ or ""
        task = doc.strip().splitlines()[0].removesuffix(".")
        page = problem.replace("_", "-")
        lines.append(f"| [{page}](docs/problems/{page}.md) | {task[0].lower()}{task[1:]} |\n")
    return "".join(lines)


def written(text: str) -> str:
    """Return the text of README.md with the rows of all problems."""
    return TABLE.sub(lambda _: rows(), text)


if __name__ == "__main__":
    README.write_text(written(README.read_text("utf-8")), "utf-8")
