"""Files as other tools write them, and the command that a newcomer types for each.

As a script, it solves each file on the command line and prints what happens.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from commands import run

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

#: Words of a message that tell the user what to do next.
REMEDY = (
    r"crosstrack (check|solve) |--data |--as |--columns|ogr2ogr|export |convert|save (it|the)|"
    r"write the|solve the instance|no model of crosstrack"
)


class File(NamedTuple):
    """File of a newcomer.

    Parameters
    ----------
    name : str
        Its name, or its path in the folder of public data.
    content : str, bytes or None
        None for a file of the public data.
    options : str
        Options of the command.
    kind : str
        Kind of the model that it becomes; empty if a message with a remedy ends the command, and
        ``"?"`` if both are right (tables in other units).
    words : str
        Pattern of the message.
    beside : mapping of str to str or bytes
        Other files in its folder.
    """

    name: str
    content: str | bytes | None
    options: str = ""
    kind: str = ""
    words: str = REMEDY
    beside: dict[str, str | bytes] = {}


def collection(*features: tuple[str, Any, dict[str, Any]], crs: str = "", **more: Any) -> str:
    """Return a FeatureCollection in the form that QGIS writes."""
    head: dict[str, Any] = {"type": "FeatureCollection", "name": "layer", **more}
    if crs:
        head["crs"] = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:{crs}"}}
    head["features"] = [
        {
            "type": "Feature",
            "properties": {"fid": k, **properties},
            "geometry": {"type": kind, "coordinates": coordinates},
        }
        for k, (kind, coordinates, properties) in enumerate(features, 1)
    ]
    return json.dumps(head)


UTM = "EPSG::32632"
STOPS = [[500000.0 + 7 * k, 5300000.0 + k * k % 11] for k in range(5)]
SQUARE = [[[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]]]
POINTS = collection(*(("Point", at, {"name": f"stop {k}"}) for k, at in enumerate(STOPS)), crs=UTM)
AREAS = collection(("MultiPolygon", [SQUARE], {"height": 3}), crs=UTM)
MISSION = collection(
    ("Polygon", SQUARE, {}),
    ("Point", [1, 1], {"depot": True}),
    *(("Point", at, {}) for at in ([8, 8], [8, 2])),
    units="metres",
)
DEGREES = collection(
    *(("Point", [11.57 + k / 1000, 48.13], {"amenity": "cafe"}) for k in range(4)),
    generator="overpass-turbo",
)
ROUTE = json.dumps(
    {"type": "LineString", "units": "metres", "coordinates": [[0, 0, 1], [4, 0, 2], [5, 3, 1]]}
)
CELLS = np.array([[254, 254, 254, 205], [0, 0, 254, 254], [254, 254, 254, 254]], np.uint8)
PGM = b"P5\n# CREATOR: map_saver 0.050 m/pix\n4 3\n255\n" + CELLS.tobytes()
ROS = (
    "image: {}\nresolution: 0.050000\norigin: [-10.0, -5.0, 0.000000]\nnegate: {}\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\n\n"
)
NAV2 = (
    "image: room.pgm\nmode: trinary\nresolution: 0.05\norigin:\n- -10.0\n- -5.0\n- 0\nnegate: 0\n"
)
ENDS = "--data start=[0,0] --data goals=[2,0]"
MAP = "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n....\n"
SCENARIO = "version 1\n0\tmaps/room.map\t4\t3\t0\t0\t3\t2\t4.0\n"
CVRP = (
    "NAME : toy-n4-k2\nCOMMENT : (none)\nTYPE : CVRP\nDIMENSION : 4\nEDGE_WEIGHT_TYPE : EUC_2D\n"
    "CAPACITY : 5\nNODE_COORD_SECTION\n1 0 0\n2 3 0\n3 0 4\n4 1 1\nDEMAND_SECTION\n1 0\n2 3\n3 2\n4 2\n"
    "DEPOT_SECTION\n 1\n -1\nEOF\n"
)
EXPLICIT = (
    "NAME: four\nTYPE: TSP\nDIMENSION: 4\nEDGE_WEIGHT_TYPE: EXPLICIT\nEDGE_WEIGHT_FORMAT: UPPER_ROW\n"
    "EDGE_WEIGHT_SECTION\n1 2 3\n4 5\n6\nEOF\n"
)
SOP = (
    "NAME: line\nTYPE: SOP\nDIMENSION: 4\nEDGE_WEIGHT_TYPE: EXPLICIT\nEDGE_WEIGHT_FORMAT: FULL_MATRIX\n"
    "EDGE_WEIGHT_SECTION\n4\n0 2 5 1000000\n-1 0 3 2\n-1 -1 0 5\n-1 -1 -1 0\nEOF\n"
)
SOLOMON = (
    "C101\n\nVEHICLE\nNUMBER     CAPACITY\n  25         200\n\nCUSTOMER\nCUST NO.  XCOORD.   YCOORD.    DEMAND   "
    "READY TIME  DUE DATE   SERVICE   TIME\n \n    0      40         50          0          0       1236          0\n"
    "    1      45         68         10        912        967         90\n    2      45         70         30        825        870         90\n"
)
RCSP = "4 5 1\n0\n9\n0\n1\n2\n0\n1 2 5 3\n1 3 4 1\n2 4 3 4\n3 4 9 2\n1 4 30 0\n"
LP = "\\ written by a modeller\nMinimize\n obj: 2 x + 3 y\nSubject To\n c1: x + y >= 2\nBounds\n x <= 1\nEnd\n"
MPS = "NAME tiny\nROWS\n N cost\n G lim\nCOLUMNS\n x cost 1.0 lim 1.0\nRHS\n RHS lim 2.0\nENDATA\n"
POLY7 = ",".join(["duration", *(f"{a}^{k}" for a in ("x", "y", "z", "yaw") for k in range(8))])
FLEET = '{"model": "fleet-routing", "data": {"vehicles": 1, "points": [[0, 0], [1, 0], [1, 1]]}}'
GPX = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="Garmin"><wpt lat="48.1" lon="11.5"/></gpx>\n'
SERIES = "time [ms],x [m]\n" + "".join(f"{10 * k},{np.sin(k / 5):.6f}\n" for k in range(400))
TABLE = "--data units=metres"  # no option of tables: only GeoJSON has it

FILES = (
    File("stops.geojson", POINTS, "--data vehicles=2", "fleet-routing"),
    File("stops.geojson", POINTS, "", "", r"--as fleet-mission(?s:.*)--as minimum-snap"),
    File("stops.json", POINTS, "--as messenger-tour --data radius=2", "messenger-tour"),
    File("areas.geojson", AREAS, f"--data bounds=[0,0,10,10] --data cell=1 {ENDS}", "grid-path"),
    File("mission.geojson", MISSION, "--data bounds=[0,0,10,10] --data vehicles=1", "fleet-mission"),
    File("cafes.geojson", DEGREES, "--data vehicles=2", "", "may be degrees"),
    File("cafes.geojson", DEGREES, "--data vehicles=2 --data units=degrees", "fleet-routing"),
    File("route.geojson", ROUTE, "--data times=[0,1,2]", "minimum-snap"),
    File("room.yaml", ROS.format("room.pgm", 0), ENDS, "grid-path", beside={"room.pgm": PGM}),
    File("room2.yaml", NAV2, ENDS, "grid-path", beside={"room.pgm": PGM}),
    File("dark.yaml", ROS.format("dark.pgm", 1), "--data start=[1,0] --data goals=[1,1]", "grid-path", beside={"dark.pgm": PGM}),
    File("room.pgm", PGM, ENDS, "grid-path", beside={"room.yaml": ROS.format("room.pgm", 0)}),
    File("room.map", MAP, ENDS, "grid-path"),
    File("room.map.scen", SCENARIO, "", "grid-path", beside={"room.map": MAP}),
    File("room.txt", "....\n.@@.\n....\n", ENDS, "grid-path"),
    File("scenes.txt", "S....\n.@@..\n....T\n", "--data view=[3,3]", "unknown-grid"),
    File("movingai/arena.map.scen", None, "--data scenario=9", "grid-path"),
    File("mapf/empty-16-16-random-1.scen", None),
    File("toy-n4-k2.vrp", CVRP, "", "fleet-routing"),
    File("fleet-vrplib/small/OkSmall.txt", None, "", "fleet-routing"),
    File("fleet-vrplib/CVRP/X-n101-k25.sol", None),
    File("four.tsp", EXPLICIT, "--data vehicles=1", "fleet-routing"),
    File("tsplib/berlin52.tsp", None),
    File("line.sop", SOP, "", "guided-path-tour"),
    File("sop/br17.10.sop", None, "", "sequential-ordering"),
    File("c101.txt", SOLOMON, "", "fleet-routing"),
    File("dtspn/dtspn-06-01-025-0.txt", None, "", "messenger-tour"),
    File("paths.txt", RCSP, "", "resource-routing"),
    File("rcsp/rcsp1.txt", None, "", "resource-routing"),
    File("rcsp/toy.txt", None, "", "resource-routing"),
    File("model.lp", LP, "", "mixed-integer-program"),
    File("model.txt", MPS, "", "mixed-integer-program"),
    File("flight.csv", POLY7 + "\n1" + ",0" * 32 + "\n2" + ",0" * 32 + "\n", "", "minimum-snap"),
    File("minimum-snap/uav_trajectories__waypoints1.csv", None, "", "?", "times"),
    File("sideslip/stanford-250lm-first-half.csv", None, "", "?"),
    File("series.csv", SERIES, "", "attractor"),
    File("google.csv", "WKT,Name,Latitude,Longitude\n,A,48.1,11.5\n,B,48.2,11.6\n,C,48.3,11.4\n", "--data vehicles=1", "?"),
    File("px4.csv", "timestamp,x,y,z,vx,vy,vz\n1000,0,0,0,0,0,0\n2000,1,0,0,1,0,0\n3000,2,1,0,0,0,0\n", "", "?"),
    File("excel.csv", "id;x;y\nA;0,5;1\nB;2;3,5\nC;4;4\n", "--data vehicles=1", "?"),
    File("nodes.txt", "x,y\n0,0\n1,1\n2,0\n", "--data vehicles=1", "fleet-routing"),
    File("fleet.json", FLEET, "", "fleet-routing"),
    File("plan.json", '{"routes": [[1, 2]]}', "", "", "crosstrack check INSTANCE"),
    File("walk.gpx", GPX),
    File("mission.waypoints", "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t48.1\t11.5\t30\t1\n"),
    File("log.ulg", b"ULog\x01\x12\x35\x01" + bytes(32)),
    File("old.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(64)),
    File("model.pkl", b"\x80\x04\x95\x0b\x00."),
)  # fmt: skip


def write(file: File, folder: Path) -> Path:
    """Write a file and those beside it into a folder, and return its path."""
    if file.content is None:
        return DATA / file.name
    for name, content in {**file.beside, file.name: file.content}.items():
        raw = content.encode() if isinstance(content, str) else content
        (folder / name).write_bytes(raw)
    return folder / file.name


def outcome(file: File, folder: Path, command: str = "solve", *more: str) -> tuple[str, str]:
    """Return the kind of the model and the ending, or an empty string and the message of the command."""
    words = [command, *(["--for"] if command == "backends" else []), str(write(file, folder))]
    done = run(*words, *file.options.split(), "--json", *more, code=None)
    if done.returncode in (0, 3, 4):
        record = json.loads(done.stdout)
        return record["model"], record["termination"]
    return "", f"exit {done.returncode}: {done.stderr}"


if __name__ == "__main__":
    import tempfile

    for file in FILES:
        with tempfile.TemporaryDirectory() as name:
            if file.content is None and not (DATA / file.name).exists():
                print(f"{file.name}: not here")
                continue
            kind, words = outcome(file, Path(name), "solve", "--time-limit", "2", *sys.argv[1:])
            print(f"{file.name} {file.options} -> {kind or 'message'}: {words.replace(name, '')}")
