"""The generators of trajectory models, and instances in files."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack import instances
from crosstrack.errors import InvalidData
from crosstrack.instances import minimum_snap as ms
from crosstrack.instances.minimum_snap.corridors import corridor_with_way
from crosstrack.models import MinimumDerivative
from crosstrack.models.minimum_snap.trajectory import Trajectory


@given(st.integers(1, 30), st.integers(1, 5), st.integers(0, 2**40))
@settings(max_examples=40, deadline=None)
def test_random_walks(segments, dimensions, seed):
    model = ms.random_walk(segments, dimensions, seed)
    assert model.waypoints.shape == (segments + 1, dimensions)
    assert model.digest == ms.random_walk(segments, dimensions, seed=seed).digest
    length = np.linalg.norm(np.diff(model.waypoints, axis=0), axis=1)
    assert (length > 0.49).all() and (length < 1.51).all()
    # By distance, with time to gather speed at both ends.
    np.testing.assert_allclose(model.durations[1:-1], length[1:-1], atol=2e-3)
    assert model.durations.max() / model.durations.min() < 7


@given(
    st.integers(4, 60),
    st.integers(0, 2**40),
    st.integers(1, 4),
    st.floats(0.3, 6),
    st.floats(0.05, 3),
)
@settings(max_examples=40, deadline=None)
def test_any_corridor_is_feasible(segments, seed, dimensions, cruise, width):
    model, way = corridor_with_way(segments, seed, dimensions, cruise=cruise, width=width)
    assert model.segments == segments
    assert model.verify(way, tolerance=1e-9).ok
    assert (
        model.digest == ms.corridor(segments, seed, dimensions, cruise=cruise, width=width).digest
    )


@given(st.integers(2, 20), st.integers(0, 2**40), st.floats(0.05, 2))
@settings(max_examples=20, deadline=None)
def test_any_gates_are_feasible(segments, seed, width):
    model = ms.gates(segments, seed, width=width)
    points = ms.random_waypoints(segments, 2, seed, step=2.0)
    bell = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])
    inner = bell[None, :, None] * np.diff(points, axis=0)[:, None, :]
    inner[:, 0] += points[:-1]
    assert model.verify(Trajectory(model.times, inner), tolerance=1e-9).ok


def test_curves():
    eight = ms.figure_eight(dimensions=4)
    assert eight.waypoints[0].tolist() == [0.0, 0.0, 1.0, round(np.pi / 4, 3)]
    np.testing.assert_allclose(eight.waypoints[0, :3], eight.waypoints[-1, :3], atol=1e-12)
    assert np.abs(np.diff(eight.waypoints[:, 3])).max() < np.pi, "yaw is unwrapped"
    assert eight.times[-1] == 12
    helix = ms.helix(2, 6, radius=2, pitch=1)
    assert helix.segments == 12
    np.testing.assert_allclose(np.hypot(*helix.waypoints[:, :2].T), 2, atol=1e-3)
    assert helix.waypoints[-1, 2] == 2
    assert ms.square(3, 2).waypoints.tolist() == [[0, 0], [3, 0], [3, 3], [0, 3]] * 2 + [[0, 0]]
    assert ms.random_walk(3, velocity_limit=9).bounds[0].name == "velocity limit"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ms.random_walk(0), "segments must be >= 1, got 0"),
        (lambda: ms.random_walk(2.5), r"segments must be a whole number, got 2\.5"),
        (lambda: ms.random_walk(5, 0), "dimensions must be >= 1"),
        (lambda: ms.random_walk(5, seed=-1), "seed must be a whole number >= 0, got -1"),
        (lambda: ms.random_walk(5, seed=True), "seed must be a whole number"),
        (lambda: ms.random_walk(5, seed="1"), "seed must be a whole number"),
        (lambda: ms.random_walk(5, step=0), r"step must be >= 0\.01 m"),
        (lambda: ms.random_walk(5, speed=0), "speed must be > 0 m/s"),
        (lambda: ms.random_walk(5, speed=math.nan), "speed must be finite"),
        (lambda: ms.figure_eight(3), "segments must be >= 4"),
        (lambda: ms.figure_eight(dimensions=5), "dimensions must be <= 4"),
        (lambda: ms.figure_eight(lap=0), "lap must be > 0 s"),
        (lambda: ms.figure_eight(size=-1), "size must be > 0 m"),
        (lambda: ms.helix(0), "turns must be >= 1"),
        (lambda: ms.helix(per_turn=2), "per_turn must be >= 3"),
        (lambda: ms.square(0), "side must be > 0"),
        (lambda: ms.square(laps=0), "laps must be >= 1"),
        (lambda: ms.corridor(3), "segments must be >= 4, got 3"),
        (lambda: ms.corridor(10, seed=-1), "seed must"),
        (lambda: ms.corridor(10, cruise=0), r"cruise must be >= 0\.1 m/s"),
        (lambda: ms.corridor(10, acceleration=0), "acceleration must be >= "),
        (lambda: ms.corridor(10, width=0), "width must be >= "),
        (lambda: ms.corridor(10, slack=-0.1), "slack must be >= 0"),
        (lambda: ms.hurried(10, 10), "segment must be <= 9, got 10"),
        (lambda: ms.gates(1), "segments must be >= 2"),
        (lambda: ms.gates(3, width=0), "width must"),
        (lambda: ms.times_by_distance([[0.0, 1.0]]), "at least 2 entries, got 1"),
        (lambda: ms.times_by_distance([[0.0], [None]]), r"waypoints\[1, 0\] must be"),
        (lambda: ms.times_by_distance([[0.0], [1.0]], -1), "speed must be > 0"),
        (lambda: ms.times_by_distance([[0.0], [1.0]], shortest=0), "shortest must be >= 0.001"),
        (lambda: ms.times_by_distance([[0.0], [1.0]], ramp=-1), "ramp must be >= 0"),
    ],
)  # fmt: skip
def test_bad_input_is_named(call, message):
    with pytest.raises(InvalidData, match=message):
        call()


def test_times_by_distance():
    times = instances.times_by_distance([[0, 0], [3, 4], [3, 4], [3, 5]], 2, shortest=0.25, ramp=1)
    assert times.tolist() == [0, 3.5, 3.75, 5.25]


def test_an_instance_file_refers_to_waypoints(tmp_path):
    (tmp_path / "w.csv").write_text("0,0\n1,2\n3,2\n")
    path = tmp_path / "mine.json"
    for kind, more in (("minimum-snap", {}), ("minimum-derivative", {"order": 3})):
        data = {"waypoints": "w.csv", "times": [0, 1, 3], **more}
        path.write_text(json.dumps({"model": kind, "data": data}))
        model = ct.load(path)
        assert isinstance(model, MinimumDerivative)
        assert model.waypoints.tolist() == [[0, 0], [1, 2], [3, 2]]
        assert model.name == "mine"
    path.write_text('{"model": "minimum-snap", "data": {"waypoints": "none.csv", "times": [0, 1]}}')
    with pytest.raises(InvalidData, match=r"mine\.json: .*none\.csv: no such file"):
        ct.load(path)


def test_every_export_exists():
    for name in ms.__all__:
        assert getattr(ms, name) is not None
    assert set(dir(ms)) == set(ms.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = ms.nothing
