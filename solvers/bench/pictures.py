"""Small picture of the best plan of an instance, if the instance is available."""

from __future__ import annotations

import base64
import io
import logging
from collections.abc import Callable, Sequence
from typing import Any

from ...errors import UnknownName
from ...models.model import Model
from ...models.plots import picture_options, plot
from ...models.verification import TOLERANCE
from ..contract.solution import Solution
from ..contract.verdict import Verdict
from ..run.recording import LEFT_OUT

__all__ = ["Load", "draw_plan", "draw_plans"]

log = logging.getLogger("crosstrack")

#: Function that returns an instance by its name, such as :func:`crosstrack.load`.
Load = Callable[[str], Model[Any]]

#: Width of a picture (pixels) with few pictures, with many, and the largest number that is few.
_WIDE, _SMALL, _FEW = 900, 600, 40
#: WebP quality, from 0 to 100: lines stay legible at about 10 kB per picture.
_QUALITY = 25


def draw_plans(
    verdicts: Sequence[Verdict], load: Load | None, most: int
) -> dict[int, tuple[str, str]]:
    """Draw the best plans of the first instances that can be drawn.

    Parameters
    ----------
    verdicts : sequence of Verdict
        One per instance.
    load : callable, optional
        As in :func:`draw_plan`.
    most : int
        Largest number of pictures.

    Returns
    -------
    dict of int to (str, str)
        Data URI and caption as in :func:`draw_plan`, by the ``id`` of the verdict.
    """
    drawn: dict[int, tuple[str, str]] = {}
    left = most
    for verdict in verdicts:
        if left > 0 or load is None:
            drawn[id(verdict)] = draw_plan(verdict.best, load, len(verdicts))
            left -= bool(drawn[id(verdict)][0])
        else:
            drawn[id(verdict)] = "", f"No picture: the page has at most {most}; --pictures sets it."
    return drawn


def draw_plan(best: Solution[Any] | None, load: Load | None, instances: int = 1) -> tuple[str, str]:
    """Draw the best plan of an instance.

    Parameters
    ----------
    best : Solution, optional
        Best answer on the instance; None if no answer has a plan.
    load : callable, optional
        Function that returns the instance by its name. A model with another digest is not drawn.
    instances : int
        Number of pictures on the page; with many, each is smaller.

    Returns
    -------
    uri : str
        Data URI of the picture; empty if it cannot be drawn.
    text : str
        Caption, or the reason for the missing picture.
    """
    if best is None:
        return "", "No picture: no backend found a plan that passed the check."
    if best.stored_plan == LEFT_OUT:
        return "", "No picture: the record omits the plan."
    if load is None:
        return "", "No picture: the page was made without loading instances."
    try:
        model = load(best.instance)
    except Exception as error:  # names and loaders may come from other packages
        return "", f"No picture: the instance cannot be loaded by its name: {error}"
    if model.digest != best.digest:
        return "", (
            f"No picture: the instance of this name has other data today (digest {model.digest[:12]}, "
            f"in the record {best.digest[:12]})."
        )
    tolerance = best.options.get("tolerance") or TOLERANCE
    try:
        known = "tolerance" in picture_options(model.kind)
        figure = plot(model, best.plan_data, **({"tolerance": tolerance} if known else {}))
        out = io.BytesIO()
        wide = _WIDE if instances <= _FEW else _SMALL
        dpi = wide / figure.get_size_inches()[0]
        figure.savefig(out, format="webp", dpi=dpi, pil_kwargs={"quality": _QUALITY})
    except UnknownName:
        return "", f"No picture: models of kind {model.kind!r} have none."
    except Exception as error:  # an error of a picture must not stop the page
        log.warning("picture of %r: %s", best.instance, error)
        return "", f"No picture: {error}"
    return (
        "data:image/webp;base64," + base64.b64encode(out.getvalue()).decode("ascii"),
        f"The best plan of {best.instance}, by {best.backend}",
    )
