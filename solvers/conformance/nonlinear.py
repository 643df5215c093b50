"""Conformance cases: small nonlinear programs with known local optima and multipliers.

Names of HS and a number refer to W. Hock and K. Schittkowski, *Test Examples for Nonlinear
Programming Codes*, Springer, 1981. Importing this module does not load CasADi; building a case does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Termination
from .cases import Case, Expectation, Table, asked_for, tabled
from .limits import same_seed_same_answer, seeds_differ
from .nonlinear_hard import (
    ENDS,
    chain_case,
    hard_cases,
    known,
    nonlinear,
    nonlinear_limit_cases,
    unsolvable_cases,
)

__all__ = ["nonlinear_cases"]

INF = np.inf


def nonlinear_cases() -> tuple[Case, ...]:
    """Return the cases. Known multipliers are judged as well."""
    table = {**_classic(), **_plain(), **_scaled(), **hard_cases()}
    primal = [*tabled("nonlinear: ", table), chain_case()]
    judged = [
        replace(case, duals=Termination.FEASIBLE not in case.expectation.termination)
        for case in primal
    ]
    return (*judged, *unsolvable_cases(), *_asked_for(), *nonlinear_limit_cases())


def rosenbrock(x: Any) -> Any:
    """Return the Rosenbrock function of the first two columns."""
    return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2


def hs71(x: Any) -> tuple[Any, list[Any]]:
    """Return the objective and the rows of HS071."""
    product, squares = x[0] * x[1] * x[2] * x[3], x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + x[3] ** 2
    return x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2], [product, squares]


#: HS071: optimal objective, point and multipliers.
HS71 = (
    17.0140172891563,
    (1.0, 4.742999637264417, 3.8211499841848737, 1.3794082931726723),
    (0.5522936601207268, -0.16146856677050578),
)


def _hs71(pose: Callable[[Any], Any] = hs71, **changes: Any) -> NonlinearProgram:
    given: dict[str, Any] = {
        "guess": [1, 5, 5, 1],
        "row_lower": [25, 40],
        "row_upper": [INF, 40],
        "lower": 1,
        "upper": 5,
    }
    return nonlinear(pose, **{**given, **changes})


def _classic() -> Table:
    def hs43(x: Any) -> tuple[Any, list[Any]]:
        f = x[0] ** 2 + x[1] ** 2 + 2 * x[2] ** 2 + x[3] ** 2
        f = f - 5 * x[0] - 5 * x[1] - 21 * x[2] + 7 * x[3]
        a = x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + x[3] ** 2 + x[0] - x[1] + x[2] - x[3]
        b = x[0] ** 2 + 2 * x[1] ** 2 + x[2] ** 2 + 2 * x[3] ** 2 - x[0] - x[3]
        c = 2 * x[0] ** 2 + x[1] ** 2 + x[2] ** 2 + 2 * x[0] - x[1] - x[3]
        return f, [a, b, c]

    def hs100(x: Any) -> tuple[Any, list[Any]]:
        f = (x[0] - 10) ** 2 + 5 * (x[1] - 12) ** 2 + x[2] ** 4 + 3 * (x[3] - 11) ** 2
        f = f + 10 * x[4] ** 6 + 7 * x[5] ** 2 + x[6] ** 4
        f = f - 4 * x[5] * x[6] - 10 * x[5] - 8 * x[6]
        a = 2 * x[0] ** 2 + 3 * x[1] ** 4 + x[2] + 4 * x[3] ** 2 + 5 * x[4]
        b = 7 * x[0] + 3 * x[1] + 10 * x[2] ** 2 + x[3] - x[4]
        c = 23 * x[0] + x[1] ** 2 + 6 * x[5] ** 2 - 8 * x[6]
        d = 4 * x[0] ** 2 + x[1] ** 2 - 3 * x[0] * x[1] + 2 * x[2] ** 2 + 5 * x[5] - 11 * x[6]
        return f, [a, b, c, d]

    def hs35(x: Any) -> tuple[Any, list[Any]]:
        f = 9 - 8 * x[0] - 6 * x[1] - 4 * x[2] + 2 * x[0] ** 2 + 2 * x[1] ** 2 + x[2] ** 2
        return f + 2 * x[0] * x[1] + 2 * x[0] * x[2], [x[0] + x[1] + 2 * x[2]]

    return {
        "Rosenbrock, no rows": (
            nonlinear(lambda x: (rosenbrock(x), []), [-1.2, 1]),
            known(0.0, (1, 1), ()),
        ),
        "Rosenbrock in the unit disk": (
            nonlinear(lambda x: (rosenbrock(x), [x[0] ** 2 + x[1] ** 2]), [-0.5, 0.5], row_upper=1),
            known(
                0.04567480871950022,
                (0.7864151541684279, 0.6176983125233935),
                (-0.12149655699928838,),
            ),
        ),
        "HS071": (_hs71(), known(*HS71)),
        "HS006": (
            nonlinear(lambda x: ((1 - x[0]) ** 2, [10 * (x[1] - x[0] ** 2)]), [-1.2, 1], 0, 0),
            known(0.0, (1, 1), (0,)),
        ),
        "HS007": (
            nonlinear(
                lambda x: (_log1p(x[0] ** 2) - x[1], [(1 + x[0] ** 2) ** 2 + x[1] ** 2]),
                [2, 2],
                4,
                4,
            ),
            known(-np.sqrt(3), (0, np.sqrt(3)), (-0.5 / np.sqrt(3),)),
        ),
        "HS035, a convex quadratic program": (
            nonlinear(hs35, [0.5, 0.5, 0.5], row_upper=3, lower=0),
            known(1 / 9, (4 / 3, 7 / 9, 4 / 9), (-2 / 9,)),
        ),
        "HS043, Rosen and Suzuki": (
            nonlinear(hs43, [0, 0, 0, 0], row_upper=[8, 10, 5]),
            known(-44.0, (0, 1, 2, -1), (-1, 0, -2)),
        ),
        "HS100": (
            nonlinear(hs100, [1, 2, 0, 4, 0, 1, 1], row_upper=[127, 282, 196, 0]),
            known(
                680.630057374402,
                (
                    2.33049937287957,
                    1.9513723728968888,
                    -0.47754139238887156,
                    4.36572623365581,
                    -0.6244869705268175,
                    1.0381310186079584,
                    1.5942267116118685,
                ),
                (-1.139719959167376, 0, 0, -0.36861451718721144),
            ),
        ),
    }


def _log1p(value: Any) -> Any:
    import casadi

    return casadi.log1p(value)


def _plain() -> Table:
    def circle(x: Any) -> tuple[Any, list[Any]]:
        return (x[0] - 1) ** 2 + (x[1] - 2) ** 2, [x[0] + x[1], x[0] ** 2 + x[1] ** 2]

    return {
        "bounds bind": (
            nonlinear(lambda x: ((x[0] + 1) ** 3 / 3 + x[1], []), [1.125, 0.125], lower=[1, 0]),
            known(8 / 3, (1, 0), ()),
        ),
        "rows that do not bind": (
            nonlinear(circle, [5, 5], [-10, -INF], [INF, 100]),
            known(0.0, (1, 2), (0, 0)),
        ),
        "a linear program": (
            nonlinear(
                lambda x: (-3 * x[0] - 5 * x[1], [x[0], 2 * x[1], 3 * x[0] + 2 * x[1]]),
                [1, 1],
                row_upper=[4, 12, 18],
                lower=0,
            ),
            known(-36.0, (2, 6), (0, -1.5, -1)),
        ),
        "rows with two sides": (
            nonlinear(
                lambda x: ((x[0] - 3) ** 2 + (x[1] - 1) ** 2, [x[0] ** 2 + x[1], x[0] - x[1]]),
                [0, 0],
                [-1, -2],
                [1, 2],
            ),
            known(5.0, (1, 0), (-2, 0)),
        ),
        "rows without bounds": (
            _hs71(
                lambda x: (hs71(x)[0], [*hs71(x)[1], x[0] - x[3]]),
                row_lower=[25, 40, -INF],
                row_upper=[INF, 40, INF],
            ),
            known(HS71[0], HS71[1], (*HS71[2], 0.0)),
        ),
        "a fixed column": (_hs71(upper=[1, 5, 5, 5]), known(HS71[0], HS71[1], HS71[2])),
        "every column fixed": (
            nonlinear(
                lambda x: (x[0] ** 2 + x[1], [x[0] + x[1]]),
                [0, 0],
                row_upper=4,
                lower=[1, 2],
                upper=[1, 2],
            ),
            known(3.0, (1, 2), None),
        ),
        "no objective": (
            nonlinear(
                lambda x: (0 * x[0], [x[0] ** 2 + x[1] ** 2, x[0] - x[1]]),
                [2, 1],
                [1, 0],
                [1, 0],
                lower=0,
            ),
            known(0.0, (np.sqrt(0.5), np.sqrt(0.5)), (0, 0)),
        ),
        "a constant added": (
            nonlinear(lambda x: ((x[0] - 3) ** 2 + 1e3, []), [0], lower=0),
            known(1e3, (3,), ()),
        ),
        "many hills, six local optima": _hills(),
    }


def _hills() -> tuple[NonlinearProgram, Expectation]:
    def camel(x: Any) -> tuple[Any, list[Any]]:
        f = (4 - 2.1 * x[0] ** 2 + x[0] ** 4 / 3) * x[0] ** 2 + x[0] * x[1]
        return f + (4 * x[1] ** 2 - 4) * x[1] ** 2, []

    optima = (-1.0316284534898774, -0.21546382438371792, 2.104250310311258)
    return (
        nonlinear(camel, [1.2, 0.9], lower=[-3, -2], upper=[3, 2]),
        Expectation(ENDS, optima[0], objectives=optima),
    )


def _scaled() -> Table:
    """Return HS071 in units that make its columns, rows and objective very large or small."""
    units = np.array([1e-4, 1e3, 1.0, 1e5])

    def posed(x: Any) -> tuple[Any, list[Any]]:
        f, rows = hs71([x[k] / units[k] for k in range(4)])
        return 1e4 * f, [1e-3 * rows[0], 1e3 * rows[1]]

    return {
        "badly scaled, its scales given": (
            nonlinear(
                posed,
                np.array([1, 5, 5, 1]) * units,
                [25e-3, 40e3],
                [INF, 40e3],
                lower=units,
                upper=5 * units,
                column_scale=units,
                row_scale=[1e-3, 1e3],
                objective_scale=1e4,
            ),
            known(
                1e4 * HS71[0], tuple(np.array(HS71[1]) * units), (1e7 * HS71[2][0], 10 * HS71[2][1])
            ),
        )
    }


def _asked_for() -> list[Case]:
    requests: dict[str, dict[str, Any]] = {
        "tight tolerance": {"tolerance": 1e-9},
        "warm start at the optimum": {"warm_start": np.array(HS71[1])},
        "warm start elsewhere": {"warm_start": np.array([1.0, 5.0, 5.0, 1.0])},
    }
    return [
        *asked_for(
            "nonlinear: many hills, ",
            *_hills(),
            {"from a seed": {"seed": 7}},
            others=({},),
            further=same_seed_same_answer,
        ),
        *asked_for(
            "nonlinear: ",
            *_hills(),
            {"another seed, another search": {"seed": 7}},
            others=({"seed": 1}, {"seed": 2}),
            further=seeds_differ,
        ),
        *asked_for("nonlinear: ", _hs71(), known(*HS71), requests),
    ]
