"""Every file of a newcomer is solved, or ends in a message with the remedy; damaged files are refused."""

import gzip
import json
import random
import re
import time

import everyday
import numpy as np
import pytest
import strange
from commands import run

import crosstrack as ct
from crosstrack.cli.options import pairs
from crosstrack.errors import (
    BackendMissing,
    InvalidData,
    UnknownName,
    UnsupportedFormulation,
    UnsupportedOption,
)
from crosstrack.instances import FileFormat, Target, file_formats, recognise, register_format
from crosstrack.instances.places import _LENGTHS, _unit_of
from crosstrack.instances.projection import project_positions
from crosstrack.models import FleetRouting, model_types


def unique(files):
    return [f"{number}-{file.name.rpartition('/')[2]}" for number, file in enumerate(files)]


@pytest.mark.parametrize("file", everyday.FILES, ids=unique(everyday.FILES))
def test_a_newcomer_gets_an_answer_or_the_remedy(file, tmp_path):
    if file.content is None and not (everyday.DATA / file.name).exists():
        pytest.skip(f"shared/data/{file.name} is not here")
    if file.name.endswith((".pgm", ".yaml")):
        pytest.importorskip("PIL", reason="images need Pillow")
    kind, message = everyday.outcome(file, tmp_path, "solve", "--time-limit", "1")
    if file.kind != "?":
        assert kind == file.kind, message
    if not kind:
        assert message.startswith("exit 2: error: ")
        assert str(everyday.write(file, tmp_path)) in message
        assert re.search(file.words, message), message
        assert re.search(everyday.REMEDY, message), message
    else:
        assert message in ("optimal", "feasible", "locally_optimal")


def load(file, folder):
    words = file.options.split()
    model = words[words.index("--as") + 1] if "--as" in words else None
    return ct.load(
        everyday.write(file, folder),
        data=pairs([word for word in words if "=" in word], "--data"),
        model=model,
    )


def named(name):
    return next(file for file in everyday.FILES if file.name == name)


def test_ros_maps_have_their_resolution_origin_and_thresholds(tmp_path):
    pytest.importorskip("PIL", reason="images need Pillow")
    grid = load(named("room.yaml"), tmp_path).map
    assert grid.data()["blocked"] == ["....", "@@..", "...@"]  # gray 205 is unknown
    assert (grid.cell, grid.origin.tolist(), grid.upward) == (0.05, [-10, -5], True)
    assert load(named("room.pgm"), tmp_path).map.data() == grid.data()
    for name in ("room.yaml", "room.pgm"):
        free = named(name)._replace(options=f"{everyday.ENDS} --data unknown=free")
        assert load(free, tmp_path).map.data()["blocked"] == ["....", "@@..", "...."]
        assert load(free, tmp_path).map.cell == 0.05
    other = named("room.pgm")._replace(beside={"room.yaml": "title: a room\n"})
    assert load(other, tmp_path).map.cell == 1
    dark = load(named("dark.yaml"), tmp_path).map
    assert dark.data()["blocked"] == ["@@@@", "..@@", "@@@@"]
    turned = named("room.yaml").content.replace("0.000000", "0.3")
    for content, words in (
        (turned, "yaw of the origin must be 0"),
        (everyday.ROS.format("/etc/a.pgm", 0), "relative to the instance's folder"),
    ):
        with pytest.raises(InvalidData, match=words):
            load(named("room.yaml")._replace(content=content), tmp_path)


def test_a_constrained_path_of_the_or_library(tmp_path):
    file = named("paths.txt")
    assert ct.solve(load(file, tmp_path)).primal_bound == 8
    tight = file._replace(content=file.content.replace("\n9\n", "\n7\n", 1))
    assert ct.solve(load(tight, tmp_path)).primal_bound == 13
    floor = file._replace(content=file.content.replace("\n0\n", "\n1\n", 1))
    assert load(floor, tmp_path).resources[0].lower_limits


