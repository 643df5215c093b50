"""Data that a verification reads cannot be changed by a backend: arrays, and the rest by its digest."""

import copy
import dataclasses
import pickle
import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from fakes import Fixed

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.instances.catalogue import entries
from crosstrack.models import MixedIntegerProgram, NonlinearProgram, Route
from crosstrack.models.fields import frozen
from crosstrack.models.verification import Check
from crosstrack.solvers import Answer, Feature, Guarantee, Termination
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.processes.isolation import Worker

MODELS = (
    "error-correction/example-1",
    "minimum-snap/square",
    "minimum-snap/gate-2d",
    "time-allocation/lap-8s",
    "optimal-control/brachistochrone",
    "satellite-slew/margin-20",
)
#: A route that leaves out every correction, and breaks the thresholds of the model below.
STRAIGHT = (0, 1)


def far():
    """Return a model whose straight way gains ten times the error allowed."""
    return ct.models.ErrorCorrectionRouting(
        points=[[0, 0, 0], [100, 0, 0]], kinds=["A", "B"], alpha1=1, alpha2=1, beta1=1, beta2=1,
        theta=1, delta=0.1,
    )  # fmt: skip


def arrays(thing, path="", seen=None):
    """Yield every array in `thing`, with its path."""
    seen = {} if seen is None else seen
    if id(thing) in seen:
        return
    seen[id(thing)] = thing
    if isinstance(thing, np.ndarray):
        yield path, thing
    elif sp.issparse(thing):
        for name in ("data", "indices", "indptr"):
            yield f"{path}.{name}", getattr(thing, name)
    elif isinstance(thing, tuple | list):
        for entry, part in enumerate(thing):
            yield from arrays(part, f"{path}[{entry}]", seen)
    elif isinstance(thing, dict):
        for key, part in thing.items():
            yield from arrays(part, f"{path}[{key!r}]", seen)
    elif type(thing).__module__.startswith("crosstrack.") and hasattr(thing, "__dict__"):
        for key, part in vars(thing).items():
            yield from arrays(part, f"{path}.{key}", seen)


def writable(thing):
    """Return where `thing` holds an array that can be made writable."""
    found = []
    for path, array in arrays(thing):
        try:
            array.setflags(write=True)
        except ValueError:
            continue
        found.append(path)
    return found


@pytest.mark.parametrize("dtype", [float, bool, np.int8, ">f8", "<U10", complex])
@pytest.mark.parametrize("shape", [(), (0,), (0, 3), (3, 0), (2, 3)])
def test_a_frozen_array_stays_so(shape, dtype):
    array = np.ones(shape, dtype)
    kept = frozen(array)
    array[...] = 0
    assert kept.dtype == array.dtype and kept.shape == shape
    assert (kept == np.ones(shape, dtype)).all()
    assert kept.flags.c_contiguous and kept.flags.aligned
    assert frozen(kept) is kept and frozen(kept[...]).base is not None
    for one in (kept, kept.view(), kept.T, frozen(pickle.loads(pickle.dumps(kept)))):
        with pytest.raises(ValueError, match="WRITEABLE"):
            one.setflags(write=True)


def test_a_view_of_a_writable_array_is_copied():
    array = np.arange(6.0)
    view = array[::2]
    view.setflags(write=False)
    kept = frozen(view)
    array[:] = 7
    assert kept.tolist() == [0, 2, 4]
    assert frozen(np.asfortranarray(np.eye(3)[:2])).tolist() == np.eye(3)[:2].tolist()


