"""Artists of matplotlib as plain data, for a script that draws them again in a browser.

Every artist becomes a mapping with short keys, because a page contains thousands of them:

======================  ==============================================================================
key                     value
======================  ==============================================================================
``t``                   ``"line"``, ``"points"``, ``"paths"``, ``"image"`` or ``"text"``
``x``, ``y``, ``z``     coordinates in the space ``k``; in space of three dimensions with ``z``
``k``                   ``""``: both in data; ``"x"`` or ``"y"``: only this one, the other as a share of
                        the axes; ``"a"``: both as shares
``c``, ``w``, ``d``     colour, width and dashes (point) of a line
``m``                   shapes of markers around the origin (point), cycled; ``"o"`` is a circle
``s``                   diameters of circles (point), cycled
``f``, ``e``            face and edge colours, cycled; None for no colour
``p``                   paths, each a list of lines ``[x, y, …]`` or of one circle ``["o", x, y, rx, ry]``
``o``                   order of drawing
``g``, ``l``            group and label of the artist
``h``, ``v``            1 if the artist is hidden, and if its colours are those of a colour scale
======================  ==============================================================================
"""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np

from .curves import Floats

__all__ = ["describe", "describe_key", "round_to", "shade"]

#: Largest number of points of a line or of markers, and of pixels along an image.
_MOST_POINTS, _MOST_PIXELS = 20_000, 1200
#: Number of points up to which a line keeps all of them.
_MOST_EXACT = 200
#: Number of vertices of a circle, which matplotlib draws as eight curves.
_CIRCLE = 26
#: Decimals that remain beyond the first digit of the extent of the axes.
_DIGITS = 5


def describe(artist: Any, axes: Any) -> dict[str, Any] | None:
    """Return an artist as plain data, see the module.

    Parameters
    ----------
    artist : matplotlib.artist.Artist
        Artist of `axes`.
    axes : matplotlib.axes.Axes
        Axes with their final limits.

    Returns
    -------
    dict or None
        None for an artist without content.
    """
    from matplotlib.collections import Collection
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    kinds: tuple[tuple[Any, Any], ...] = (
        (Line2D, _line), (Collection, _collection), (Patch, _patch), (AxesImage, _image), (Text, _text),
    )  # fmt: skip
    for kind, function in kinds:
        if isinstance(artist, kind):
            content: dict[str, Any] | None = function(artist, axes)
            break
    else:
        content = None
    if content is None:
        return None
    label = str(artist.get_label() or "")
    mapped = getattr(artist, "get_array", lambda: None)() is not None and (
        content["t"] != "image" or getattr(artist, "colorbar", None) is not None
    )
    return {
        **content,
        "o": round(float(artist.get_zorder()), 3),
        "g": str(artist.get_gid() or ""),
        "l": "" if label.startswith("_") else label,
        "h": 0 if artist.get_visible() else 1,
        **({"v": 1} if mapped else {}),
    }


def describe_key(handle: Any, axes: Any) -> dict[str, Any]:
    """Return the look of the entry of a legend as plain data.

    Parameters
    ----------
    handle : matplotlib.artist.Artist
        Artist of the legend.
    axes : matplotlib.axes.Axes
        Any axes of the figure.
    """
    is_marker = hasattr(handle, "get_sizes") and len(handle.get_sizes()) > 0
    content = {"t": "points", **_shapes(handle)} if is_marker else describe(handle, axes) or {}
    return {
        key: content[key]
        for key in ("t", "c", "w", "d", "m", "s", "f", "e", "mw")
        if key in content
    }


def shade(colour: Any, alpha: Any = None) -> str | None:
    """Return a colour as ``"#rrggbb"``, or ``"#rrggbbaa"`` if it is transparent; None for no colour."""
    from matplotlib.colors import to_hex, to_rgba

    rgba = to_rgba(colour, alpha if np.ndim(alpha) == 0 else None)
    if rgba[3] == 0:
        return None
    return to_hex(rgba, keep_alpha=rgba[3] < 1)


