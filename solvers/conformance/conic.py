"""Conformance cases: conic programs with known optimum, infeasible and unbounded ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ..contract.backend import Feature, Termination
from .cases import Case, Table, asked_for, ended, optimum, tabled
from .quadratic import quadratic

__all__ = ["conic", "conic_cases"]

INF = np.inf
ROOT = float(np.sqrt(2.0))

BALL, EXP, PSD = ConeKind.SECOND_ORDER, ConeKind.EXPONENTIAL, ConeKind.SEMIDEFINITE
#: Kind of a cone, coefficients of its rows, and their constants.
Cone = tuple[ConeKind, Any, Sequence[float]]


def conic(cost: Sequence[float], cones: Sequence[Cone], **others: Any) -> ConicProgram:
    """Return a program from dense data, with one block for every cone.

    `others` are arguments of :func:`~crosstrack.solvers.conformance.quadratic.quadratic`, with ``hessian`` and
    ``matrix`` by name.
    """
    size = len(cost)
    hessian = others.pop("hessian", np.zeros(size))
    program = quadratic(hessian, cost, others.pop("matrix", ()), **others)
    blocks, start = [], 0
    for number, (kind, _, offset) in enumerate(cones):
        blocks.append(ConeBlock(f"cone {number}", "", start, len(offset), kind=kind))
        start += len(offset)
    rows = [np.reshape(np.asarray(m, float), (len(offset), size)) for _, m, offset in cones]
    return ConicProgram(
        cone_matrix=sp.csr_array(np.vstack([np.zeros((0, size)), *rows])),
        cone_offset=np.concatenate([np.zeros(0), *(offset for _, _, offset in cones)]),
        cones=tuple(blocks),
        hessian=program.hessian,
        **program.shared(),
    )


def conic_cases() -> tuple[Case, ...]:
    """Return the cases. Cases with an optimum are repeated for backends with duals."""
    primal = tabled("conic: ", {**_balls(), **_other_cones(), **_delicate()})
    dual = [
        replace(case, name=f"{case.name}, duals", needs=frozenset({Feature.DUALS}))
        for case in primal
    ]
    return (*primal, *dual, *_unsolvable(), *_weak(), *_asked_for())


#: ``|x| <= 1`` in the plane.
DISC: Cone = (BALL, [[0, 0], [1, 0], [0, 1]], [1, 0, 0])
#: ``x y >= 1`` with both positive: ``x + y >= |(x - y, 2)|``.
HYPERBOLA: Cone = (BALL, [[1, 1], [1, -1], [0, 0]], [0, 0, 2])


def _balls() -> Table:
    around = [(0, 0), (4, 0), (2, 1), (3, -1)]
    return {
        "linear objective over a disc": (
            conic([1, 1], [DISC]),
            optimum(-ROOT, (-1 / ROOT, -1 / ROOT), (ROOT, 1, 1)),
        ),
        "quadratic objective over a disc": (
            conic([-3, -4], [(BALL, DISC[1], [2, 0, 0])], hessian=[1, 1]),
            optimum(-8, (1.2, 1.6), (3, -1.8, -2.4)),
        ),
        # The columns are the coordinates of the centre and the radius.
        "smallest enclosing ball": (
            conic(
                [0, 0, 1],
                [
                    (BALL, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], [0.0, -float(x), -float(y)])
                    for x, y in around
                ],
            ),
            optimum(2, (2, 0, 2)),
        ),
        # The columns are a point in the disc around (5, 3) and the lengths of both legs.
        "shortest path by way of a disc": (
            conic(
                [0, 0, 1, 1],
                [
                    (BALL, [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]], [0, 0, 0]),
                    (BALL, [[0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 0, 0]], [0, -10, 0]),
                    (BALL, [[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], [1, -5, -3]),
                ],
            ),
            optimum(2 * 29**0.5, (5, 2, 29**0.5, 29**0.5)),
        ),
        "portfolio within a distance of another": (
            conic(
                [-1, 0],
                [(BALL, DISC[1], [0.1 * ROOT, -0.5, -0.5])],
                hessian=[1, 1],
                matrix=[[1, 1]],
                row_lower=1,
                row_upper=1,
                lower=0,
            ),
            optimum(-0.34, (0.6, 0.4)),
        ),
        # t^2 <= x y as x + y >= |(x - y, 2 t)|.
        "geometric mean": (
            conic(
                [0, 0, -1],
                [(BALL, [[1, 1, 0], [1, -1, 0], [0, 0, 2]], [0, 0, 0])],
                matrix=[[1, 2, 0]],
                row_upper=4,
            ),
            optimum(-ROOT, (2, 1, ROOT)),
        ),
    }


def _other_cones() -> Table:
    return {
        "entropy": (_entropy(3), optimum(-np.log(3), (*[np.log(3) / 3] * 3, *[1 / 3] * 3))),
        # exp(k - t) <= u_k, and the sum of u is at most 1.
        "logarithm of a sum of exponentials": (
            conic(
                [1, 0, 0, 0],
                [
                    (EXP, [[-1, 0, 0, 0], [0] * 4, np.eye(4)[k].tolist()], [float(k), 1, 0])
                    for k in (1, 2, 3)
                ],
                matrix=[[0, 1, 1, 1]],
                row_upper=1,
            ),
            optimum(float(np.logaddexp.reduce([1, 2, 3]))),
        ),
        "cut of a triangle": (_correlation([0.5] * 3), optimum(-0.75, (-0.5,) * 3)),
        "nearest correlation matrix": (
            _correlation([1, 1, 1], hessian=[1, 1, 1], offset=1.5),
            optimum(0.375, (-0.5,) * 3),
        ),
        "least eigenvalue": (
            conic([-1], [(PSD, [[-1], [0], [-1]], [2, ROOT, 2])]),
            optimum(-1, (1,)),
        ),
        "all cones, a fixed column and rows without entries": (
            conic(
                [1, 1, 1, 1],
                [
                    (EXP, [[0, 0, 0, 1], [0] * 4, [1, 0, 0, 0]], [0, 1, 0]),
                    (PSD, [[0, 0, 0, 0], [0, ROOT, 0, 0], [0, 0, 0, 0]], [1, 0, 4]),
                    (BALL, [[0, 0, 1, 0], [0, 0, 0, 1]], [0, 0]),
                ],
                matrix=[[0, 0, 0, 0], [0, 0, 1, 0]],
                row_lower=[-1, -INF],
                row_upper=[1, INF],
                lower=[-INF, -INF, -INF, 2],
                upper=[INF, INF, INF, 2],
            ),
            optimum(np.exp(2) + 2, (np.exp(2), -2, 2, 2)),
        ),
    }


def _entropy(size: int) -> ConicProgram:
    """Return the program of maximal entropy of `size` shares; its columns are the terms, then the shares."""
    unit = np.eye(2 * size)
    none = np.zeros(2 * size)
    cones: list[Cone] = [(EXP, [unit[k], unit[size + k], none], [0, 0, 1]) for k in range(size)]
    total = np.concatenate([np.zeros(size), np.ones(size)])
    return conic([-1.0] * size + [0.0] * size, cones, matrix=[total], row_lower=1, row_upper=1)


def _correlation(cost: Sequence[float], **others: Any) -> ConicProgram:
    """Return a program over the three off-diagonal entries of a correlation matrix."""
    rows = np.zeros((6, 3))
    rows[[1, 3, 4], [0, 1, 2]] = ROOT
    return conic(cost, [(PSD, rows, [1, 0, 1, 0, 0, 1])], **others)


def _delicate() -> Table:
    straight = [(0.0, 0.0), (3.0, 1.0), (6.0, -1.0), (9.0, 0.0)]
    return {
        "optimum at the apex": (conic([0, 1], [(BALL, [[0, 1], [1, 0]], [0, 0])]), optimum(0)),
        "the same cone twice, and one of one row": (
            conic([1, 1], [DISC, DISC, (BALL, [[-1, 0]], [0.5])]),
            optimum(-ROOT, (-1 / ROOT, -1 / ROOT)),
        ),
        "straight path through discs": (_path(straight, 1.5), optimum(9)),
        "small disc": (conic([1, 1], [(BALL, DISC[1], [1e-6, 0, 0])]), optimum(-1e-6 * ROOT)),
        "large disc": (conic([1, 1], [(BALL, DISC[1], [1e6, 0, 0])]), optimum(-1e6 * ROOT)),
        "badly scaled columns": (
            conic([-1e-6, -1e6], [(BALL, [[0, 0], [1e-6, 0], [0, 1e6]], [1, 0, 0])]),
            optimum(-ROOT),
        ),
        "every column fixed": (
            conic([1, 1], [DISC], lower=[0.6, 0.0], upper=[0.6, 0.0]),
            optimum(0.6, (0.6, 0)),
        ),
        "no columns": (conic([], [(BALL, [], [5, 3, 4])], offset=3), optimum(3, ())),
        "no cones": (
            conic([-6, 0], [], hessian=[1, 1], matrix=[[1, 1], [1, -1]], row_upper=[4, 2]),
            optimum(-13, (3, 1), (-1, -2)),
        ),
    }


def _path(centers: Sequence[tuple[float, float]], radius: float) -> ConicProgram:
    """Return the shortest path from the first to the last point through discs around the others.

    The columns are the points in the discs, and then the lengths of the legs.
    """
    stops, legs = len(centers) - 2, len(centers) - 1
    size = 2 * stops + legs
    ends = np.array([centers[0], centers[-1]])
    cones: list[Cone] = []
    for leg in range(legs):
        rows, offset = np.zeros((3, size)), np.zeros(3)
        rows[0, 2 * stops + leg] = 1.0
        for place, sign in ((leg, 1.0), (leg - 1, -1.0)):
            if 0 <= place < stops:
                rows[[1, 2], [2 * place, 2 * place + 1]] = sign
            else:
                offset[1:] += sign * ends[int(place >= stops)]
        cones.append((BALL, rows, offset.tolist()))
    for stop in range(stops):
        rows = np.zeros((3, size))
        rows[[1, 2], [2 * stop, 2 * stop + 1]] = 1.0
        x, y = centers[stop + 1]
        cones.append((BALL, rows, [radius, -x, -y]))
    return conic([0.0] * (2 * stops) + [1.0] * legs, cones)


def _unsolvable() -> list[Case]:
    apart: Cone = (BALL, DISC[1], [1, -3, 0])
    infeasible = {
        "two discs apart": conic([1, 1], [DISC, apart]),
        "by a thousandth": conic([1, 1], [DISC], matrix=[[1, 0]], row_lower=1.001),
        "small discs apart": conic([1, 1], [(BALL, DISC[1], [1e-6, 0, 0])], lower=[2e-6, -INF]),
        "within the bounds": conic([1, 1], [DISC], lower=0.8),
        "its objective unbounded": conic(
            [0, 0, -1], [(BALL, np.eye(3)[[2, 0, 1]], [0, 0, 0])], matrix=[[0, 0, 1]], row_upper=-1
        ),
        "crossed bounds": conic([1, 1], [DISC], lower=[0, 3], upper=[5, 2]),
        "an exponential below zero": conic([0], [(EXP, [[1], [0], [0]], [0, 1, -1])]),
        "three negative correlations": _correlation([1, 1, 1], upper=-0.6),
        "fixed columns outside": conic([1, 1], [DISC], lower=0.8, upper=0.8),
        "constants outside": conic([], [(BALL, [], [4.9, 3, 4])]),
    }
    unbounded = {
        "within a hyperbola": conic([-1, 1], [HYPERBOLA]),
        "outside of a disc's columns": conic([1, 0, -1], [(BALL, [[0] * 3, *np.eye(3)[:2]], [1, 0, 0])]),
        "along a matrix": conic([-1, -1], [(PSD, [[1, 0], [0, 0], [0, 1]], [0, ROOT, 0])]),
        "where the objective is flat": conic([0, -1], [HYPERBOLA], hessian=[1, 0]),
    }  # fmt: skip
    # The objective decreases like a logarithm: no ray proves it, and no point is optimal.
    slow = {"along a logarithm": conic([-1, 0], [(EXP, [[1, 0], [0, 0], [0, 1]], [0, 1, 0])])}
    unproven = (Termination.FEASIBLE, Termination.NO_SOLUTION, Termination.FAILED)
    return [
        *ended("conic, infeasible: ", infeasible, Termination.INFEASIBLE),
        *ended("conic, unbounded: ", unbounded, Termination.UNBOUNDED),
        *ended("conic, unbounded: ", slow, *unproven),
    ]


def _weak() -> list[Case]:
    """Return weakly infeasible programs, whose rows and cones have distance 0 but no common point.

    No ray proves the infeasibility. The last program has feasible points but attains no optimum.
    """
    none = (Termination.NO_SOLUTION, Termination.FAILED)
    zero: dict[str, Any] = {"matrix": [[1, 0]], "row_lower": 0, "row_upper": 0}
    fine = {**zero, "matrix": [[1e-3, 0]]}
    cases = {
        "the least y": conic([0, 1], [HYPERBOLA], **zero),
        "the least x": conic([1, 0], [HYPERBOLA], **zero),
        "as a bound": conic([0, 0], [HYPERBOLA], upper=[0, INF]),
        "a small coefficient": conic([0, 0], [HYPERBOLA], **fine),
        "as a matrix": conic([0], [(PSD, [[0], [0], [1]], [0, ROOT, 0])]),
    }
    open_ = {"an optimum that is not attained": conic([1, 0], [HYPERBOLA])}
    ends = (*none, Termination.FEASIBLE, Termination.OPTIMAL)
    return [
        *ended("conic, weakly infeasible: ", cases, *none, any_limit=True),
        *ended("conic: ", open_, *ends, floor=0.0, any_limit=True),
    ]


def _asked_for() -> list[Case]:
    at = (-1 / ROOT, -1 / ROOT)
    requests: dict[str, dict[str, Any]] = {
        "a small gap": {"gap": 1e-8},
        "tight tolerance": {"tolerance": 1e-8},
        "warm start at the optimum": {"warm_start": np.array(at)},
        "warm start outside": {"warm_start": np.array([5.0, -4.0])},
    }
    return asked_for("conic: ", conic([1, 1], [DISC]), optimum(-ROOT, at), requests)
