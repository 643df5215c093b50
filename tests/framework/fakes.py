"""Backends that misbehave in known ways, and one that is right; sent to workers by value."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import cloudpickle

from crosstrack.models import ErrorCorrectionRouting, Route
from crosstrack.solvers import Answer, Backend, Feature, Guarantee, Option, Termination

cloudpickle.register_pickle_by_value(sys.modules[__name__])

#: The paper's example 1 with point 4 (index 3) far away; its optimum is 0-1-2-4.
ROUTE = (0, 1, 2, 4)


class Fixed(Backend):
    """Returns a given route with a given claim."""

    name = "fixed"
    accepts = ErrorCorrectionRouting
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.INTERRUPT, Feature.DUAL_BOUND, Feature.WARM_START})
    options = {
        "termination": Option("optimal", "What it claims.", str),
        "dual": Option(None, "The bound it claims.", float),
    }

    def __init__(
        self, name="fixed", route=ROUTE, guarantee=Guarantee.EXACT, dual=None, claims="optimal"
    ):
        self.name = name
        self.route = route
        self.guarantee = guarantee
        self.dual = dual
        self.claims = claims

    def run(self, problem, request):
        return Answer(
            Termination(self.claims),
            point=None if self.route is None else Route(self.route),
            dual_bound=self.dual,
        )


class Killed(Fixed):
    """Reports an incumbent and dies of a signal in the middle of its run."""

    def run(self, problem, request):
        if self.route is not None:
            request.control.incumbent(1.0, Route(self.route))
            time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGKILL)


class Hanging(Fixed):
    """Reports an incumbent and then hears nothing any more."""

    def run(self, problem, request):
        if self.route is not None:
            request.control.incumbent(1.0, Route(self.route))
        while True:
            time.sleep(0.05)


class Raising(Fixed):
    """Has a bug."""

    def run(self, problem, request):
        raise RuntimeError("the solver tripped")


class Brief(Fixed):
    """Ends soon: it records its thread, acts as configured and reports an incumbent."""

    def __init__(self, act=None):
        super().__init__()
        self.act = act

    def is_brief(self, problem):
        return True

    def run(self, problem, request):
        self.thread = threading.current_thread()
        request.control.incumbent(1.0, Route(self.route))
        if self.act is not None:
            self.act()
        return super().run(problem, request)


class Patient(Fixed):
    """Reports an incumbent and works until it is stopped."""

    def run(self, problem, request):
        request.control.incumbent(1.0, Route(self.route))
        while not request.control.stopped:
            time.sleep(0.01)
        return Answer(Termination.FEASIBLE, request.control.reason)


class Counting(Fixed):
    """Appends a line to a file for every run."""

    def __init__(self, path, **kwargs):
        super().__init__(**kwargs)
        self.path = str(path)

    def run(self, problem, request):
        with Path(self.path).open("a") as file:
            file.write(f"{self.name} {problem.name}\n")
        return super().run(problem, request)
