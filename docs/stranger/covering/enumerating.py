"""Solver of binary programs by complete enumeration."""

from __future__ import annotations

import itertools

import numpy as np

from crosstrack.errors import UnsupportedFormulation
from crosstrack.models import MixedIntegerProgram
from crosstrack.solvers import Answer, Backend, Feature, Guarantee, Limit, Termination

#: Maximum number of columns; larger programs would take minutes.
MAX_COLUMNS = 18


class Enumeration(Backend):
    """Backend that evaluates all points of a program with 0-1 columns."""

    name = "enumeration"
    accepts = MixedIntegerProgram
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    summary = "complete enumeration of a few 0-1 columns"

    def refuses(self, problem):
        low, high = problem.column_lower, problem.column_upper
        if (
            problem.size > MAX_COLUMNS
            or not problem.integral.all()
            or (low < 0).any()
            or (high > 1).any()
        ):
            return f"it accepts at most {MAX_COLUMNS} columns, each 0 or 1"
        return ""

    def run(self, problem, request):
        if self.refuses(problem):
            raise UnsupportedFormulation(f"backend 'enumeration': {self.refuses(problem)}")
        best, point = np.inf, None
        for values in itertools.product((0.0, 1.0), repeat=problem.size):
            if request.control.stopped:
                kind = Termination.NO_SOLUTION if point is None else Termination.FEASIBLE
                return Answer(kind, point=point, limit=request.control.reason or Limit.TIME)
            x = np.array(values)
            rows = problem.matrix @ x
            inside = (x >= problem.column_lower).all() and (x <= problem.column_upper).all()
            # Tolerance for rounding errors: ten times 0.1 is less than 1.
            slack = 1e-9 * np.maximum(1.0, abs(problem.matrix) @ abs(x))
            above = (rows >= problem.row_lower - slack).all()
            if inside and above and (rows <= problem.row_upper + slack).all():
                value = problem.objective(x)
                if value < best:
                    best, point = value, x
        if point is None:
            return Answer(Termination.INFEASIBLE)
        return Answer(Termination.OPTIMAL, point=point, dual_bound=best)
