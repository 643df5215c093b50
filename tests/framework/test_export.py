"""Figures as plain data for pages: artists, axes, legends, colour scales and frames."""

from types import SimpleNamespace

import numpy as np
import pytest
from strange import examples

from crosstrack.models import Model
from crosstrack.models.plots import kit, plot
from crosstrack.models.plots.export import export_animation, export_figure


def scene_of(draw, **settings):
    """Return the export of a figure with one pair of axes, and the axes."""
    figure = kit.sheet(None, (4.0, 3.0))
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8), **settings)
    draw(axes)
    return export_figure(figure), axes


def test_line_keeps_points_gaps_and_look():
    def draw(axes):
        axes.plot([0, 1, np.nan, 3], [1, 2, 2, 5], "o--", lw=2, color="#0072B2", gid="curve v")
        axes.set(xlim=(0, 4), ylim=(0, 8), xlabel="time (s)")

    scene, _ = scene_of(draw)
    (line,) = scene["artists"]
    assert line["x"] == [0, 1, None, 3]
    assert line["y"] == [1, 2, 2, 5]
    assert (line["c"], line["w"], line["m"], line["g"]) == ("#0072b2", 2.0, "o", "curve v")
    assert len(line["d"]) == 2
    assert scene["axes"][0]["xlim"] == [0, 4]
    assert scene["axes"][0]["xlabel"] == "time (s)"


def test_long_line_loses_only_invisible_points():
    times = np.linspace(0, 10, 5001)
    values = np.sin(times)
    values[2500:2510] = np.nan

    def draw(axes):
        axes.plot(times, values)
        axes.set(xlim=(0, 10), ylim=(-1, 1))

    scene, _ = scene_of(draw)
    (line,) = scene["artists"]
    known = np.array([value is not None for value in line["x"]])
    x = np.array([value for value in line["x"] if value is not None])
    y = np.array([value for value in line["y"] if value is not None])
    assert len(x) < 1000
    assert (~known).sum() == 1
    assert np.abs(np.interp(times, x, y) - np.sin(times)).max() < 5e-3


def test_logarithmic_axes_keep_values_of_lines_and_polygons():
    times = np.logspace(-3, 2, 1000)

    def draw(axes):
        axes.plot(times, times**2)
        axes.axvspan(0.01, 0.25)
        axes.fill_between([0.01, 10.0], [1.0, 1.0], [100.0, 100.0])
        axes.set(xscale="log", yscale="log")

    scene, _ = scene_of(draw)
    (line,) = [artist for artist in scene["artists"] if artist["t"] == "line"]
    assert len(line["x"]) < 1000
    assert np.allclose(np.square(line["x"]), line["y"], rtol=0.02)
    assert (line["x"][0], line["x"][-1]) == (pytest.approx(1e-3), pytest.approx(100))
    area, span = [artist["p"][0][0] for artist in scene["artists"] if artist["t"] == "paths"]
    assert (min(area[::2]), max(area[::2])) == (pytest.approx(0.01), pytest.approx(10))
    assert (min(area[1::2]), max(area[1::2])) == (pytest.approx(1), pytest.approx(100))
    assert (min(span[::2]), max(span[::2])) == (pytest.approx(0.01), pytest.approx(0.25))


def test_shares_of_the_axes_are_marked():
    def draw(axes):
        axes.axvspan(1, 2, color="#eef1f4")
        axes.plot([3, 4], [0, 0], "|", transform=axes.get_xaxis_transform())
        axes.annotate(
            "far",
            (1.0, 5.0),
            (3, 4),
            xycoords=axes.get_yaxis_transform(),
            textcoords="offset points",
        )
        axes.set(xlim=(0, 4), ylim=(0, 8))

    scene, _ = scene_of(draw)
    span, ticks, label = scene["artists"]
    assert span["k"] == "x"
    assert max(span["p"][0][0][1::2]) == 1.0
    assert (ticks["k"], ticks["y"]) == ("x", [0, 0])
    assert (label["k"], label["x"], label["y"], label["dx"], label["dy"]) == ("y", [1], [5], 3, 4)


def test_image_becomes_a_png_with_its_place():
    scene, _ = scene_of(
        lambda axes: axes.imshow([[0, 1], [2, 3]], extent=(0, 2, 10, 14), origin="lower")
    )
    (image,) = scene["artists"]
    assert image["src"].startswith("data:image/png;base64,")
    # The first row of pixels is at y = 10.
    assert (image["x"], image["y"]) == ([0, 2], [10, 14])