def test_geojson_keeps_names_depots_and_obstacles(tmp_path):
    stops = load(named("stops.geojson"), tmp_path)
    assert stops.ids == tuple(f"stop {k}" for k in range(5))
    assert stops.points.tolist() == everyday.STOPS
    mission = load(named("mission.geojson"), tmp_path)
    assert (mission.depot.tolist(), mission.nodes.tolist()) == ([1, 1], [[8, 8], [8, 2]])
    assert len(mission.obstacles) == 1
    with pytest.raises(InvalidData, match="coordinates may be degrees"):
        load(named("areas.geojson")._replace(content=everyday.AREAS.replace("crs", "c")), tmp_path)
    with pytest.raises(InvalidData, match="latitudes"):
        load(
            named("stops.geojson")._replace(options="--data vehicles=2 --data units=degrees"),
            tmp_path,
        )
    cafes = next(file for file in everyday.FILES if "units=degrees" in file.options)
    cafes = load(cafes._replace(options="--data vehicles=1 --data units=degrees"), tmp_path)
    # A thousandth of a degree of longitude at 48.13° north, by the radius of curvature of WGS 84.
    assert np.diff(cafes.points[:, 0]) == pytest.approx(74.43, abs=0.02)
    assert np.ptp(cafes.points[:, 1]) < 0.01
    mission = MISSION_IN_DEGREES
    path = everyday.write(named("mission.geojson")._replace(content=mission), tmp_path)
    bounds = [11.0, 48.0, 11.001, 48.001]
    inner = ct.load(path, data={"bounds": bounds, "vehicles": 1, "depot": [11.0001, 48.0001]})
    assert inner.bounds[2:] - inner.bounds[:2] == pytest.approx([74.6, 111.2], abs=0.1)
    assert inner.depot - inner.bounds[:2] == pytest.approx([7.46, 11.12], abs=0.01)
    assert inner.nodes[0] - inner.bounds[:2] == pytest.approx([59.7, 89.0], abs=0.1)
    reverse = {"bounds": [*bounds[2:], *bounds[:2]], "vehicles": 1, "depot": [11.0001, 48.0001]}
    with pytest.raises(InvalidData, match="bounds must be"):
        ct.load(path, data=reverse)
    with pytest.raises(InvalidData, match="nodes must not be given"):
        ct.load(path, data={"bounds": bounds, "vehicles": 1, "nodes": [[11, 48]]})
    mixed = named("mission.geojson")._replace(options="--data vehicles=1 --as fleet-routing")
    with pytest.raises(UnknownName, match="GeoJSON of points and polygons"):
        load(mixed, tmp_path)


SQUARE = [[[11 + x / 1e4, 48 + y / 1e4] for x, y in everyday.SQUARE[0]]]
MISSION_IN_DEGREES = everyday.collection(
    ("Polygon", SQUARE, {}), ("Point", [11.0008, 48.0008], {}), crs="OGC:1.3:CRS84"
)


def test_a_written_map_is_read_back_in_metres(tmp_path):
    from crosstrack.instances.grid_path import write_geojson_polygons

    path = write_geojson_polygons([[[4, 4], [6, 4], [5, 6]]], tmp_path / "walls.geojson")
    data = {"bounds": [0, 0, 10, 10], "cell": 1, "start": [0, 0], "goals": [9, 9]}
    assert ct.load(path, data=data).map.blocked.any()


def test_data_and_model_are_checked(tmp_path):
    file = everyday.write(named("room.map"), tmp_path)
    with pytest.raises(UnknownName, match="grid map of MovingAI can become"):
        ct.load(file, model="fleet-routing")
    with pytest.raises(InvalidData, match="unknown key 'goal'"):
        ct.load(file, data={"start": [0, 0], "goals": [2, 0], "goal": 1})
    with pytest.raises(InvalidData, match="unknown key 'find'"):
        ct.load(file, data={"start": [0, 0], "goals": [2, 0], "find": 1})
    with pytest.raises(UnsupportedOption, match="whole instance"):
        ct.load(everyday.write(named("line.sop"), tmp_path), data={"ids": []})
    for options in (
        {"data": "vehicles=2"},
        {"data": [("vehicles", 2)]},
        {"columns": 5},
        {"folder": 5},
    ):
        with pytest.raises(InvalidData, match=f"{next(iter(options))} must be a"):
            ct.load(file, **options)
    example = run("solve", file, code=2).stderr.splitlines()[1]
    assert "--as grid-path --data 'start=[0, 0]' --data 'goals=[9, 9]'" in example


