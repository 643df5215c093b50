"""Further declarations, digests and round trips of optimal control problems."""

import copy
import inspect
import json
import pickle

import cloudpickle
import numpy as np
import pytest
from control_declared import NAN, everything, interpolated, open_problem, rest_to_rest, solve

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import Model, OptimalControlProblem


def test_further_declarations_make_another_problem():
    grown = rest_to_rest()
    first = grown.ocp.digest
    assert solve(grown.ocp).primal_bound == pytest.approx(12, rel=1e-9)
    grown.phase.path(grown.u <= 5, name="weak")
    second = grown.ocp.digest
    assert second != first
    found = solve(grown.ocp)
    assert found.primal_bound > 12.01 and found.digest == second
    grown.ocp.minimise(grown.phase.integral(grown.u**2) + 1)
    assert solve(grown.ocp).primal_bound == pytest.approx(found.primal_bound + 1, rel=1e-6)
    assert grown.ocp.digest not in (first, second)


def test_a_rejected_declaration_changes_nothing():
    part = rest_to_rest()
    before = part.ocp.digest
    for attempt in (
        lambda: part.phase.state("z", initial="a"),
        lambda: part.phase.state("y", scale=-1),
        lambda: part.phase.control("w", lower=2, upper=1),
        lambda: part.phase.dynamics({part.x: 1}),
        lambda: part.phase.path(part.x),
        lambda: part.phase.invariant("i", part.u),
        lambda: part.phase.integral([1, 2]),
        lambda: part.phase.guess(x="a"),
        lambda: part.ocp.parameter("p", guess=NAN),
        lambda: part.ocp.phase("late", time=(2, 1)),
        lambda: part.ocp.subject_to(part.phase.final(part.x)),
        lambda: part.ocp.minimise("x"),
    ):
        with pytest.raises(InvalidData):
            attempt()
    assert part.ocp.digest == before
    part.phase.state("z", initial=0)
    part.phase.dynamics({"z": 1})
    assert part.ocp.digest != before


def test_a_finished_definition_is_closed():
    first = rest_to_rest()
    copied = OptimalControlProblem("copy", definition=first.ocp.definition)
    assert copied.digest == first.ocp.digest and copied.name == "copy"
    for closed in (copied, first.ocp.renamed("other"), copy.deepcopy(first.ocp)):
        assert isinstance(closed, OptimalControlProblem)
        assert not any(
            hasattr(closed, name) for name in ("phase", "parameter", "minimise", "link", "build")
        )
    first.phase.path(first.x <= 2)
    assert copied.digest != first.ocp.digest


def test_descriptions():
    part = open_problem()
    assert part.ocp.describe() == "being declared" and "being declared" in repr(part.ocp)
    assert "2 states" in repr(rest_to_rest().ocp.renamed("r"))


@pytest.mark.parametrize(
    "trip",
    [
        lambda m: Model.from_json(m.to_json()),
        lambda m: Model.from_json(m.to_json(indent=1)),
        lambda m: Model.from_dict(json.loads(json.dumps(m.to_dict()))),
        lambda m: pickle.loads(pickle.dumps(m)),
        lambda m: cloudpickle.loads(cloudpickle.dumps(m)),
        copy.copy,
        copy.deepcopy,
        lambda m: m.renamed("another name"),
        lambda m: Model.from_json(Model.from_json(m.to_json()).to_json()),
    ],
)
def test_round_trips_keep_the_digest(trip, answer):
    ocp = rest_to_rest().ocp
    again = trip(ocp)
    assert again.digest == ocp.digest
    assert again.verify(answer.plan).objective == ocp.verify(answer.plan).objective


def test_equal_numbers_of_other_types_give_equal_digests():
    digests = {everything(one).digest for one in (20, 20.0, np.float64(20), np.int64(20))}
    assert len(digests) == 1
    assert everything(21).digest not in digests


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.phase.path(d.x <= 9),
        lambda d: d.ocp.subject_to(d.phase.final(d.x) <= 9),
        lambda d: d.phase.guess(x=0.5),
        lambda d: d.ocp.parameter("p"),
        lambda d: d.phase.invariant("i", d.x * 0),
        lambda d: d.ocp.minimise(d.phase.integral(d.u**2), unit="J"),
        lambda d: d.ocp.minimise(d.phase.integral(d.u**2 * (1 + 1e-15))),
    ],
)
def test_every_declaration_is_part_of_the_digest(change):
    part = rest_to_rest()
    before = part.ocp.digest
    change(part)
    assert part.ocp.digest != before


def test_a_new_process_declares_the_same_problem(run_python, tmp_path):
    ocp = everything(20)
    (tmp_path / "model.pickle").write_bytes(pickle.dumps(ocp))
    (tmp_path / "model.json").write_text(ocp.to_json(), "utf-8")
    script = f"""\
import pathlib, pickle, casadi, numpy as np, crosstrack as ct
from crosstrack.models import OptimalControlProblem

{inspect.getsource(everything)}

print(pickle.loads(pathlib.Path("model.pickle").read_bytes()).digest)
print(ct.load("model.json").digest)
print(everything(20).digest)
"""
    (tmp_path / "script.py").write_text(script, "utf-8")
    assert run_python("script.py", cwd=tmp_path).split() == [ocp.digest] * 3


def test_workers_solve_a_problem_of_this_process():
    ocp = interpolated()
    one = ct.solve(ocp, "ipopt", isolate=True, seed=0, time_limit=60)
    assert one.digest == ocp.digest
    assert one.primal_bound == pytest.approx(0.408401, abs=2e-5), str(one)


def test_a_problem_is_read_from_its_file(tmp_path):
    ocp = everything(20)
    file = tmp_path / "mine.json"
    file.write_text(ocp.to_json(indent=1), "utf-8")
    again = ct.load(file)
    assert isinstance(again, OptimalControlProblem) and again.digest == ocp.digest
    assert again.name == "everything"
