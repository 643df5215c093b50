"""VRPLIB files of every dialect: small texts, and the public files with their published solutions."""

import re
from pathlib import Path

import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.instances.fleet import read_vrplib
from crosstrack.models.fleet.features import features_of

PUBLIC = Path(__file__).resolve().parents[3] / "shared" / "data" / "fleet-vrplib"
FILES = [path for path in sorted(PUBLIC.rglob("*")) if path.suffix in (".vrp", ".txt")]
#: Folders with instances of up to 1,000 customers. The fast tests read the first two files of each.
LARGE = {path.parent for path in FILES if "_10_" in path.name}
FIRST = [
    path for folder in sorted(LARGE) for path in [one for one in FILES if one.parent == folder][:2]
]
#: Options of the reader, and units of the published cost per metre, by class.
CLASSES = {
    "CVRP": ({"rounded": True}, 1.0), "VRPB": ({"rounded": True}, 1.0), "VRPTW": ({"decimals": 1}, 1.0),
    "PCVRPTW": ({"decimals": 1}, 10.0), "MTVRPTWR": ({"decimals": 1}, 10.0), "MDVRPTW": ({}, 1000.0),
    "SDVRPTW": ({}, 1000.0), "HFVRP": ({}, None), "RC208": ({"decimals": 1}, 1.0), "X115-HVRP": ({}, None),
}  # fmt: skip
#: Features of the files without a solution.
SMALL = {
    "C201R0.25.vrp": "service windows releases reloads",
    "E-n22-k4.txt": "",
    "OkSmall.txt": "service windows",
    "OkSmallAllowedClients.txt": "service windows requires skills",
    "OkSmallMaxDistance.txt": "",
    "OkSmallMultipleDepots.txt": "service windows",
    "OkSmallMultipleLoad.txt": "service windows dimensions",
    "OkSmallMutuallyExclusiveGroups.txt": "service windows groups",
    "OkSmallPrizes.txt": "service windows prizes cost",
    "OkSmallReleaseTimes.txt": "service windows releases",
    "PR01.vrp": "service windows requires skills max_duration",
    "PR11A.vrp": "service windows max_duration",
    "SmallShipments.txt": "service windows pickups pairs",
    "SmallVRPSPD.vrp": "pickups",
    "X-n101-50-k13.vrp": "pickups backhauls",
    "lrc206.vrp": "service windows pickups pairs",
    "p06-2-50.vrp": "prizes cost",
}


def read_solution(path):
    """Return the routes of a solution, with 0 for a reload at the depot, and its cost."""
    rows, cost = [], None
    for line in path.read_text().splitlines():
        if match := re.match(r"Route #\d+:(.*)", line):
            rows.append([int(word) for word in match[1].split()])
        elif match := re.match(r"Cost:?\s+(\S+)", line):
            cost = float(match[1])
    return rows, cost


@pytest.mark.skipif(not FILES, reason="../shared/data/fleet-vrplib is absent")
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(
            path,
            id=path.name,
            marks=[pytest.mark.slow] * (path.parent in LARGE and path not in FIRST),
        )
        for path in FILES
    ],
)
def test_public_files_have_their_features_and_published_costs(path):
    solution = path.with_suffix(".sol")
    if not solution.exists():
        model = read_vrplib(path, use_all=False)
        assert features_of(model) == set(SMALL[path.name].split())
        assert model.with_schedule([model.customers.tolist()] + [[]] * (model.vehicles - 1)).routes
        return
    routes, cost = read_solution(solution)
    options, unit = CLASSES[path.parent.name if path.parent.name in CLASSES else path.stem]
    vehicles = None if re.search("^VEHICLES", path.read_text(), re.M) else len(routes)
    model = read_vrplib(path, vehicles, use_all=False, **options)
    plan = model.with_schedule([*routes, *[[]] * (model.vehicles - len(routes))])
    verified = model.verify(plan)
    assert verified.ok, str(verified)
    value = verified.objective
    if model.prizes is not None:  # the published costs count the prizes that are not collected
        value += float(np.nansum(model.prizes))
    if unit is None:  # published in hundreds or in thousandths
        unit = 0.01 if cost < value else 1000.0
    # Published costs are sums of rounded distances, except where the reader rounds in the same way.
    arcs = sum(len(route) + 1 for route in routes)
    accuracy = 1e-6 if options else 5e-4 * arcs * (1 if model.distance_cost is None else 100)
    assert value == pytest.approx(cost / unit, rel=1e-9, abs=max(accuracy, 0.006 / unit))