def test_data_do_not_replace_the_content_of_a_file(tmp_path):
    for name, key, value in (
        ("stops.geojson", "points", [[0, 0], [1, 0]]),
        ("mission.geojson", "obstacles", []),
        ("route.geojson", "waypoints", [[0, 0], [1, 1], [2, 0]]),
        ("room.map", "map", {"blocked": ["..."]}),
        ("room.map.scen", "start", [1, 0]),
        ("scenes.txt", "blocked", [["..."]]),
        ("flight.csv", "times", [0, 1, 2]),
    ):
        file = named(name)
        words = pairs([word for word in file.options.split() if "=" in word], "--data")
        with pytest.raises(InvalidData, match=f"{key} must not be given: the file holds it"):
            ct.load(everyday.write(file, tmp_path), data={**words, key: value})
    path = everyday.write(named("scenes.txt"), tmp_path)
    with pytest.raises(InvalidData, match="unknown key 'zzz'"):
        ct.load(path, data={"view": [3, 3], "zzz": 1})
    with pytest.raises(UnknownName, match="can become"):
        ct.load(path, model="grid-path")


@pytest.mark.parametrize("suffix", [".map.scen", ".scen"])
def test_a_row_of_scenarios_is_required_and_checked(suffix, tmp_path):
    file = named("room.map.scen")
    row = file.content.partition("\n")[2]
    everyday.write(file, tmp_path)
    path = tmp_path / f"room{suffix}"
    path.write_text(f"version 1\n\n{row.replace('maps/', '')}{row}")
    with pytest.raises(InvalidData, match=r"one of its 2 rows(?s:.*)--data scenario=0"):
        ct.load(path)
    assert ct.load(path, data={"scenario": 1}).name == f"{path.stem}-1"
    for value in ("", False, [], "0", 2):
        with pytest.raises(InvalidData, match="scenario must be"):
            ct.load(path, data={"scenario": value})


def test_geojson_states_its_unit(tmp_path):
    path = tmp_path / "stops.geojson"
    path.write_text(POINTS_IN.format('"units": "chains",'))
    with pytest.raises(
        InvalidData, match='"units" must be one of metres, feet, us-feet, degrees, got'
    ):
        ct.load(path, data={"vehicles": 1})
    assert ct.load(path, data={"vehicles": 1, "units": "metres"}).points[1, 0] == 100.5
    with pytest.raises(InvalidData, match="units must be one of") as caught:
        ct.load(path, model="fleet-routing", data={"vehicles": 1, "units": "chains"})
    assert caught.value.field == "units"
    crs = '"crs": {{"type": "name", "properties": {{"name": {}}}}},'
    # China Geodetic Coordinate System 2000
    for name in (
        "urn:ogc:def:crs:EPSG::4490", "http://www.opengis.net/def/crs/EPSG/0/4490", "EPSG 4490", "CRS:84"
    ):  # fmt: skip
        path.write_text(POINTS_IN.format(crs.format(json.dumps(name))))
        fleet = ct.load(path, data={"vehicles": 1})
        assert np.ptp(fleet.points[:, 0]) == pytest.approx(42_697.6, rel=1e-4)
    link = '"crs": {"type": "link", "properties": {"href": "crs.prj"}},'
    for unnamed in (link, crs.format("null")):
        path.write_text(POINTS_IN.format(unnamed))
        with pytest.raises(InvalidData, match="coordinates may be degrees"):
            ct.load(path, data={"vehicles": 1})


def test_the_totals_of_a_spreadsheet_are_not_read_as_a_node(tmp_path):
    path = tmp_path / "kunden.csv"
    path.write_text("id;x;y\nA;0,5;1\nB;2;3,5\nSumme;2,5;4,5\n")
    with pytest.raises(InvalidData, match=r"line 4: 'Summe' must be a node, but .* totals: remove"):
        ct.load(path, data={"vehicles": 1})