def round_to(values: Any, limits: Any, scale: str = "linear") -> list[float | None]:
    """Return numbers with the digits that are visible within `limits`; None for NaN."""
    array = np.asarray(values, float).ravel()
    span = abs(float(limits[1]) - float(limits[0])) or 1.0
    with np.errstate(all="ignore"):
        if scale != "linear":
            array = np.array([float(f"{value:.6g}") for value in array])
        else:
            array = np.round(array, _DIGITS - int(np.floor(np.log10(span)))) + 0.0
    return [value if np.isfinite(value) else None for value in array.tolist()]


# -- coordinates -----------------------------------------------------------------------------------


def _space(transform: Any, axes: Any) -> str:
    """Return the key ``k`` of coordinates with this transformation."""
    x, y = transform.contains_branch_seperately(axes.transData)
    return "" if x and y else "x" if x else "y" if y else "a"


def _place(pixels: Floats, axes: Any, space: str) -> Floats:
    """Return pixels in data coordinates or shares of the axes, shape (n, 2)."""
    with np.errstate(all="ignore"):
        data = axes.transData.inverted().transform(pixels)
        share = axes.transAxes.inverted().transform(pixels)
    return np.column_stack(
        [
            (data if space in ("", "x") else share)[:, 0],
            (data if space in ("", "y") else share)[:, 1],
        ]
    )


