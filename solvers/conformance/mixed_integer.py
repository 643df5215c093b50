"""Conformance cases: mixed-integer programs with known optimum, including typical pitfalls."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...models.programs.linear import MixedIntegerProgram
from ..contract.backend import Feature, Termination
from .cases import Case, Expectation, Run, asked_for, optimum, tabled, unsolvable
from .limits import hard_knapsack, same_seed_same_answer, seeds_differ
from .linear import program

__all__ = ["integer_cases"]

INF = np.inf
#: Function that makes a program with integer columns only.
whole = partial(program, integral=True)


def integer_cases() -> tuple[Case, ...]:
    """Return the cases that solvers finish at once."""
    return (*_solvable(), *_unsolvable(), *_cutoffs())


def _solvable() -> list[Case]:
    assignment = np.array([[9, 2, 7, 8], [6, 4, 3, 7], [5, 8, 1, 8], [7, 6, 9, 4]], float)
    each = np.vstack([np.kron(np.eye(4), np.ones(4)), np.kron(np.ones(4), np.eye(4))])
    integer = {
        "knapsack": (_knapsack(), optimum(-15, (0, 1, 1, 1, 1))),
        "assignment": (
            whole(assignment.ravel().tolist(), each, 1, 1, upper=1),
            optimum(13),
        ),
        "general columns": (
            whole([-5, -4], [[6, 4], [1, 2]], row_upper=[24, 6], upper=9),
            optimum(-20, (4, 0)),
        ),
        "general columns, infinite bounds": (
            whole([-5, -4], [[6, 4], [1, 2]], row_upper=[24, 6]),
            optimum(-20, (4, 0)),
        ),
        "negative columns": (
            whole([3, 2], [[2, 3]], row_lower=[-7.5], lower=-10, upper=10),
            optimum(-20, (-10, 5)),
        ),
        "fractional bounds": (
            whole([1, -1], [[1, 1]], row_upper=[9], lower=0.5, upper=3.5),
            optimum(-2, (1, 3)),
        ),
        "two-sided rows and an offset": (
            whole(
                [4, 3, 5, 2], [[1, 1, 1, 1], [1, -1, 1, -1]], [3, -1], [4, 1], upper=2, offset=-100
            ),
            optimum(-92, (1, 0, 0, 2)),
        ),
        "decimal coefficients": (
            whole([-0.3, -0.7, -0.5], [[0.1, 0.25, 0.2]], row_upper=[0.6], upper=3),
            optimum(-1.7, (1, 2, 0)),
        ),
        "equality with one solution": (
            whole([1, 1], [[7, 11]], [100], [100], upper=20),
            optimum(12, (8, 4)),
        ),
        "empty objective": (
            whole([0, 0], [[3, 5]], [11], [11], upper=9, offset=2),
            optimum(2, (2, 1)),
        ),
        "no rows": (
            whole([1, -1], np.zeros((0, 2)), lower=-2, upper=3),
            optimum(-5, (-2, 3)),
        ),
        "empty rows": (
            whole([1, -2], [[0, 0], [1, 1]], [-1, -INF], [1, 3], upper=2),
            optimum(-4, (0, 2)),
        ),
    }
    mixed = {
        "facility location": (
            program(
                # Two sites (opening costs 4 and 3) and three customers of demand 1, served in parts.
                [4, 3, 1, 2, 3, 3, 2, 1],
                [
                    [0, 0, 1, 0, 0, 1, 0, 0],
                    [0, 0, 0, 1, 0, 0, 1, 0],
                    [0, 0, 0, 0, 1, 0, 0, 1],
                    [3, 0, -1, -1, -1, 0, 0, 0],
                    [0, 2, 0, 0, 0, -1, -1, -1],
                ],
                [1, 1, 1, 0, 0],
                [1, 1, 1, INF, INF],
                upper=[1, 1, *[INF] * 6],
                integral=[True, True, *[False] * 6],
            ),
            optimum(10),
        ),
        "continuous part decides": (
            program(
                [-1, -1],
                [[2, 2], [1, 0]],
                row_upper=[5, 2.25],
                integral=[True, False],
                upper=[9, INF],
            ),
            optimum(-2.5),
        ),
        "a switch below the tolerance": (_switch(), optimum(1)),
    }
    return [
        *tabled("integer: ", integer),
        *tabled("mixed: ", mixed),
        Case(
            "mixed: tight tolerance",
            program(
                [1, 1, 1],
                [[3, 0, 1], [0, 7, 1]],
                row_lower=[1, 1],
                upper=[INF, INF, 5],
                integral=[False, False, True],
                offset=0.5,
            ),
            optimum(0.5 + 1 / 3 + 1 / 7, (1 / 3, 1 / 7, 0)),
            arguments={"tolerance": 1e-8},
        ),
        *asked_for(
            "integer: ",
            _staircase(),
            Expectation((Termination.OPTIMAL,)),
            {"same seed, same answer": {"seed": 7}},
            others=({},),
            further=same_seed_same_answer,
        ),
        *asked_for(
            "integer: ",
            hard_knapsack(30, 8),
            optimum(-12414),
            {"another seed, another search": {"seed": 7}},
            others=({"seed": 1}, {"seed": 2}),
            further=seeds_differ,
        ),
    ]


def _knapsack(offset: float = 0.0) -> MixedIntegerProgram:
    return whole([-4, -2, -1, -10, -2], [[12, 2, 1, 4, 1]], row_upper=[15], upper=1, offset=offset)


def _switch() -> MixedIntegerProgram:
    # x <= 10**6 * open and x >= 1/2: open = 5e-7 is integer within a solver's usual tolerance, and
    # its objective is half a million times lower than the optimum.
    return program(
        [1, 0], [[1e6, -1]], row_lower=[0], lower=[0, 0.5], upper=[1, 10], integral=[True, False]
    )


def _staircase() -> MixedIntegerProgram:
    size = 16
    k = np.arange(size)
    weights = np.array([(17 * k + 5 * k * k) % 61 + 20, (29 * k + 3 * k * k) % 53 + 20])
    cost = -(weights.sum(axis=0) + (7 * k) % 11)
    return whole(cost.tolist(), weights, row_upper=weights.sum(axis=1) // 2, upper=1)


def _unsolvable() -> list[Case]:
    infeasible = {
        "integer: infeasible, its relaxation feasible": whole([1, 1], [[2, 4]], [7], [7], upper=10),
        "integer: no whole number within the bounds": whole(
            [1, 1], [[1, 1]], row_lower=[0], lower=[0.3, 0], upper=[0.7, 4]
        ),
        # The first row is even on the left-hand side and odd on the right-hand side.
        "integer: infeasible by search": whole(
            [1] * 5, [[2, 4, 6, 8, 10], [1, -1, 1, -1, 1]], [21, -3], [21, 3], upper=4
        ),
        "mixed: infeasible, its relaxation unbounded": program(
            [0, 0, -1],
            [[2, -2, 0], [1, 1, 0]],
            [1, 1],
            [1, INF],
            upper=[3, 3, INF],
            integral=[True, True, False],
        ),
    }
    unbounded = {
        "integer: unbounded": whole([-1, 0], [[1, -1]], row_upper=[0.5]),
        "mixed: unbounded": program(
            [1, -1], [[1, 0]], row_lower=[1], upper=[4, INF], integral=[True, False]
        ),
    }
    return unsolvable("", infeasible, unbounded)


def _cutoffs() -> list[Case]:
    solved = Expectation((Termination.OPTIMAL,), 985, point=(0, 1, 1, 1, 1))
    below_optimum = Expectation((Termination.NO_SOLUTION,), 985)
    requests = {"at the optimum": {"cutoff": 985.0}, "above the optimum": {"cutoff": 987.5}}
    requests_below = {"nothing below": {"cutoff": 984.5}}
    linear = program([1, 1], [[1, 1]], row_lower=[5], offset=10)
    linear_bound = Expectation((Termination.NO_SOLUTION,), 15)
    return [
        *asked_for("cutoff: ", _knapsack(1000), solved, requests),
        *asked_for(
            "cutoff: ", _knapsack(1000), below_optimum, requests_below, further=_cutoff_is_bound
        ),
        *asked_for("cutoff: ", linear, linear_bound, {"linear program": {"cutoff": 14.0}}),
    ]


def _cutoff_is_bound(case: Case, run: Run) -> str | None:
    cutoff, bound = run.request.cutoff, run.answer.dual_bound
    if Feature.DUAL_BOUND not in run.features or cutoff is None:
        return None
    if bound is None or abs(bound - cutoff) > 1e-6 * abs(cutoff):
        return f"nothing lies below the cutoff {cutoff!r}, yet the dual bound is {bound!r}"
    return None
