"""Properties of every instance of the catalogue: files, plans, programs, pictures."""

import json
import pickle

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import HiddenData, UnsupportedFormulation
from crosstrack.instances import entries
from crosstrack.models import Model
from crosstrack.solvers import Solution

#: Entries, or the problem of entries, that take more than a second or so, and are not drawn.
SLOW = {
    *("error-correction/10", "error-correction/11"),
    "minimum-snap/corridor-1000",
    "attractor/samples-100000",
    "satellite-slew",
    *("guided-path/hard-10x30", "guided-path/hard-20x20"),
    *("sequential-ordering/random-200-1000-15", "sequential-ordering/random-500-1000-1"),
    "fleet/mixed-6",  # column-generation refuses it, and PyVRP uses the whole limit
    *(f"fleet/table-3-q{q}" for q in ("0", "0.2", "0.4", "0.6", "0.8")),
    *(f"unknown-grid/task-{task}-{walls}" for task in (1, 2, 3) for walls in (3, 4, 5)),
    *("unknown-grid/task-2-2", "unknown-grid/task-3-2", "unknown-grid/camera-hard"),
    # Of each size the first few are quick.
    *(
        f"messenger/B-{n:02}-{k:02}"
        for n in (2, 3, 10, 20, 30, 40)
        for k in range(1 if n > 10 else 2, 11)
    ),
}
#: Tolerances by problem, where the usual one is not meant to be reached.
TOLERANCES = {"satellite-slew": 1e-3}
#: Backend and evaluations by problem: a plan of any backend serves here. The entries in `DEFAULT` take the default backend.
QUICK = {"attractor": "rosenstein", "black-box": "random-search"}
EVALUATIONS = {"black-box": 100}
#: Tolerance of rows, relative to their terms: the plan of a program's solution is encoded again.
ROWS = 1e-5


#: Entries of optimal control that are solved here: with a free end, phases, parameters, integer controls
#: or path constraints. `optimal_control/test_control_instances.py` solves, verifies and stores most.
CONTROL = {
    f"optimal-control/{name}"
    for name in (
        "bryson-denham", "brachistochrone", "decay-fit", "goddard-phases", "hanging-chain",
        "lotka-volterra-fishing", "van-der-pol", "zermelo",
    )
}  # fmt: skip


def is_slow(entry):
    problem = entry.name.partition("/")[0]
    return bool({entry.name, problem} & SLOW) or (
        problem == "optimal-control" and entry.name not in CONTROL
    )


def ends():
    """Return the names of the first and the last quick entry of each model."""
    by_model = {}
    for entry in entries():
        if not is_slow(entry):
            by_model.setdefault(entry.model, []).append(entry.name)
    return {names[0] for names in by_model.values()}, {names[-1] for names in by_model.values()}


#: Entries drawn here.
DRAWN, LAST = ends()
#: Entries solved by the default backend.
DEFAULT = DRAWN | LAST
#: Further entries that are solved in the fast tests: the first of a model with its set of fields, free ends and phases.
FIELDS = {
    f"{problem}/{name}"
    for problem, names in {
        "attractor": "henon noise-10db",
        "error-correction": "example-1",
        "fleet": "battery battery-too-small bounded capacity deviation-7-q4 each-its-own windows-7",
        "flight": "crossing one-place snap",
        "grid-path": "terrain",
        "guided-path": "chains-and-pairs one relation-12",
        "messenger": "euclidean static-closed",
        "minimum-derivative": "weighted",
        "minimum-snap": "figure-eight gate-2d",
        "optimal-control": "decay-fit goddard-phases",
        "resource-routing": "network-5 network-20-again plain",
        "sequential-ordering": "one-order ring",
        "sideslip": "unknown untrained",
        "time-allocation": "walk-20 walk-20-limited",
        "unknown-grid": "close-walls corners crossing eight-neighbours moving noise occlusion",
    }.items()
    for name in names.split()
}


def cases():
    """Every entry of the catalogue, marked slow unless the default backend solves it or it has fields of its own."""
    assert {entry.name for entry in entries()} >= FIELDS
    for entry in entries():
        marks = [] if entry.name in DEFAULT | FIELDS else [pytest.mark.slow]
        yield pytest.param(entry, id=entry.name, marks=marks)