def _xy(places: Any, axes: Any, space: str = "") -> dict[str, Any]:
    """Return the coordinates of places, shape (n, 2) or (n, 3)."""
    places = np.asarray(places, float)
    step = -(-len(places) // _MOST_POINTS) or 1
    result: dict[str, Any] = {"k": space} if space else {}
    for k, name in enumerate("xyz"[: places.shape[1]]):
        inside = space in ("", name)
        limits = getattr(axes, f"get_{name}lim")() if inside else (0, 1)
        scale = getattr(axes, f"get_{name}scale")() if inside else "linear"
        result[name] = round_to(places[::step, k], limits, scale)
    return result


def _polygons(path: Any, transform: Any, axes: Any, space: str) -> list[list[Any]]:
    """Return the lines of a path, each as ``[x, y, …]``, with curves as short lines."""
    if _is_circle(path):
        corners = _place(transform.transform(path.vertices[:-1]), axes, space)
        low, high = corners.min(axis=0), corners.max(axis=0)
        flat = _xy([(low + high) / 2, (high - low) / 2], axes, space)
        return [["o", *(flat[name][k] for k in range(2) for name in "xy")]]
    # Path.to_polygons ignores the part of a transformation that is not affine, such as a logarithm.
    bent = transform.transform_path_non_affine(path)
    lines = bent.to_polygons(transform=transform.get_affine(), closed_only=False)
    result: list[list[Any]] = []
    for line in lines:
        flat = _xy(_place(np.asarray(line), axes, space), axes, space)
        result.append([value for pair in zip(flat["x"], flat["y"], strict=True) for value in pair])
    return result


def _is_circle(path: Any) -> bool:
    return path.codes is not None and len(path.codes) == _CIRCLE and path.codes[1] == path.CURVE4


def _shape(path: Any, transform: Any) -> list[list[float]]:
    """Return the lines of a marker as ``[x, y, …]`` (point), y upwards."""
    from matplotlib.transforms import Affine2D

    grown = path.to_polygons(transform=transform + Affine2D().scale(16), closed_only=False)
    return [np.round(np.asarray(line) / 16, 2).ravel().tolist() for line in grown]


# -- kinds of artists ------------------------------------------------------------------------------


def _dashes(pattern: Any) -> list[float] | None:
    """Return the lengths of dashes and gaps (point); None for a solid line."""
    _, lengths = pattern
    return None if lengths is None else [round(float(length), 2) for length in lengths]


def _line(line: Any, axes: Any) -> dict[str, Any]:
    space = ""
    if hasattr(line, "get_data_3d"):
        places = np.column_stack(np.broadcast_arrays(*map(np.atleast_1d, line.get_data_3d())))
    else:
        space = _space(line.get_transform(), axes)
        places = np.column_stack(line.get_path().vertices.T).reshape(-1, 2)
        if not space and line.get_drawstyle() == "default":
            places = np.asarray(line.get_xydata(), float)
            if len(places) > _MOST_EXACT and line.get_marker() in ("None", "", " ", None):
                places = _simplify(line, axes)
    result = {"t": "line", **_xy(places, axes, space)}
    alpha = line.get_alpha()
    if str(line.get_linestyle()) not in ("None", "", " "):
        result |= {"c": shade(line.get_color(), alpha), "w": float(line.get_linewidth())}
        result["d"] = _dashes(line._dash_pattern)
    if line.get_marker() not in ("None", "", " ", None):
        result |= _marker(line, alpha)
    return result


def _simplify(line: Any, axes: Any) -> Floats:
    """Return a line without the points that are invisible; NaN separates its parts."""
    transform = line.get_transform()
    path = transform.transform_path_non_affine(line.get_path())
    path = path.cleaned(transform.get_affine(), remove_nans=True, simplify=True)
    codes = path.codes[:-1]  # the last one ends the path
    places = _place(path.vertices[:-1], axes, "")
    gaps = np.flatnonzero(codes == path.MOVETO)
    return np.insert(places, gaps[gaps > 0], np.nan, axis=0)


def _marker(line: Any, alpha: Any) -> dict[str, Any]:
    """Return the marker of a line."""
    style, size = line._marker, float(line.get_markersize())
    look = {
        "f": [shade(line.get_markerfacecolor(), alpha) if style.is_filled() else None],
        "e": [shade(line.get_markeredgecolor(), alpha)],
        "mw": float(line.get_markeredgewidth()),
    }
    if style.get_marker() in ("o", "."):
        return {"m": "o", "s": [size / (1 if style.get_marker() == "o" else 2)], **look}
    from matplotlib.transforms import Affine2D

    shape = _shape(style.get_path(), style.get_transform() + Affine2D().scale(size))
    return {"m": [shape], **look}


def _colours(collection: Any) -> dict[str, Any]:
    """Return face and edge colours, widths and dashes of a collection."""
    collection.update_scalarmappable()
    faces, edges = collection.get_facecolor(), collection.get_edgecolor()
    widths = [round(float(width), 2) for width in np.atleast_1d(collection.get_linewidth())]
    patterns = [_dashes(pattern) for pattern in collection._linestyles]
    return {
        "f": _unique([shade(colour) for colour in faces]),
        "e": _unique([shade(colour) for colour in edges]),
        "w": _unique(widths),
        **({"d": _unique(patterns)} if any(patterns) else {}),
    }


def _unique(values: list[Any]) -> list[Any]:
    """Return the values, or a single one if all are equal."""
    return values[:1] if values and all(value == values[0] for value in values) else values


def _collection(collection: Any, axes: Any) -> dict[str, Any] | None:
    if hasattr(collection, "_offsets3d"):
        places: Any = np.column_stack([np.ma.filled(c, np.nan) for c in collection._offsets3d])
        return {"t": "points", **_xy(places, axes), **_shapes(collection)}
    if hasattr(collection, "_segments3d"):
        return _solid(collection, collection._segments3d, axes)
    if hasattr(collection, "_faces"):
        return {**_solid(collection, collection._faces, axes), "fill": 1}
    if collection.get_offset_transform().contains_branch(axes.transData):
        places = np.ma.filled(collection.get_offsets(), np.nan)
        return {"t": "points", **_xy(places, axes), **_shapes(collection)}
    transform = collection.get_transform()
    space = _space(transform, axes)
    paths = [_polygons(path, transform, axes, space) for path in collection.get_paths()]
    look = _colours(collection)
    return {"t": "paths", "k": space, "p": paths, **look}


def _solid(collection: Any, lines: Any, axes: Any) -> dict[str, Any]:
    """Return the lines or faces of a collection in space, as paths ``[x, y, z, …]``."""
    paths = []
    for line in lines:
        flat = _xy(np.asarray(line, float), axes)
        triples = zip(flat["x"], flat["y"], flat["z"], strict=True)
        paths.append([[value for triple in triples for value in triple]])
    return {"t": "paths", "p": paths, **_colours(collection)}


def _shapes(collection: Any) -> dict[str, Any]:
    """Return the markers of a collection with offsets."""
    from matplotlib.quiver import Quiver
    from matplotlib.transforms import Affine2D

    points = 72 / collection.get_figure(root=True).dpi
    look = _colours(collection)
    if isinstance(collection, Quiver):
        to_points = collection.get_transform() + Affine2D().scale(points)
        return {"m": [_shape(path, to_points) for path in collection.get_paths()], **look}
    sizes = np.sqrt(np.atleast_1d(collection.get_sizes()))
    path = collection.get_paths()[0]
    if _is_circle(path):
        return {"m": "o", "s": _unique(np.round(sizes, 2).tolist()), **look}
    shapes = [_shape(path, Affine2D().scale(size)) for size in np.unique(sizes).tolist()]
    order = np.searchsorted(np.unique(sizes), sizes).tolist()
    return {"m": _unique([shapes[k] for k in order]), **look}


def _patch(patch: Any, axes: Any) -> dict[str, Any]:
    transform = patch.get_transform()
    space = _space(transform, axes)
    edge = shade(patch.get_edgecolor()) if patch.get_linewidth() else None
    dashes = _dashes(patch._dash_pattern)
    return {
        "t": "paths", "k": space, "p": [_polygons(patch.get_path(), transform, axes, space)],
        "f": [shade(patch.get_facecolor())], "e": [edge], "w": [float(patch.get_linewidth())],
        **({"d": [dashes]} if dashes else {}),
    }  # fmt: skip


def _image(image: Any, axes: Any) -> dict[str, Any]:
    from PIL import Image

    array = image.get_array()
    step = -(-max(array.shape[:2]) // _MOST_PIXELS) or 1
    pixels = image.to_rgba(array[::step, ::step], bytes=True)
    left, right, bottom, top = image.get_extent()
    if image.origin == "lower":
        bottom, top = top, bottom
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "png", optimize=True)
    code = base64.b64encode(out.getvalue()).decode("ascii")
    return {
        "t": "image", "src": f"data:image/png;base64,{code}",
        "x": round_to([left, right], axes.get_xlim()), "y": round_to([top, bottom], axes.get_ylim()),
        **({"soft": 1} if image.get_interpolation() in ("bilinear", "bicubic") else {}),
    }  # fmt: skip


def _text(text: Any, axes: Any) -> dict[str, Any] | None:
    from matplotlib.text import Annotation

    if not text.get_text().strip():
        return None
    shift, space = (0.0, 0.0), ""
    if hasattr(text, "get_position_3d"):
        places = [text.get_position_3d()]
    elif hasattr(text, "place"):
        places, shift = [text.place], text.xyann
    elif isinstance(text, Annotation) and text.anncoords == "offset points":
        places, shift = [text.xy], text.xyann
        if not isinstance(text.xycoords, str):
            space = _space(text.xycoords, axes)
    elif isinstance(text, Annotation) and not isinstance(text.xycoords, str):
        places, space = [text.xy], _space(text.xycoords, axes)
    else:
        space = _space(text.get_transform(), axes)
        places = [text.get_position()]
    return {
        "t": "text", **_xy(places, axes, space), "s": text.get_text(), "c": shade(text.get_color(), text.get_alpha()),
        "n": round(float(text.get_fontsize()), 2), "ha": text.get_ha(), "va": text.get_va(),
        **({"r": float(text.get_rotation())} if text.get_rotation() else {}),
        **({"dx": round(float(shift[0]), 2), "dy": round(float(shift[1]), 2)} if any(shift) else {}),
        **({"halo": 1} if text.get_path_effects() else {}),
    }  # fmt: skip