def test_german_thousands_are_named_in_a_warning(tmp_path, caplog):
    path = tmp_path / "kunden.csv"
    path.write_text("id;x;y\nA;1.500;2.500\nB;2.500;3.500\n")
    assert ct.load(path, data={"vehicles": 1}).points[0].tolist() == [1.5, 2.5]
    assert "line 2, column x: '1.500' is read as 1.5" in caplog.text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('{"type": "Topology", "objects": {}, "arcs": []}', "TopoJSON, .* convert it to GeoJSON"),
        (
            '{"geometryType": "esriGeometryPoint", "features": []}',
            "ArcGIS .* convert it to GeoJSON",
        ),
        ('{"version": 0.6, "elements": []}', "Overpass: convert it to GeoJSON"),
        ('[{"x": 0, "y": 0}]', "is read as a whole instance: .* such as CSV or GeoJSON"),
    ],
)
def test_other_json_has_a_remedy(content, words, tmp_path):
    path = tmp_path / "points.json"
    path.write_text(content)
    with pytest.raises((InvalidData, UnsupportedOption), match=words):
        ct.load(path, data={"vehicles": 1})


def test_distances_of_tsplib_by_coordinates_are_rounded(tmp_path):
    text = "TYPE: TSP\nDIMENSION: 3\nEDGE_WEIGHT_TYPE: {}\nNODE_COORD_SECTION\n1 0 0\n2 3 4.4\n3 1 1.5\nEOF\n"
    path = tmp_path / "three.tsp"
    for kind, expected in (("MAN_2D", [7, 3, 5]), ("MAX_2D", [4, 2, 3])):
        path.write_text(text.format(kind))
        costs = ct.load(path, data={"vehicles": 1}).costs
        assert costs[[0, 0, 1], [1, 2, 2]].tolist() == expected
    path.write_text(text.format("SPECIAL"))
    with pytest.raises(InvalidData, match=r"EDGE_WEIGHT_TYPE must be .* as a matrix"):
        ct.load(path, data={"vehicles": 1})


def test_feet_are_converted_to_metres(tmp_path, caplog):
    path = tmp_path / "stops.geojson"
    shapes = [("Point", [980000, 200000], {}), ("Point", [983937, 200000], {})]
    for crs, metres in (
        ("EPSG::2263", 1200), ("ESRI::102718", 1200), ("EPSG::2222", 3937 * 0.3048),
        ("crs,crs:EPSG::2263,crs:EPSG::6360", 1200), ("EPSG::32618", 3937),
    ):  # fmt: skip
        path.write_text(everyday.collection(*shapes, crs=crs))
        caplog.clear()
        points = ct.load(path, data={"vehicles": 1}).points
        assert points[1, 0] - points[0, 0] == pytest.approx(metres, rel=1e-9)
        assert f"{crs} are read as" in caplog.text
    path.write_text(everyday.collection(*shapes, crs="EPSG::24370"))  # Indian yards
    with pytest.raises(InvalidData, match=r"EPSG::24370 must be .* degrees.*new.geojson .*stops"):
        ct.load(path, data={"vehicles": 1})
    assert ct.load(path, data={"vehicles": 1, "units": "feet"}).points[0, 0] == 980000 * 0.3048
    areas = everyday.collection(("Polygon", everyday.SQUARE, {}), units="us-feet")
    path.write_text(areas)
    ends = {"start": [0, 0], "goals": [2, 2]}
    grid = ct.load(path, data={"bounds": [0, 0, 10, 10], "cell": 1, **ends}).map
    assert grid.shape == (4, 4)  # 10 ft are 3.05 m


def test_units_of_reference_systems_are_those_of_pyproj():
    pyproj = pytest.importorskip("pyproj", reason="the codes are compared with pyproj")
    for authority in ("EPSG", "ESRI"):
        entries = pyproj.database.query_crs_info(auth_name=authority, allow_deprecated=True)
        for entry in entries[::70]:
            system = pyproj.CRS.from_authority(authority, entry.code)
            plane = system.sub_crs_list[0] if system.is_compound else system
            if plane.is_geocentric or plane.is_vertical or len(plane.axis_info) < 2:
                continue
            factor = plane.axis_info[0].unit_conversion_factor
            unit = _unit_of(f"urn:ogc:def:crs:{authority}::{entry.code}")
            if plane.is_geographic:
                expected = "degrees" if plane.axis_info[0].unit_name == "degree" else "other"
            else:
                names = (name for name, scale in _LENGTHS.items() if abs(scale - factor) < 1e-9)
                expected = next(names, "other")
            assert unit == expected or unit == "mercator", entry


