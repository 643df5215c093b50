"""Files of Solomon, and of Gehring and Homberger."""

from __future__ import annotations

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.instances.fleet import read_solomon

HEAD = """C101

VEHICLE
NUMBER     CAPACITY
  25         200

CUSTOMER
CUST NO.  XCOORD.   YCOORD.    DEMAND   READY TIME  DUE DATE   SERVICE   TIME

"""
ROWS = """    0      40         50          0          0       1236          0
    1      45         68         10        912        967         90
    2      45         70         30        825        870         90
"""


def read(tmp_path, text, **fields):
    file = tmp_path / "c101.txt"
    file.write_text(text)
    return read_solomon(file, **fields)


def test_all_columns_become_fields(tmp_path):
    model = read(tmp_path, HEAD + ROWS)
    assert (model.name, model.vehicles, str(model.objective)) == ("c101", 25, "sum")
    assert model.points.tolist() == [[40, 50], [45, 68], [45, 70]]
    assert model.demands.tolist() == [0, 10, 30] and set(model.capacity) == {200}
    assert model.windows == (((0, 1236),), ((912, 967),), ((825, 870),))
    assert model.service.tolist() == [0, 90, 90]
    plan = model.with_schedule([[2, 1], *([[]] * 24)])
    checked = model.verify(plan)
    assert checked.ok
    assert checked.objective == pytest.approx(2 + np.hypot(5, 18) + np.hypot(5, 20))
    assert read(tmp_path, HEAD + ROWS, vehicles=3).vehicles == 3


def test_the_file_is_recognised_without_its_suffix(tmp_path):
    (tmp_path / "r1").write_text(HEAD + ROWS)
    assert ct.load(tmp_path / "r1").kind == "fleet-routing"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD, "must have customers"),
        (HEAD + ROWS.replace(" 90\n", "\n", 1), "line 11: must have 7 numbers, got 6"),
        (HEAD + ROWS.replace("    2 ", "    3 "), "line 12: must be customer 2, got 3"),
        (HEAD + ROWS.replace("967", "x"), "line 11"),
        (HEAD + ROWS.replace("967", "900"), "windows"),
        (HEAD.replace("DUE DATE", "READY") + ROWS, "line 1: must be a name"),
        (HEAD.replace("25", "2.5") + ROWS, "vehicles"),
        ("", "line 1"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, text, message):
    with pytest.raises(InvalidData, match=message):
        read(tmp_path, text)
