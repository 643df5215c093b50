"""Objectives of public programs: two independent solvers agree, and both equal the recorded value.

``tests/benchmarks/programs/public_sets.py references`` wrote the values.
"""

import itertools
import json
from pathlib import Path

import pytest

import crosstrack as ct

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data" / "programs"
REFERENCES = json.loads(Path(__file__).with_name("public_objectives.json").read_text("utf-8"))
#: Relative difference up to which objectives are equal.
EQUAL = 1e-6
#: Solvers with dense matrices, which are slow on most of these programs and therefore tried last.
DENSE = ("daqp", "quadprog")


def path_of(name):
    path = DATA / ("qp" if name.endswith(".mat") else "mps") / name
    if not path.is_file():
        pytest.skip(f"the public file {name} is not in ../shared/data")
    return path


def test_every_program_has_two_solvers_or_an_explanation():
    assert len(REFERENCES) == 96
    for name, entry in REFERENCES.items():
        assert len(entry["solvers"]) > 1 or "note" in entry, name


def test_references_cover_the_public_files():
    if not DATA.is_dir():
        pytest.skip("the public programs are not in ../shared/data")
    files = {path.name for path in [*DATA.glob("qp/*.mat"), *DATA.glob("mps/*.mps")]}
    assert files == REFERENCES.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCES)
def test_two_solvers_return_the_recorded_objective(name):
    entry = REFERENCES[name]
    program = ct.load(path_of(name))
    if not entry["solvers"]:
        pytest.skip(entry["note"])
    size = max(1.0, abs(entry.get("value", 0.0)))
    equal: dict[str, str] = {}
    order = sorted(entry["solvers"], key=DENSE.__contains__)
    for solver, accuracy in itertools.product(order, (1e-9, 1e-6)):
        if solver in equal or len(equal) == 2 or (solver, accuracy) == ("scipy", 1e-9):
            continue  # the tolerance of SciPy is fixed
        limits = {"time_limit": 120, "tolerance": accuracy, "gap": 1e-9, "isolate": True}
        answer = ct.solve(program, solver, **limits)
        if entry.get("infeasible"):
            assert answer.termination == "infeasible"
            equal[solver] = "optimal"
            continue
        assert answer.bound is None or answer.bound <= entry["value"] + EQUAL * size
        if answer.value is not None and abs(answer.value - entry["value"]) <= EQUAL * size:
            equal[solver] = answer.termination
    # A verified plan whose solver proves less than the gap confirms a value that another one proves.
    assert len(equal) == min(2, len(entry["solvers"])) and "optimal" in equal.values(), equal


def test_bounds_that_a_constant_shifted_from_1e20_are_infinite():
    """Four of the Maros-Meszaros files contain such bounds, which solvers would take as finite."""
    bounds = {"l": [-1e20, -9.999999999999662e19], "u": [9.999999999999997e19, 1.0]}
    program = ct.load({"q": [1.0, 1.0], "A": [[1.0, 0.0], [0.0, 1.0]], **bounds})
    assert program.row_lower.tolist() == [-float("inf")] * 2
    assert program.row_upper.tolist() == [float("inf"), 1.0]