@pytest.mark.parametrize("crs", ["EPSG::3857", "ESRI::102100"])
def test_web_mercator_is_projected_from_its_degrees(crs, tmp_path):
    """Its metres are longer than those on the ground, by half at 48° north."""
    degrees = [(11.5, 48.0), (11.6, 48.1)]
    metres = [
        [np.radians(x) * 6378137.0, np.arctanh(np.sin(np.radians(y))) * 6378137.0]
        for x, y in degrees
    ]
    path = tmp_path / "tiles.geojson"
    shapes = [("Point", place, {}) for place in metres]
    path.write_text(everyday.collection(*shapes, crs=crs))
    points = ct.load(path, data={"vehicles": 1}).points
    expected = project_positions([48.0, 48.1], [11.5, 11.6])
    assert points == pytest.approx(expected, abs=1e-6)


def test_demands_of_geojson_points_are_read(tmp_path):
    shapes = [("Point", [k, k], {"demand": k}) for k in range(3)]
    path = tmp_path / "stops.geojson"
    path.write_text(everyday.collection(*shapes, units="metres"))
    data = {"vehicles": 1, "capacity": 3}
    assert ct.load(path, data=data).demands.tolist() == [0, 1, 2]
    assert ct.load(path, data={**data, "demands": [0, 2, 1]}).demands.tolist() == [0, 2, 1]
    with pytest.raises(InvalidData, match="capacity must be given together with demands"):
        ct.load(path, data={"vehicles": 1})
    path.write_text(everyday.collection(*shapes, ("Point", [3, 3], {}), units="metres"))
    with pytest.raises(InvalidData, match=r"demands\[3\] must be a number, got None"):
        ct.load(path, data=data)


def test_a_feature_per_line_has_a_remedy(tmp_path):
    path = tmp_path / "stops.geojsonl"
    place = {"type": "Point", "coordinates": [1, 2]}
    lines = [{"type": "Feature", "properties": {}, "geometry": place}] * 2
    path.write_text("\n".join(map(json.dumps, lines)))
    with pytest.raises(InvalidData, match=r"Extra data: .* ogr2ogr -f GeoJSON converts"):
        ct.load(path, data={"vehicles": 1})


POINTS_IN = '{{"type": "MultiPoint", {} "coordinates": [[100, 40], [100.5, 40]]}}'


def test_longitudes_up_to_360_may_be_degrees(tmp_path):
    shape = {"type": "MultiPoint", "coordinates": [[190.0, 10.0], [190.1, 10.0], [190.0, 10.1]]}
    file = tmp_path / "pacific.geojson"
    file.write_text(json.dumps(shape), "utf-8")
    with pytest.raises(InvalidData, match="coordinates may be degrees"):
        ct.load(file, data={"vehicles": 1}, model="fleet-routing")


def test_geojson_is_recognised_if_it_is_longer_than_the_head(tmp_path):
    path = tmp_path / "layer.json"
    points = [("Point", [k, 1], {}) for k in range(1000)]
    path.write_text(
        json.dumps(json.loads(everyday.collection(*points, units="metres")), sort_keys=True)
    )
    assert path.stat().st_size > 1 << 16
    assert len(ct.load(path, data={"vehicles": 1}, model="fleet-routing").points) == 1000
    areas = [("Polygon", everyday.SQUARE, {})] * 600
    path.write_text(everyday.collection(*areas, *points[:3], units="metres"))
    data = {"bounds": [0, 0, 10, 10], "vehicles": 1, "depot": [9, 9]}
    assert len(ct.load(path, data=data).nodes) == 3
    path.write_text(everyday.collection(*areas, units="metres"))
    with pytest.raises(InvalidData, match=r"'nodes' is missing(?s:.*)--data 'nodes="):
        ct.load(path, data=data)


def test_empty_and_compressed_files_are_named(tmp_path):
    for name in ("a.map", "a.tsp", "a.txt", "a.geojson"):
        path = tmp_path / name
        path.write_bytes(b"")
        with pytest.raises(InvalidData, match=f"{name}: the file is empty"):
            ct.load(path)
    for name in ("room.map", "nodes.txt", "fleet.json"):
        path = tmp_path / f"{name}.gz"
        path.write_bytes(gzip.compress(named(name).content.encode()))
        data = pairs([word for word in named(name).options.split() if "=" in word], "--data")
        with pytest.raises(InvalidData, match=r"gz: compressed with gzip.* gunzip$"):
            ct.load(path, data=data)