def test_points_in_space_keep_three_coordinates():
    def draw(axes):
        axes.scatter([1, 2], [3, 4], [5, 6], marker="s")
        axes.plot([0, 1], [0, 1], [0, 1])
        axes.set(xlim=(0, 8), ylim=(0, 8), zlim=(0, 8))

    scene, _ = scene_of(draw, projection="3d")
    points, line = scene["artists"]
    assert (points["x"], points["y"], points["z"]) == ([1, 2], [3, 4], [5, 6])
    assert line["z"] == [0, 1]
    assert scene["axes"][0]["elev"] == 30


def test_pins_have_the_index_of_their_axes():
    figure = kit.sheet(None, (4.0, 3.0))
    figure.add_axes((0, 0.5, 1, 0.4))
    second = figure.add_axes((0, 0, 1, 0.4))
    figure.crosstrack_pins = [SimpleNamespace(axes=second, check="speed", x=1.0, y=2.0, z=None)]
    pins = export_figure(figure)["pins"]
    assert pins == [{"check": "speed", "axes": 1, "x": 1.0, "y": 2.0, "z": None}]


def test_legend_entries_refer_to_their_artists():
    def draw(axes):
        axes.plot([0, 1], [0, 1], color="#0072B2", gid="path")
        axes.plot([0, 1], [1, 0], color="#E69F00")
        kit.legend_row(
            axes, [kit.key("path"), kit.key("other", color="#E69F00"), kit.key("absent", color="#123456")],
            "lower left", (0, 0),
        )  # fmt: skip

    scene, _ = scene_of(draw)
    assert [key["of"] for key in scene["legends"][0]["keys"]] == [[0], [1], []]


def test_colour_scale_has_ticks_and_colours():
    figure = kit.sheet(None, (4.0, 3.0))
    axes = figure.add_axes((0.1, 0.1, 0.6, 0.8))
    image = axes.imshow([[0.0, 1.0]], cmap="viridis", vmin=0, vmax=1)
    kit.color_bar(figure, image, figure.add_axes((0.8, 0.1, 0.05, 0.8)), "speed (m/s)")
    scene = export_figure(figure)
    (bar,) = scene["bars"]
    assert len(scene["axes"]) == 1
    assert (bar["axes"], bar["label"], bar["colours"][0]) == (0, "speed (m/s)", "#440154")
    assert bar["ticks"][0] == [0.0, "0.0"]
    assert bar["ticks"][-1] == [1.0, "1.0"]


def test_frames_contain_only_changes():
    stage = kit.Stage(SimpleNamespace(name="moving"), None, None, 4, 50.0)
    axes = stage.axes(0.5, 0.5, 0.2, 0.5)
    axes.set(xlim=(0, 4), ylim=(0, 4))
    axes.plot([0, 4], [4, 0])
    (way,) = axes.plot([], [])

    def show(frame):
        way.set_data(range(frame + 1), range(frame + 1))
        return f"step {frame}"

    scene = export_animation(stage.play(show))
    assert [frame["clock"] for frame in scene["frames"]] == ["step 0", "step 1", "step 2", "step 3"]
    assert scene["frames"][2]["artists"] == {1: {"x+": [2, 2.0], "y+": [2, 2.0]}}
    assert "axes" not in scene["frames"][2]


@pytest.mark.parametrize("with_plan", [True, False])
def test_every_picture_is_exported_completely(with_plan):
    import json

    kinds = {}
    for text, plan in examples():
        kinds.setdefault(json.loads(text)["model"], (text, plan))
    for kind, (text, plan) in kinds.items():
        if kind.endswith("program"):
            continue
        figure = plot(Model.from_json(text), json.loads(plan) if with_plan else None)
        scene = export_figure(figure)
        shown = sum(len(axes.lines) + len(axes.collections) + len(axes.patches) + len(axes.images) for axes in figure.axes if getattr(axes, "_colorbar", None) is None)  # fmt: skip
        drawn = [artist for artist in scene["artists"] if artist["t"] != "text"]
        assert len(drawn) == shown, kind
        json.dumps(scene, allow_nan=False)