def solved(entry):
    """Return the model and a solution."""
    model, problem = entry.build(), entry.name.partition("/")[0]
    backend = "auto" if entry.name in DEFAULT else QUICK.get(problem, "auto")
    return model, ct.solve(
        model,
        backend,
        time_limit=60,
        tolerance=TOLERANCES.get(problem, 1e-6),
        evaluations=EVALUATIONS.get(problem),
    )


#: Entries with much data, each like a smaller one.
LARGE = {
    *("attractor/hunt-calm", "attractor/hunt-long", "sequential-ordering/random-500-1000-60"),
    *(f"unknown-grid/task-{task}-{walls}" for task in (1, 2, 3) for walls in (3, 4, 5)),
}


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=entry.name, marks=[pytest.mark.slow] if entry.name in LARGE else [])
        for entry in entries()
    ],
)
def test_its_data_travels(entry):
    model, described = entry.build(), entry.to_dict()
    assert model.kind == entry.model
    assert model.name == entry.name
    assert json.loads(json.dumps(described, allow_nan=False)) == described
    data = model.to_dict()
    again = Model.from_json(model.to_json())
    assert (type(again), again.name, again.digest) == (type(model), model.name, model.digest)
    assert again.to_dict() == data
    sent = pickle.loads(pickle.dumps(model))
    assert (sent.digest, sent.name, sent.to_dict()) == (model.digest, model.name, data)
    assert model.renamed("another").digest == model.digest
    view = model.blinded()
    assert (view.digest, view.is_blinded) == (model.digest, bool(model.hidden_fields()))
    for name in model.hidden_fields():
        with pytest.raises(HiddenData):
            getattr(view, name)
    assert model.describe()


def draw(model, solution, folder):
    """Draw the plan, or the model if it has none."""
    if solution.plan is None:
        assert ct.plot(model).axes
        return
    ct.plot(model, solution).savefig(folder / "picture.png", dpi=40)
    assert (folder / "picture.png").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    "entry", [entry for entry in entries() if entry.name not in DRAWN], ids=lambda entry: entry.name
)
def test_its_plan_is_drawn(entry, tmp_path):
    draw(*solved(entry), tmp_path)


@pytest.mark.parametrize("entry", list(cases()))
def test_its_plan_travels_and_fits_every_program(entry, tmp_path):
    model, solution = solved(entry)
    if entry.name in DRAWN:  # half of the time of this test
        draw(model, solution, tmp_path)
    data = solution.to_dict()
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    if solution.plan is None:
        assert solution.termination in ("infeasible", "locally_infeasible"), solution
        return
    assert Solution.from_dict(data, model).to_dict() == data
    stored = json.loads(json.dumps(model.plan_to_data(solution.plan), allow_nan=False))
    plan = model.plan_from_data(stored)
    assert model.plan_to_data(plan) == stored
    assert model.plan_to_data(pickle.loads(pickle.dumps(plan))) == stored
    for given in (solution, solution.plan, stored):
        assert model.plan_to_data(model.as_plan(given)) == stored
    tolerance = TOLERANCES.get(entry.name.partition("/")[0], 1e-6)
    found = model.verify(plan, tolerance=tolerance)
    assert found.ok, found
    assert found.objective == pytest.approx(solution.primal_bound, rel=1e-9)
    fits_every_program(model, plan, solution)


def fits_every_program(model, plan, solution):
    """Assert that a plan has a point in every program, and satisfies the rows that apply to it."""
    for name in model.formulations:
        try:
            written = model.formulate(name).fitted(plan)
        except UnsupportedFormulation:
            continue
        point = written.encode(plan)
        assert np.isfinite(point).all()
        rows = written.program.verify(point, tolerance=ROWS)
        assert rows.objective is not None
        # An approximation's rows bind the plans that were made by it.
        if written.relaxes or name == solution.formulation:
            assert rows.ok, (name, rows)
        # A paper's own program may lose the digits that its plans need.
        if name in (model.default_formulation, solution.formulation):
            again = model.verify(written.decode(point), tolerance=ROWS)
            assert again.ok, (name, again)