HEAD = "NAME: a\nDIMENSION: 4\nEDGE_WEIGHT_TYPE: EUC_2D\nVEHICLES: 2\nCAPACITY: 10\n"
NODES = "NODE_COORD_SECTION\n1 0 0\n2 3 1\n3 4 5\n4 -5 0\n"
DEPOT = "DEPOT_SECTION\n1\n-1\nEOF\n"


def read(tmp_path, body, head="", kind="VRPTW", depot=DEPOT, **options):
    path = tmp_path / "a.vrp"
    path.write_text(f"TYPE: {kind}\n{HEAD}{head}{NODES}{body}{depot}")
    return read_vrplib(path, **options)


def test_reads_every_section(tmp_path):
    body = (
        "DEMAND_SECTION\n1 0\n2 1\n3 2\n4 3\nBACKHAUL_SECTION\n1 0\n2 1\n3 0\n4 2\n"
        "TIME_WINDOW_SECTION\n1 0 99\n2 1 9\n3 2 8\n4 3 7\nRELEASE_TIME_SECTION\n1 0\n2 1\n3 2\n4 3\n"
        "# a remark\nPRIZE_SECTION\n1 0\n2 4\n3 0\n4 0\nMUTUALLY_EXCLUSIVE_GROUP_SECTION\n1 3 4\n2 2\n"
        "VEHICLES_RELOAD_DEPOT_SECTION\n1 1\n2 1\nVEHICLES_MAX_RELOADS_SECTION\n1 1\n2 0\n"
        "VEHICLES_ALLOWED_CLIENTS_SECTION\n1 2 3\n2 2 3 4\nVEHICLES_FIXED_COST_SECTION\n1 5\n2 6\n"
    )
    head = (
        "SERVICE_TIME: 2\nVEHICLES_MAX_DISTANCE: 30\nVEHICLES_MAX_DURATION: 40\n"
        "VEHICLES_UNIT_DISTANCE_COST: 3\n"
    )
    model = read(tmp_path, body, head)
    assert model.service.tolist() == [0, 2, 2, 2]
    assert model.windows[3] == ((3, 7),)
    assert model.releases.tolist() == [0, 1, 2, 3]
    assert model.pickups.tolist() == [0, 1, 0, 2]
    assert not model.backhauls
    assert model.data()["prizes"] == [None, 4, None, None]
    assert model.groups == ((2, 3),)
    assert (model.reloads, model.max_reloads.tolist()) == ((0,), [1, 0])
    assert model.requires == ((), (), (), ("site 1",))
    assert model.skills == ((), ("site 1",))
    assert model.fixed_cost.tolist() == [5, 6]
    assert model.distance_cost.tolist() == [3, 3]
    assert model.battery.tolist() == [30, 30]
    assert model.max_duration.tolist() == [40, 40]
    assert str(model.objective) == "cost"


def test_reads_pairs_and_limits_on_durations(tmp_path):
    rows = "PICKUP_AND_DELIVERY_SECTION\n1 0 0 99 0 0 0\n2 5 1 9 2 0 3\n3 -5 2 80 2 2 0\n"
    model = read(tmp_path, f"{rows}4 0 0 99 1 0 0\n", kind="PDPTW")
    assert model.pairs.tolist() == [[1, 2]]
    assert model.pickups.tolist() == [0, 5, 0, 0]
    assert model.windows[2] == ((2, 80),)
    with pytest.raises(InvalidData, match="PICKUP_AND_DELIVERY_SECTION must pair node 2"):
        read(tmp_path, f"{rows.replace('2 2 0', '2 4 0')}4 0 0 99 1 0 0\n", kind="PDPTW")
    for old, new in (("3 -5", "3 -4"), ("4 0 0 99 1 0 0", "4 0 0 99 1 2 0"), ("0 3\n", "0 2.5\n")):
        body = f"{rows}4 0 0 99 1 0 0\n".replace(old, new)
        with pytest.raises(InvalidData, match="PICKUP_AND_DELIVERY_SECTION must"):
            read(tmp_path, body, kind="PDPTW")
    windows = "TIME_WINDOW_SECTION\n1 0 99\n2 1 9\n3 2 80\n4 0 98\n"
    with pytest.raises(InvalidData, match="TIME_WINDOW_SECTION must equal the windows"):
        read(tmp_path, f"{windows}{rows}4 0 0 99 1 0 0\n", kind="PDPTW")
    demands = "DEMAND_SECTION\n1 0\n2 1\n3 2\n4 3\n"
    model = read(tmp_path, demands, "DISTANCE: 50\nSERVICE_TIME: 5\n", kind="CVRP")
    assert model.max_duration.tolist() == [50, 50]
    assert model.battery is None


