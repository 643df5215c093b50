"""Algorithm 1, eq. 14, 17 and 23-25 and Table 3 of the paper, worked by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from fleet_mission.missions import box, flown, small

import crosstrack as ct
from crosstrack.instances.fleet_mission import table_3_mission
from crosstrack.instances.fleet_mission.table_3 import GRID, SMOOTHED, TABLE_3, measure_table_3
from crosstrack.models import FleetMission, Trajectory
from crosstrack.models.fleet_mission import MissionPlan
from crosstrack.solvers.fleet_mission.energies import leg_energies


def test_energies_by_hand():
    """Node 0 is 3 m and 4 m off the depot and in sight; node 1 is behind a wall; they see each other."""
    mission = FleetMission(
        [box(2, 0, 3, 2)], (0, 0, 7, 7), [[3.5, 4.5], [4.5, 0.5]], (0.5, 0.5), 1, cell=1.0
    )
    # Depot and node 1 are 4 m apart on one row: eq. 17 is 1, and the path goes up 2 rows and back.
    one = np.hypot(1, 4)
    for reading, (first, second, between) in {
        "direct": (5, 4, one), "manhattan": (7, 4, 5), "paths": (7, 8, 5)
    }.items():  # fmt: skip
        expected = [[0, first, second], [first, 0, between], [second, between, 0]]
        np.testing.assert_allclose(leg_energies(mission, reading), expected, rtol=1e-12)
    # A wall between depot and node 0 as well: 5 m x 7 / 5 (eq. 14 and 17).
    walled = FleetMission(
        [box(1, 2, 3, 3)], (0, 0, 7, 7), [[3.5, 4.5]], (0.5, 0.5), 1, cell=1.0
    )  # fmt: skip
    assert leg_energies(walled, "direct")[0, 1] == pytest.approx(7)


def test_a_plan_that_keeps_equations_23_to_25_alone():
    """Legs 7 t^3 - 21 t^5 + 21 t^6 - 6 t^7: velocity and acceleration 0 at both ends, jerk 42 L / T^3."""
    mission = small(continuity=2, vehicles=1, nodes=[[8, 1]])
    powers = np.array([0, 0, 0, 7, 0, -21, 21, -6.0])
    there = np.zeros((2, 8, 2))
    there[:, :, 0] = 7 * np.outer([1, -1], powers)
    there[:, 0] += [[1, 1], [8, 1]]
    curve = Trajectory([0.0, 20, 40], there)
    plan = MissionPlan([[0]], [curve], [[20.0]])
    found = mission.verify(plan)
    assert found.ok, found
    assert found.objective == pytest.approx(14)
    assert {one.equation for one in found.checks} == {"", "23", "24", "25"}
    assert not any("jerk" in one.name for one in found.checks)
    strict = small(vehicles=1, nodes=[[8, 1]])
    violated = {one.name: one for one in strict.verify(plan).violated}
    assert set(violated) == {"jerk 0 at both ends", "continuity of jerk"}
    assert violated["jerk 0 at both ends"].worst == pytest.approx(42 * 7 / 20**3)
    assert violated["continuity of jerk"].worst == pytest.approx(2 * 42 * 7 / 20**3)
    assert {one.equation for one in violated.values()} == {""}
    assert strict != mission
    assert strict.digest == small(vehicles=1, nodes=[[8, 1]], continuity=3).digest
    rest = flown([[1, 1], (0, [8, 1])])
    assert mission.verify(rest).ok and strict.verify(rest).ok


@pytest.mark.parametrize("continuity", [2, 3])
def test_algorithm_1_by_hand(continuity):
    """One robot, one node: six cells there and back, and Algorithm 4 on each leg.

    There, the last point in sight of the depot is (4.5, 0.5). Back, the line from the node to (3.5, 0.5)
    touches the corner (4, 1) only, and the line from there to the depot the corner (2, 1).
    """
    mission = FleetMission(
        [box(0, 0, 2, 1), box(3, 1, 4, 2)], (0, 0, 5, 2), [[4.5, 1.5]], (0.5, 1.5), 1, cell=1.0,
        continuity=continuity,
    )  # fmt: skip
    found = ct.solve(mission, "paper-pipeline", seed=0)
    assert found.statistics["grid path of robot 0"] == 12.0
    smoothed = 17**0.5 + 1 + 2**0.5 + 10**0.5
    assert found.statistics["smoothed path of robot 0"] == pytest.approx(smoothed)
    names = {one.name for one in found.verification.violated}
    assert names <= {"radius away from obstacles", "inside the bounds"}


def test_sums_and_deviations_of_table_3_are_those_of_its_rows():
    assert (len(TABLE_3.rows), TABLE_3.printed_cells) == (28, 168)
    for *lengths, total, deviation in TABLE_3.rows.values():
        assert sum(lengths) == pytest.approx(total, abs=0.021)  # q = 0.7: 0.02 off
        assert np.std(lengths, ddof=1) == pytest.approx(deviation, abs=0.01)


def test_table_3_is_measured_on_the_run_with_the_least_fitness():
    """Two runs with sums 80 and 78: q = 0.1 times their variances, 0 and 20.75, decides for the first."""
    kinds = {
        "grid": ((20, 20, 20, 20), (15, 25, 15, 23)),
        "smoothed": ((9, 9, 9, 13), (1, 1, 1, 1)),
    }
    answers = [
        SimpleNamespace(
            plan=None, primal_bound=78.0,
            statistics={
                f"{kind} path of robot {k}": float(rows[run][k]) for kind, rows in kinds.items() for k in range(4)
            },
        )
        for run in (0, 1)
    ]  # fmt: skip
    calls = []
    trials = SimpleNamespace(
        runs=2,
        seed=0,
        time_limit=1.0,
        run=lambda *a, **k: calls.append(a) or answers[: k.get("runs", 2)],
    )
    before = measure_table_3(("0.1", GRID), trials)
    assert (before["Total distance"], before["Standard deviation"]) == (80, 0)
    assert (before["runs"], before["mean total"], before["curves free"]) == (2, 79, 0)
    assert (before["fitness"], before["best known fitness"]) == (80, 78)
    after = measure_table_3(("0.1", SMOOTHED), trials)
    assert [after[f"Robot {k}"] for k in (1, 2, 3, 4)] == [9, 9, 9, 13]
    assert after["Standard deviation"] == pytest.approx(2)
    assert len(calls) == 3, "both rows of one q come from the same runs"
    model = calls[0][0]
    assert (model.q, model.vehicles, len(model.nodes), len(model.obstacles)) == (0.1, 4, 75, 28)


def test_the_mission_of_table_3_has_the_depot_at_the_bottom_left():
    mission = table_3_mission(0.4)
    assert mission.depot.tolist() == [15, 15]
    assert (mission.q, mission.continuity, mission.cell) == (0.4, 2, 10)
    assert ((mission.nodes - 5) % 10 == 0).all(), "grid paths are multiples of 10"
