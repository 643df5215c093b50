"""Pictures of models and their plans, drawn with matplotlib."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ...errors import BackendMissing, UnknownName, UnsupportedOption, suggestion
from ..conversion import as_model
from ..problems import resolve, table
from ..verification import TOLERANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["picture_options", "plot", "register_plot", "require_matplotlib"]

#: Functions (model, plan, **options) -> Figure registered by the user, by model kind.
_REGISTERED: dict[str, Any] = {}


def register_plot(kind: str, function: Callable[..., Figure]) -> Callable[..., Figure]:
    """Register ``function(model, plan, **options)`` as the picture of models of `kind`.

    Parameters
    ----------
    kind : str
        Kind of the model.
    function : callable
        Function that returns a matplotlib figure; its parameters after the second are the options.

    Returns
    -------
    callable
        `function`.
    """
    _REGISTERED[kind] = function
    return function


def plot(model: Any, plan: Any = None, **options: Any) -> Figure:
    """Draw `model`, and `plan` if one is given.

    Parameters
    ----------
    model : Model
        Model to draw. A :class:`~crosstrack.Front`, or a mapping of names to several, is drawn as
        such.
    plan : plan, Solution or JSON data, optional
        Plan of the model, valid or not; None draws the data only. A solution is checked with the
        tolerance of its run, if the picture has such an option.
    **options
        Options of the model's picture, which the problem's page lists.

    Returns
    -------
    matplotlib.figure.Figure
        Figure without a window or pyplot state: ``plot(…).savefig("route.png")``.

    Raises
    ------
    UnknownName
        This kind of model has no picture.
    UnsupportedOption
        The picture does not accept an option.
    BackendMissing
        Matplotlib is not installed.
    """
    fronts = list(model.values()) if isinstance(model, Mapping) else [model]
    if fronts and all(hasattr(item, "second") and hasattr(item, "points") for item in fronts):
        require_matplotlib()
        if plan is not None:
            raise UnsupportedOption("a front is drawn with all of its plans: plan must be None")
        from .front import draw_front

        _reject_unknown("front", draw_front, options, drawn=1)
        return draw_front(model, **options)
    model = as_model(model)
    draw = _picture(model.kind)
    _reject_unknown(model.kind, draw, options)
    settings = getattr(plan, "options", None)
    if isinstance(settings, Mapping) and "tolerance" in picture_options(model.kind):
        # A solution was verified with the tolerance of its run.
        options.setdefault("tolerance", settings.get("tolerance", TOLERANCE))
    return draw(model, None if plan is None else model.as_plan(plan), **options)


def picture_options(kind: str) -> tuple[str, ...]:
    """Return the names of the options of the picture for models of `kind`.

    Parameters
    ----------
    kind : str
        Kind of the model.

    Returns
    -------
    tuple of str
        Names of the options.

    Raises
    ------
    UnknownName
        This kind of model has no picture.
    BackendMissing
        Matplotlib is not installed.
    """
    return tuple(inspect.signature(_picture(kind)).parameters)[2:]


def require_matplotlib() -> None:
    """Raise :class:`BackendMissing` with an installation hint if matplotlib is not installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ModuleNotFoundError as error:
        raise BackendMissing(
            f"pictures need matplotlib, which is not installed ({error}): "
            "pip install 'crosstrack[plot]'"
        ) from error


def _picture(kind: str) -> Callable[..., Figure]:
    """Return the function that draws models of `kind`, or raise the errors of :func:`plot`."""
    pictures = {**table(__package__.rpartition(".")[0], "PICTURES"), **_REGISTERED}
    if kind not in pictures:
        raise UnknownName("picture of the model", kind, pictures)
    require_matplotlib()
    result: Callable[..., Figure] = resolve(pictures[kind])
    return result


def _reject_unknown(
    kind: str, draw: Callable[..., Any], options: dict[str, Any], drawn: int = 2
) -> None:
    """Raise if an option is not a parameter of the picture after the first `drawn` ones."""
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
