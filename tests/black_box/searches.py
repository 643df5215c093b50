"""Helpers: every search of black boxes with one objective, and runs of them in this process."""

import pytest

from crosstrack.models import BlackBoxMinimisation
from crosstrack.solvers import Control, Feature, Request, find_backend
from crosstrack.solvers.black_box import BACKENDS
from crosstrack.solvers.contract.job import Job

#: The packages that a plain installation lacks.
LACKING = {name for name in BACKENDS if find_backend(name).missing()}
EVERY = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(name in LACKING, reason="needs crosstrack[blackbox]"),
    )
    for name in BACKENDS
    if name != "nsga-ii"  # needs several objectives
]
#: Searches whose models take milliseconds per evaluation: tests give them fewer evaluations.
MODELLING = ("surrogate-search", "portfolio", "cobyqa")
DRAWING = [one for one in EVERY if Feature.SEED in find_backend(one.values[0]).features]


def allowed(name, modelling, others):
    """Return the budget of a search that has models, or that of the others."""
    return modelling if name in MODELLING else others


class Counted:
    """An oracle that keeps the points it was asked for, and calls `on_question` before each answer."""

    def __init__(self, model, on_question=None):
        self.answers, self.on_question = model.oracle(), on_question
        self.points, self.questions = [], 0

    def __call__(self, points):
        return self._kept(points, self.answers)

    def part(self, points):
        return self._kept(points, self.answers.part)

    def start(self, points):
        return self.answers.start(points)

    def _kept(self, points, answer):
        self.questions += 1
        if self.on_question is not None:
            self.on_question(self)
        values = answer(points)
        self.points.extend(points[: len(values)].tolist())
        return values


def search(name, model, seed=0, *, warm=None, control=None, evaluations=None, target=None, **own):
    """Return the answer of a search, without a process of its own, and the oracle that it asked."""
    backend = find_backend(name)
    backend.prepare()
    control = control or Control()
    asked = {"evaluations": evaluations}
    control.criterion = Job(model, backend, target=target, **asked).criterion
    if control.oracle is None:
        control.oracle = Counted(model)
    request = Request(
        seed=seed, warm_start=None if warm is None else model.as_plan({"x": warm}), target=target,
        options=backend.checked_options(own), control=control, **asked,
    )  # fmt: skip
    return backend.run(model.blinded(), request), control.oracle


def box(function, *bounds, **fields):
    """Return a black box with the given bounds."""
    return BlackBoxMinimisation(function, bounds, **fields)
