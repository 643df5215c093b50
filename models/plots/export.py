"""Pictures and animations as plain data, for a page whose script draws them again.

The static pictures are the only description of a scene. :func:`export_figure` reads a complete figure, and
:func:`export_animation` one figure and the changes from frame to frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from .artists import describe, describe_key, round_to, shade

__all__ = ["export_animation", "export_figure"]

#: Number of colours of a continuous colour scale.
_SHADES = 24


def export_figure(figure: Any) -> dict[str, Any]:
    """Return a figure as JSON data.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Complete figure. Its list ``crosstrack_pins`` contains the places of checks.

    Returns
    -------
    dict
        Title, size (inch), axes, artists, legends and pins.
    """
    return _Export(figure).data


def export_animation(animation: Any) -> dict[str, Any]:
    """Return an animation as JSON data: its figure, and the changes of each frame.

    Parameters
    ----------
    animation : matplotlib.animation.FuncAnimation
        Animation of a :class:`.scene.Stage`.

    Returns
    -------
    dict
        Data of :func:`export_figure`, and the list ``frames``. Each frame contains the text of the clock, and the
        changed keys of artists and axes by their index.
    """
    # Matplotlib warns when it deletes an animation that was never drawn.
    animation._draw_was_started = True
    motion = animation.motion
    export = _Export(motion.figure)
    frames = []
    for frame in range(motion.frames):
        motion.update(frame)
        frames.append({"clock": motion.clock.get_text(), **export.changes()})
    return {**export.data, "interval": float(motion.interval), "frames": frames}


class _Export:
    """Export of a figure, which knows the last description of each artist."""

    def __init__(self, figure: Any) -> None:
        figure.draw_without_rendering()
        self.figure = figure
        #: Axes without those of colour scales, and the axes of colour scales.
        self.axes = [axes for axes in figure.axes if getattr(axes, "_colorbar", None) is None]
        bars = [axes for axes in figure.axes if getattr(axes, "_colorbar", None) is not None]
        self.order: dict[Any, int] = {}
        self.artists: list[dict[str, Any]] = []
        self.views = [_describe_axes(axes) for axes in self.axes]
        self._read()
        title = getattr(figure, "_suptitle", None)
        self.data: dict[str, Any] = {
            "title": "" if title is None else title.get_text(),
            "size": [float(edge) for edge in figure.get_size_inches()],
            "axes": [
                {**view, "box": _box(axes, figure), **_titles(axes)}
                for view, axes in zip(self.views, self.axes, strict=True)
            ],
            "artists": [dict(artist) for artist in self.artists],
            "bars": [self._bar(axes) for axes in bars],
            "legends": self._legends(),
            "pins": [
                {"check": str(getattr(pin.check, "name", pin.check)), "axes": self.axes.index(pin.axes), "x": pin.x, "y": pin.y, "z": pin.z}
                for pin in getattr(figure, "crosstrack_pins", []) if pin.axes in self.axes
            ],
        }  # fmt: skip

    def _read(self) -> list[tuple[int, dict[str, Any]]]:
        """Read the artists, and return the indices and descriptions of those that changed."""
        changed, present = [], set()
        for place, axes in enumerate(self.axes):
            parts = (axes.images, axes.collections, axes.patches, axes.lines, axes.texts)
            for artist in itertools.chain.from_iterable(parts):
                index = self.order.get(artist)
                if index is not None and not artist.stale and self.artists[index]:
                    present.add(index)
                    continue
                content = describe(artist, axes)
                artist.stale = False  # until it changes again
                if content is None:
                    continue
                if index is None:
                    index = self.order[artist] = len(self.artists)
                    self.artists.append({})
                present.add(index)
                content["a"] = place
                if content != self.artists[index]:
                    changed.append((index, _changes(self.artists[index], content)))
                    self.artists[index] = content
        for index, known in enumerate(self.artists):
            if index not in present and known["h"] != 1:
                known["h"] = 1
                changed.append((index, {"h": 1}))
        return changed

    def changes(self) -> dict[str, Any]:
        """Return what changed since the last call."""
        result: dict[str, Any] = {"artists": dict(self._read())}
        moved = {}
        for index, axes in enumerate(self.axes):
            view = _describe_axes(axes)
            if view != self.views[index]:
                known = self.views[index]
                moved[index] = {key: value for key, value in view.items() if value != known[key]}
                self.views[index] = view
        return result | ({"axes": moved} if moved else {})

    # -- legends and scales of colours -------------------------------------------------------------

    def _legends(self) -> list[dict[str, Any]]:
        """Return all legends with the indices of the artists that their entries describe."""
        result = []
        for index, axes in enumerate(self.axes):
            for legend in filter(None, [axes.get_legend()]):
                result.append({"axes": index, "keys": self._keys(legend, [index])})
        everything = list(range(len(self.axes)))
        for part in (self.figure, *self.figure.subfigs):
            inside = everything
            if part is not self.figure:
                inside = [k for k in everything if self.axes[k].get_figure(root=False) is part]
            for legend in part.legends:
                result.append({"axes": None, "keys": self._keys(legend, inside)})
        return result

    def _keys(self, legend: Any, places: Sequence[int]) -> list[dict[str, Any]]:
        """Return the entries of a legend."""
        keys = []
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            look = describe_key(handle, self.axes[0])
            label = text.get_text()
            keys.append({"label": label, "look": look, "of": self._matching(label, look, places)})
        return keys

    def _matching(self, label: str, look: dict[str, Any], places: Sequence[int]) -> list[int]:
        """Return the indices of the artists with the label, or otherwise with the look, of an entry."""
        inside = [k for k, artist in enumerate(self.artists) if artist.get("a") in places]
        words = {label, f"curve {label}", label.removesuffix("s"), label.partition(",")[0]}
        named = [k for k in inside if {self.artists[k].get("g"), self.artists[k].get("l")} & words]
        if named:
            return named
        return [
            k
            for k in inside
            if self.artists[k].get("c") == look.get("c") is not None
            and self.artists[k].get("d") == look.get("d")
            and ("m" in self.artists[k]) == ("m" in look)
        ]

    def _bar(self, axes: Any) -> dict[str, Any]:
        """Return a colour scale: label, colours from low to high, and ticks as shares."""
        bar = axes._colorbar
        vertical = bar.orientation == "vertical"
        axis = axes.yaxis if vertical else axes.xaxis
        low, high = axes.get_ylim() if vertical else axes.get_xlim()
        norm = bar.norm
        values = (
            np.asarray(getattr(norm, "boundaries", ())) if hasattr(norm, "boundaries") else None
        )
        if values is not None:
            middles = (values[1:] + values[:-1]) / 2
        else:
            middles = np.asarray(norm.inverse(np.linspace(0, 1, _SHADES)))
        places = np.asarray(axis.get_majorticklocs(), float)
        texts = axis.get_major_formatter().format_ticks(places)
        zeros = np.zeros(len(places))
        ends = axes.transData.transform(
            np.column_stack([zeros, places] if vertical else [places, zeros])
        )
        shares = axes.transAxes.inverted().transform(ends)[:, int(vertical)]
        host = getattr(bar.mappable, "axes", None)
        return {
            "axes": self.axes.index(host) if host in self.axes else 0,
            "label": (axes.get_ylabel() if vertical else axes.get_xlabel()),
            "colours": [shade(bar.cmap(norm(value))) for value in middles.tolist()],
            **({"raw": 1} if hasattr(bar.mappable, "get_extent") else {}),
            "ticks": [
                [round(float(share), 4), text]
                for share, text, place in zip(shares, texts, places, strict=True)
                if text and min(low, high) <= place <= max(low, high)
            ],
        }


def _changes(known: dict[str, Any], content: dict[str, Any]) -> dict[str, Any]:
    """Return the changed keys; lists of coordinates begin with the length of the part that is equal."""
    result: dict[str, Any] = {}
    for key, value in content.items():
        old = known.get(key)
        if value == old:
            continue
        if key in ("x", "y", "z") and old:
            same = next(
                (k for k, (a, b) in enumerate(zip(old, value, strict=False)) if a != b),
                min(len(old), len(value)),
            )
            result[key + "+"] = [same, *value[same:]]
        else:
            result[key] = value
    return result | {key: None for key in known if key not in content}


def _box(axes: Any, figure: Any) -> list[float]:
    """Return left, top, width and height of axes as shares of the figure, from the upper left corner."""
    broad, tall = figure.bbox.size
    box = axes.bbox
    shares = box.x0 / broad, 1 - box.y1 / tall, box.width / broad, box.height / tall
    return [round(float(share), 4) for share in shares]


def _titles(axes: Any) -> dict[str, Any]:
    """Return the titles of axes and the colour of each."""
    parts = [getattr(axes, name) for name in ("_left_title", "title", "_right_title")]
    titles = [[part.get_text(), shade(part.get_color())] for part in parts if part.get_text()]
    return {"titles": titles} if titles else {}


def _describe_axes(axes: Any) -> dict[str, Any]:
    """Return limits, scales, labels and ticks of axes, and the point of view in space."""
    space = hasattr(axes, "get_zlim")
    names = "xyz" if space else "xy"
    result: dict[str, Any] = {"off": not getattr(axes, "_axis3don", axes.axison)}
    for name in names:
        axis = getattr(axes, f"{name}axis")
        limits = [float(limit) for limit in getattr(axes, f"get_{name}lim")()]
        result[f"{name}lim"] = limits
        result[f"{name}log"] = int(getattr(axes, f"get_{name}scale")() == "log")
        result[f"{name}label"] = axis.label.get_text()
        result[f"{name}ticks"] = _ticks(axis, limits)
    if space:
        result |= {"elev": float(axes.elev), "azim": float(axes.azim)}
        result["sides"] = [float(side) for side in axes._box_aspect]
    else:
        result["equal"] = int(axes.get_aspect() == 1.0)
        result["grid"] = int(bool(axes.xaxis._major_tick_kw.get("gridOn"))) + 2 * int(
            bool(axes.yaxis._major_tick_kw.get("gridOn"))
        )
        result["frame"] = [side for side, spine in axes.spines.items() if spine.get_visible()]
    return result


def _ticks(axis: Any, limits: Sequence[float]) -> Any:
    """Return ``[[value, text], …]`` for fixed ticks, or None if the script should choose numbers."""
    from matplotlib.ticker import FixedLocator, NullLocator

    locator = axis.get_major_locator()
    if isinstance(locator, NullLocator):
        return []
    if (
        axis.get_tick_params().get("labelbottom") is False
        or axis.get_tick_params().get("labelleft") is False
    ):
        return 0
    if not isinstance(locator, FixedLocator):
        return None
    places = [float(place) for place in axis.get_majorticklocs()]
    texts = axis.get_major_formatter().format_ticks(places)
    return [[value, text] for value, text in zip(round_to(places, limits), texts, strict=True)]
