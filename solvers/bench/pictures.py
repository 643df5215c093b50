"""A small picture of the best plan of an instance, where the instance is at hand."""

from __future__ import annotations

import base64
import io
import logging
from collections.abc import Callable
from typing import Any

from ...models.model import Model
from ...models.plots import picture_options, plot
from ...models.verification import TOLERANCE
from ..campaign import LEFT_OUT
from ..solution import Solution

__all__ = ["Load", "draw_plan"]

log = logging.getLogger("crosstrack")

#: What finds an instance by its name, such as :func:`crosstrack.load`.
Load = Callable[[str], Model[Any]]

#: Width of a picture (pixels) where there are few, where there are many, and how many are few.
_WIDE, _SMALL, _FEW = 900, 600, 40
#: WebP's quality, from 0 to 100: lines stay legible, and a picture takes some 10 kB.
_QUALITY = 25


def draw_plan(best: Solution[Any] | None, load: Load | None, instances: int = 1) -> tuple[str, str]:
    """Return a data URI of the best plan's picture and what it shows, or "" and why there is none.

    Parameters
    ----------
    best : Solution, optional
        The best answer on the instance, None where none has a plan.
    load : callable, optional
        What finds the instance by its name; a model of another digest is not drawn on.
    instances : int
        How many pictures there are in all; many are smaller.
    """
    if best is None:
        return "", "No picture: no backend found a plan that passed the check."
    if best.stored_plan == LEFT_OUT:
        return "", "No picture: there was a plan, which the record leaves out."
    if load is None:
        return "", "No picture: the page was made without a way to load instances."
    try:
        model = load(best.instance)
    except Exception as error:  # the name is a stranger's, and so may be what loads it
        return "", f"No picture: the instance cannot be loaded by its name: {error}"
    if model.digest != best.digest:
        return "", (
            f"No picture: the instance of this name has other data today (digest {model.digest[:12]}, "
            f"in the record {best.digest[:12]})."
        )
    asked = best.options.get("tolerance") or TOLERANCE
    try:
        known = "tolerance" in picture_options(model.kind)
        figure = plot(model, best.plan_data, **({"tolerance": asked} if known else {}))
        out = io.BytesIO()
        wide = _WIDE if instances <= _FEW else _SMALL
        dpi = wide / figure.get_size_inches()[0]
        figure.savefig(out, format="webp", dpi=dpi, pil_kwargs={"quality": _QUALITY})
    except Exception as error:  # a picture, which may be a stranger's, must not stop the page
        log.warning("picture of %r: %s", best.instance, error)
        return "", f"No picture: {error}"
    return (
        "data:image/webp;base64," + base64.b64encode(out.getvalue()).decode("ascii"),
        f"The best plan of {best.instance}, by {best.backend}",
    )