@pytest.mark.parametrize("name", MODELS)
def test_no_array_of_a_model_can_be_made_writable(name):
    model = ct.load(name)
    first = ct.solve(model, time_limit=20) if name != "satellite-slew/margin-20" else None
    if first is not None:
        model.verify(first.plan)  # fills what is derived
        assert not writable(first)
    for one in (model, copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert not writable(one)
        assert one.digest == model.digest


def test_no_array_of_a_program_can_be_made_writable():
    model = ct.load("error-correction/example-1")
    for name in ("paper", "arc-flow"):
        program = model.formulate(name).program
        assert isinstance(program, MixedIntegerProgram)
        assert not writable(program) and not writable(pickle.loads(pickle.dumps(program)))
    control = ct.load("optimal-control/brachistochrone").formulate().program
    assert isinstance(control, NonlinearProgram)
    assert not writable(control)


class Bending(Fixed):
    """Changes the model by `bend`, and claims a plan that only the changed model allows."""

    def __init__(self, bend):
        super().__init__("bending", STRAIGHT)
        self.bend = bend

    def run(self, problem, request):
        self.bend(problem)
        return super().run(problem, request)


def _write(model):
    model.points.setflags(write=True)
    model.points[:] = 0


def _stride(model):
    with warnings.catch_warnings(action="ignore"):
        model.points.strides = (0, 0)


def _limits(model):
    object.__setattr__(model, "theta", 1e9)


def _gone(model):
    object.__setattr__(model, "points", None)


def _missing(model):
    del model.__dict__["kinds"]


def _derived(model):
    model.__dict__["digest"] = model.digest
    model.__dict__["theta"] = 1e9


@pytest.mark.parametrize("bend", [_write, _stride, _limits, _gone, _missing, _derived])
def test_a_backend_cannot_change_the_model_that_judges_it(bend):
    model = far()
    found = ct.solve(model, Bending(bend), isolate=False)
    assert found.termination is Termination.FAILED and found.plan is None
    if bend is not _write:
        assert "the model was changed during the run" in found.message
    else:
        assert "WRITEABLE" in found.message
    assert found.digest == far().digest


def test_derived_values_are_recomputed_before_an_external_backend_is_judged():
    def bend(model):
        model.__dict__["walk"] = lambda plan: far().walk(Route((0,)))

    found = ct.solve(far(), Bending(bend), isolate=False)
    assert found.termination is Termination.REJECTED and found.plan is None
    assert "horizontal error at B" in found.message


def _everything_holds(model):
    Check.ok = property(lambda self: True)


@pytest.mark.parametrize("starts", [1, 2])
def test_a_change_within_a_worker_does_not_reach_the_verification(starts):
    class Drawing(Bending):
        features = frozenset({*Bending.features, Feature.SEED})

    backend = Drawing(_everything_holds)
    backend.guarantee = Guarantee.HEURISTIC
    found = ct.solve(far(), backend, isolate=True, starts=starts)
    assert found.termination is Termination.REJECTED and found.plan is None
    assert Check("", "", 1.0, "", 0.0, "").ok is False


def test_a_process_that_ran_external_code_runs_no_other_job():
    with Worker() as worker:
        found = worker.solve(Job(far(), Bending(_everything_holds)))
        assert found.termination is Termination.REJECTED
        assert worker.pid is None
        with pytest.raises(UnsupportedOption, match="bent"):
            worker.solve(Job(far(), Bending(_refuses)))
        assert worker.pid is None
        worker.solve(Job(far(), "label-setting"))
        assert worker.pid is not None


def _refuses(model):
    raise UnsupportedOption("bent")


def test_a_plan_is_kept_as_it_was_judged():
    held = []

    class Keeping(Fixed):
        accepts = MixedIntegerProgram

        def run(self, problem, request):
            held.append(np.zeros(problem.size))
            return Answer(Termination.OPTIMAL, point=held[0], duals=held[0])

    b = ct.models.ProgramBuilder()
    b.columns("x", 1, upper=1, cost=1)
    b.rows("row", 1, (0, 0, 1.0), upper=1)
    program = b.build()
    found = ct.solve(program, Keeping(), isolate=False)
    held[0][:] = 5
    assert found.plan.tolist() == [0] and found.duals.tolist() == [0]


@pytest.mark.parametrize("kind", sorted({entry.model for entry in entries()}))
def test_a_model_accepts_no_further_attribute(kind):
    model = next(ct.load(entry.name) for entry in entries() if entry.model == kind)
    for change in (lambda: setattr(model, "other", 1), lambda: delattr(model, "other")):
        with pytest.raises(dataclasses.FrozenInstanceError, match="other"):
            change()
