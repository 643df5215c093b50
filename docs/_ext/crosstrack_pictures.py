"""Pictures of catalogue entries with the best plan on record, and the gallery of the front page.

* ``crosstrack-gallery``: a picture for each problem, which links to the page of the problem.
"""

from __future__ import annotations

import importlib
import os
from functools import cache
from pathlib import Path
from typing import Any

from crosstrack_site import Made
from crosstrack_tables import best, records
from docutils import nodes
from sphinx.application import Sphinx

#: Folder of the pictures, relative to the source folder.
FOLDER = "generated/catalogue"
#: Files with answers: the campaign, and plans that its records omit (``tests/benchmarks/best_plans.py``).
RECORDS = ("campaign/records.jsonl", "campaign/plans.jsonl")
#: Maximum width and height of a picture, in pixels. The catalogue shows it at a seventh of this size.
SIZE = (896, 672)
#: Instances in the gallery of problems without a demonstration on the command line.
SHOWN = {"optimal-control": "optimal-control/cart-pole", "satellite-slew": "satellite-slew/paper"}
#: Backends that compute a plan for a picture within seconds, since the plans are too long for the records.
QUICK = {"satellite-slew/paper": "slew-pseudo-inverse"}


@cache
def model_of(name: str) -> Any:
    """Return the model of a catalogue entry."""
    from crosstrack.instances import entry

    return entry(name).build()


def answers_to(source: Path, model: Any) -> list[Any]:
    """Return the recorded answers to a model, without backends that read hidden data."""
    files = (records(source / file) for file in RECORDS)
    answers = (answer for file in files for answer in file.get(model.name, []))
    return [answer for answer in answers if answer.digest == model.digest]


def best_plan(source: Path, model: Any) -> Any:
    """Return the best verified answer with a recorded plan, or None."""
    known = answers_to(source, model)
    return best([answer for answer in known if isinstance(answer.stored_plan, dict)])


def picture(source: Path, model: Any) -> str:
    """Return the path of the picture of an instance, which is drawn if it does not exist."""
    import crosstrack

    answer, quick = best_plan(source, model), QUICK.get(model.name)
    key = quick or "" if answer is None else f"{answer.backend}-{answer.primal_bound:.6g}"
    file = source / FOLDER / f"{model.kind}-{model.digest[:12]}-{key}.webp"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        plan = None if answer is None else answer.stored_plan
        if answer is None and quick:
            plan = crosstrack.solve(model, quick, time_limit=10).plan
        figure = crosstrack.plot(model, plan)
        dpi = min(SIZE[0] / figure.get_figwidth(), SIZE[1] / figure.get_figheight())
        # Processes of a parallel build may draw the same picture.
        part = file.with_suffix(f".{os.getpid()}")
        figure.savefig(part, dpi=dpi, format="webp", pil_kwargs={"quality": 75})
        part.replace(file)
    return f"{FOLDER}/{file.name}"


class Gallery(Made):
    """Pictures of the problems' demonstrations, with links to the pages of the problems."""

    def make(self) -> str:
        from crosstrack.instances.demos import demos
        from crosstrack.models.problems import PROBLEMS

        shown = SHOWN | {name: demo.instance for name, demo in demos().items()}
        source = Path(self.env.app.srcdir)
        for file in RECORDS:
            self.env.note_dependency(str(source / file))
        parts = []
        for problem in PROBLEMS:
            doc = (importlib.import_module(f"crosstrack.models.{problem}").__doc__ or "").strip()
            page = problem.replace("_", "-")
            file = picture(source, model_of(shown[page]))
            task = doc.splitlines()[0]
            parts.append(f"[![{page}]({file}) **{page}**](problems/{page}.md)\n{task}")
        body = "\n\n".join(parts)
        return f"::::{{container}} gallery\n{body}\n::::"


def _lazy(app: Sphinx, tree: nodes.document) -> None:
    """Let the browser load pictures when they are visible, and set the size of the small ones."""
    from PIL import Image

    for node in tree.findall(nodes.image):
        if f"{FOLDER}/" in node["uri"]:
            node["loading"] = "lazy"
            if isinstance(node.parent.parent, nodes.entry):
                with Image.open(Path(app.srcdir) / node["uri"]) as image:
                    node["width"], node["height"] = (f"{size // 7}px" for size in image.size)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive and the event handler for the sizes of pictures."""
    app.add_directive("crosstrack-gallery", Gallery)
    app.connect("doctree-read", _lazy)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
