"""The paper's algorithms on steps that are worked by hand, and an instance on which their dominance fails."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import ErrorCorrectionRouting
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.error_correction.airspace import airspace
from crosstrack.solvers.error_correction.printed_kernels import (
    correct_labels,
    label_points,
    send_pulses,
)

FLAG = np.zeros(1, np.int8)


def on_a_line():
    """A at 0, vertical points at 2 and 5, a horizontal point at 3, B at 6; one unit of error per metre."""
    return ErrorCorrectionRouting(
        [[x, 0, 0] for x in (0, 2, 3, 5, 6)],
        ["A", "vertical", "horizontal", "vertical", "B"],
        4, 4, 4, 4, 4, delta=1.0,
    )  # fmt: skip


@pytest.mark.parametrize(("factor", "made"), [(0.5, 4), (1.0, 6)])
def test_stage_1_follows_steps_1_to_4(factor, made):
    """Labels [length, horizontal, vertical, father] as they become permanent.

    λ = 0.5, vertical errors up to 2: A [0, 0, 0, -]; V2 [2, 2, 2, A]; H3 is refused from A with vertical error 3 and
    labelled [3, 3, 1, V2]; V5 is refused from each point; B [6, 3, 4, H3]. Four labels.
    λ = 1: H3 is labelled [3, 3, 3, A] first and [3, 3, 1, V2] at equal length; V5 is labelled [5, 2, 3, H3], and
    its way to B, 6 as well, does not replace the label of B. Six labels.
    """
    status, route, length, labels = label_points(airspace(on_a_line()), factor, FLAG)
    assert (status, route.tolist(), length, labels) == (1, [0, 1, 2, 4], 6.0, made)


def test_stage_1_misses_example_1():
    """Points 2, 3 and 4 are labelled from 1 with length 2; no leg shortens them, and none leads on to 5."""
    status, _, _, labels = label_points(airspace(ct.load("error-correction/example-1")), 1.0, FLAG)
    assert (status, labels) == (0, 4)


@pytest.mark.parametrize(
    ("bound", "length", "made"),
    [(np.inf, 4.5, 6), (4.6, 4.5, 5), (4.5, np.inf, 4)],
    ids=["pulse", "below a bound", "below the optimum"],
)
def test_pulses_on_example_1(bound, length, made):
    """The pulses of the paper's example, with d24 = 1.28, d25 = 2.12, d34 = 0.8 and d45 = 2.30.

    1-2 (2.0), 1-2-3 (2.5), 1-2-3-4 (3.3, ends: vertical error 0.31 at 5), 1-2-3-5 (route, 4.5); 1-2-4 is cut by the
    bound. 1-3 (2.0, not dominated) is cut at 2 and 4 by the bound, at 5 by the horizontal error 0.4. 1-4 (2.0) is
    cut at 2 and 3 by the bound, at 5 by the vertical error. The labels are 1, 2, 3, 4, 3 and 4. A bound of
    4.6 cuts 1-2-3-4 (5.6), a bound of 4.5 also 1-2-3 (4.5).
    """
    space = airspace(ct.load("error-correction/example-1"))
    status, route, best, line, used, extended = send_pulses(space, bound, FLAG)
    assert best == pytest.approx(length, rel=1e-12)
    assert route.tolist() == ([0, 1, 2, 4] if status == 1 else [])
    assert (line, used, extended) == (4.0, made, made)


def test_dynamic_program_on_example_1():
    """Γ by (length, vertical, horizontal), point by point in the order of the queue E.

    1: adds 1-2, 1-3, 1-4. 2: adds 1-2-3 (2.5, 0.25, 0.05), which 1-3 (2, 0.2, 0.2) does not dominate. 3: adds 1-2-3-4,
    1-2-3-5, 1-3-2 and 1-3-4. 4: adds 1-3-4-2; 1-2-3 dominates 1-4-3 (2.8, 0.28, 0.08). 5: nothing. 2, again with
    all three labels: adds 1-3-2-4 and 1-3-2-5 (4.62, 0.26, 0.21). 4, again with all four labels: nothing.
    Labels: 1 + 3 + 1 + 4 + 1 + 2 = 12; extensions: 1 + 1 + 2 + 3 + 3 + 4 = 14.
    """
    space = airspace(ct.load("error-correction/example-1"))
    status, route, length, _, made, extended = correct_labels(space, np.inf, FLAG)
    assert (status, route.tolist(), made, extended) == (1, [0, 1, 2, 4], 12, 14)
    assert length == pytest.approx(4.5, rel=1e-12)


def test_two_stage_sends_pulses_below_the_length_of_stage_1():
    model = on_a_line()
    backend = find_backend("two-stage", model)
    answer = backend.run(model, Request(options=backend.checked_options({"threshold_factor": 1.0})))
    # Every leg to the right has length plus straight line 6 >= 6, so stage 2 only extends A.
    assert answer.statistics["stage1 length"] == answer.primal_bound == answer.dual_bound == 6.0
    assert answer.statistics["labels extended"] == 1
    assert answer.termination == "optimal"


@pytest.mark.parametrize("name", ["two-stage", "pulse", "dynamic-programming"])
def test_the_printed_dominance_loses_the_only_route(name):
    """0-3-2-1-4 is the only route, and 0-1-2 (1.5, 1.5, 0.5) dominates 0-3-2 (1.605, 1.605, 0.6).

    From 0-1-2 the way on is by point 3, which arrives at B with vertical error 0.6 + 1.204 > 1.75; by point 1 it
    would be 0.5 + 1.2, but this point is used. The shortest walk is 0-1-2-1-4 of length 3.2.
    """
    model = ErrorCorrectionRouting(
        [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, -0.1, 0], [2.2, 0, 0]],
        ["A", "horizontal", "vertical", "horizontal", "B"],
        1.65, 1.65, 1.6, 1.6, 1.75, delta=1.0,
    )  # fmt: skip
    best = ct.solve(model)
    assert best.plan.route == (0, 3, 2, 1, 4)
    assert best.primal_bound == pytest.approx(1.01**0.5 + 0.6 + 0.5 + 1.2)
    found = ct.solve(model, name)
    assert (found.termination, found.plan) == ("no_solution", None)
    assert found.dual_bound == pytest.approx(3.2)
    assert "without a proof" in found.message


def test_the_program_numbers_its_rows_and_columns_as_printed():
    program = ct.load("error-correction/example-1").formulate("paper").program
    equations = {block.name: block.equation for block in (*program.columns, *program.rows)}
    assert {name: equations[name] for name in equations if equations[name] in map(str, range(19, 25))} == {
        "no horizontal error on leaving A": "19", "no vertical error on leaving A": "20",
        "no distance at A": "21", "arc used": "23", "point used": "24",
        **dict.fromkeys((
            "distance on arrival", "horizontal error on arrival", "vertical error on arrival",
            "horizontal error on leaving", "vertical error on leaving",
        ), "22"),
    }  # fmt: skip