def test_truncates_distances_after_decimals(tmp_path):
    demands = "DEMAND_SECTION\n1 0\n2 1\n3 2\n4 3\n"
    assert read(tmp_path, demands, decimals=1).costs[0].tolist() == [0, 3.1, 6.4, 5]
    assert read(tmp_path, demands, decimals=0).costs[0].tolist() == [0, 3, 6, 5]
    assert read(tmp_path, demands, decimals=0).points is not None
    with pytest.raises(InvalidData, match="decimals must not be given beside rounded"):
        read(tmp_path, demands, decimals=1, rounded=True)
    with pytest.raises(InvalidData, match="decimals must be >= 0"):
        read(tmp_path, demands, decimals=-1)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("VEHICLES_DEPOT_SECTION\n1 1\n2 3\n", "must name nodes of DEPOT_SECTION"),
        ("VEHICLES_DEPOT_SECTION\n1 1\n2 1\n", "must use every depot, got none at node 2"),
        ("VEHICLES_RELOAD_DEPOT_SECTION\n1 1\n2 2\n", "DEPOT_SECTION must"),
    ],
)
def test_several_depots_belong_to_vehicles(body, message, tmp_path):
    depots = "DEPOT_SECTION\n1\n2\n-1\nEOF\n"
    with pytest.raises(InvalidData, match=message):
        read(tmp_path, "DEMAND_SECTION\n1 0\n2 0\n3 2\n4 3\n" + body, depot=depots)


@pytest.mark.parametrize("key", ["VEHICLES_FIXED_COST", "SERVICE_TIME"])
def test_a_number_and_its_section_are_refused_together(key, tmp_path):
    body = f"DEMAND_SECTION\n1 0\n2 1\n3 2\n4 3\n{key}_SECTION\n1 1\n2 1\n"
    with pytest.raises(InvalidData, match=f"{key}_SECTION must not be given beside {key}"):
        read(tmp_path, body, f"{key}: 5\n")


def test_a_depot_with_a_decimal_point_has_no_service(tmp_path):
    demands = "DEMAND_SECTION\n1 0\n2 1\n3 2\n4 3\n"
    model = read(tmp_path, demands, "SERVICE_TIME: 2\n", depot="DEPOT_SECTION\n2.0\n-1\nEOF\n")
    assert model.service.tolist() == [2, 0, 2, 2]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("TIME_WINDOW_SECTION\n1 0 99\n2 9 1\n3 2 8\n4 3 7\n", r"windows\[1\] must begin"),
        ("TIME_WINDOW_SECTION\n1 0\n2 1\n3 2\n4 3\n", "TIME_WINDOW_SECTION must hold 4 × 2"),
        ("SERVICE_TIME_SECTION\n1 0\n2 -1\n3 2\n4 3\n", r"service\[1\] must be >= 0"),
        ("VEHICLES_ALLOWED_CLIENTS_SECTION\n1 2 3\n", "must have 2 rows, got 1"),
        ("VEHICLES_ALLOWED_CLIENTS_SECTION\n1 2 3\n2 9\n", r"must hold nodes 1 … 4 after row 2"),
        ("VEHICLES_RELOAD_DEPOT_SECTION\n1 1\n2 2\n", "must be the same for all vehicles"),
        ("PRIZE_SECTION\n1 0\n2 4\n3 5\n4 0\nMUTUALLY_EXCLUSIVE_GROUP_SECTION\n1 2 3\n", "with prizes"),
        ("CAPACITY_SECTION\n1 5\n2 5\n", "must not be given beside CAPACITY"),
        ("LINEHAUL_SECTION\n1 0\n2 0\n3 0\n4 0\n", "must not be given beside DEMAND_SECTION"),
        ("OPEN_ROUTE_SECTION\n1\n", "'OPEN_ROUTE_SECTION' is not supported"),
    ],
)  # fmt: skip
def test_bad_sections_are_named(body, message, tmp_path):
    with pytest.raises(InvalidData, match=message):
        read(tmp_path, "DEMAND_SECTION\n1 0\n2 1\n3 2\n4 3\n" + body)