def test_a_registered_format_is_read_first(tmp_path, monkeypatch):
    from crosstrack.instances import formats

    monkeypatch.setattr(formats, "_SESSION", {})

    def read_stops(path, vehicles):
        numbers = path.read_text("utf-8").split()[1:]
        return FleetRouting(vehicles, points=[[float(x), 0.0] for x in numbers])

    stops = Target(read_stops, {"vehicles": "2"})
    register_format(FileFormat("stops", "stops on a line", {"fleet-routing": stops}, r"\Astops\b"))
    path = tmp_path / "any.csv"
    path.write_text("stops 0 1 2")
    assert ct.load(path, data={"vehicles": 1}).name == "any"
    with pytest.raises(InvalidData, match="stops on a line, which lacks data"):
        ct.load(path)
    with pytest.raises(InvalidData, match="unknown key 'speed'"):
        ct.load(path, data={"vehicles": 1, "speed": 2})
    for fields, words in (
        ({}, "targets, or a remedy"),
        ({"targets": {"fleet-routing": read_stops}}, "a mapping of models to Target"),
        ({"remedy": "none", "content": "("}, "must be a regular expression"),
        ({"remedy": "none", "suffixes": ".x"}, "must be a tuple of str"),
    ):
        with pytest.raises(InvalidData, match=words):
            FileFormat("other", "stops", **fields)


def test_the_table_of_formats_names_models_and_readers():
    from crosstrack.models.problems import resolve

    kinds = set()
    for form in file_formats():
        for kind, target in form.targets.items():
            assert callable(resolve(target.reader)), form.name
            kinds.add(kind)
            for text in {**target.needs, **target.may}.values():
                assert text == "metres" or json.loads(text) is not None
    assert kinds - {""} <= set(model_types())


def damaged(number):
    """Return a file of a newcomer, damaged by a seed."""
    draw = random.Random(number)
    files = [file for file in everyday.FILES if file.content is not None]
    file = files[number % len(files)]
    content = file.content if isinstance(file.content, bytes) else file.content.encode()
    try:
        content = strange.damaged(content, draw)
    except UnicodeDecodeError:  # a way for text only
        content = content[: draw.randrange(len(content))]
    return file._replace(content=content)


def judge(numbers, folder):
    """Return how many damaged files became models and how many were refused."""
    models = refused = 0
    for number in numbers:
        file = damaged(number)
        message = ""
        try:
            load(file, folder)
            models += 1
        except UnknownName:
            refused += 1
        except (InvalidData, UnsupportedFormulation, UnsupportedOption, BackendMissing) as error:
            refused, message = refused + 1, str(error)
        assert not message or str(folder / file.name) in message, number
    return models, refused


def test_damaged_files_are_refused_by_name(tmp_path):
    models, refused = judge(range(250), tmp_path)
    assert models > 20
    assert refused > 100


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path):
    models, refused = judge(range(2000), tmp_path)
    print(f"{models} models, {refused} refused")
    assert models > 200
    assert refused > 1000


def test_content_decides_before_the_suffix(tmp_path):
    for name, form in (
        ("fleet.json", "instance"),
        ("room.map", "movingai-map"),
        ("model.lp", "program.lp"),
    ):
        path = tmp_path / "wrong.sop"
        path.write_text(named(name).content)
        assert recognise(path).name == form
    path.write_text("nothing of this kind")
    assert recognise(path).name == "sop"
    path = path.rename(tmp_path / "words.bin")
    assert recognise(path) is None
    with pytest.raises(InvalidData, match="its format is unknown; convert it"):
        ct.load(path)


@pytest.mark.parametrize(
    "part", [" ", "\n", "\t\n", "TYPE : ", "VEHICLE\n", "<?x", "a,", "{", "0 0 0\n"]
)
def test_recognition_is_linear_in_the_size_of_the_file(part, tmp_path):
    path = tmp_path / "long"
    path.write_text(part * (65_000 // len(part)))
    begin = time.process_time()
    recognise(path)
    assert time.process_time() - begin < 0.8  # a quadratic pattern took 1.8 s
