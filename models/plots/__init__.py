"""Pictures of models and their plans; matplotlib is imported only when one is drawn."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ...errors import BackendMissing, UnknownName, UnsupportedOption, suggestion
from ..model import as_model
from ..problems import resolve, table
from ..verification import TOLERANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["picture_options", "plot", "register_plot", "require_matplotlib"]

#: Functions (model, plan, **options) -> Figure that users registered, by model kind.
_REGISTERED: dict[str, Any] = {}


def register_plot(kind: str, function: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw models of a user's `kind` with ``function(model, plan, **options)``."""
    _REGISTERED[kind] = function
    return function


def plot(model: Any, plan: Any = None, **options: Any) -> Figure:
    """Draw `model`, and `plan` where one is given.

    Parameters
    ----------
    model : Model
        The model. A :class:`~crosstrack.Front`, or several in a mapping by name, is drawn as such.
    plan : plan, Solution or JSON data, optional
        A plan for it, valid or not; None draws the data only. A solution is held to the tolerance
        that it was solved to, where the picture has one.
    **options
        Those of the model's picture, which the problem's page lists.

    Returns
    -------
    matplotlib.figure.Figure
        Tied to no window and no pyplot state: ``plot(…).savefig("route.png")``.

    Raises
    ------
    UnknownName
        There is no picture for this kind of model.
    UnsupportedOption
        The picture does not know an option.
    BackendMissing
        Matplotlib is not installed.
    """
    fronts = list(model.values()) if isinstance(model, Mapping) else [model]
    if fronts and all(hasattr(one, "second") and hasattr(one, "points") for one in fronts):
        require_matplotlib()
        if plan is not None:
            raise UnsupportedOption("a front is drawn with all of its plans: plan must be None")
        from .front import draw_front

        _refuse_unknown("front", draw_front, options, drawn=1)
        return draw_front(model, **options)
    model = as_model(model)
    draw = _picture(model.kind)
    _refuse_unknown(model.kind, draw, options)
    asked = getattr(plan, "options", None)
    if isinstance(asked, Mapping) and "tolerance" in picture_options(model.kind):
        # A solution is as valid as it was asked to be.
        options.setdefault("tolerance", asked.get("tolerance", TOLERANCE))
    return draw(model, None if plan is None else model.as_plan(plan), **options)


def picture_options(kind: str) -> tuple[str, ...]:
    """Return the names of the options that pictures of models of `kind` take.

    Raises
    ------
    UnknownName, BackendMissing
        As :func:`plot` does.
    """
    return tuple(inspect.signature(_picture(kind)).parameters)[2:]


def require_matplotlib() -> None:
    """Raise :class:`BackendMissing`, saying what to install, where matplotlib is not there."""
    try:
        import matplotlib.figure  # noqa: F401
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"pictures need matplotlib, which is not installed ({error}): "
            "pip install 'crosstrack[plot]'"
        ) from error


def _picture(kind: str) -> Callable[..., Figure]:
    """Return the function that draws models of `kind`, or raise what :func:`plot` raises."""
    pictures = {**table(__package__.rpartition(".")[0], "PICTURES"), **_REGISTERED}
    if kind not in pictures:
        raise UnknownName("picture of the model", kind, pictures)
    require_matplotlib()
    found: Callable[..., Figure] = resolve(pictures[kind])
    return found


def _refuse_unknown(
    kind: str, draw: Callable[..., Any], options: dict[str, Any], drawn: int = 2
) -> None:
    """Raise where an option is none of the picture's parameters after what is `drawn`."""
    parameters = list(inspect.signature(draw).parameters.values())[drawn:]
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return
    known = [parameter.name for parameter in parameters]
    for name in options:
        if name not in known:
            raise UnsupportedOption(
                f"the picture of {kind!r} has no option {name!r}; "
                f"{suggestion(name, known)}its options: {', '.join(known) or 'none'}"
            )
