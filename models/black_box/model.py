"""Minimisation of a function of bounded variables that is known only by its values.

Source of the test functions and of the algorithms' setting: "The Robot Path Planning Based on Improved
Artificial Fish Swarm Algorithm", Mathematical Problems in Engineering 2016, article 3297585, doi
10.1155/2016/3297585.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Optional, Real, Whole, declared, required, show
from ..inputs import Field, FloatArray, FloatsOrNone
from ..model import Model
from ..records import Several
from ..verification import TOLERANCE, Verification, check_tolerance
from .checks import verify
from .function_spec import FunctionSpec
from .functions import BlackBoxFunction
from .oracle import Oracle
from .plan import BlackBoxPoint
from .variables import Layout, Variable, VariableSpec

__all__ = ["BlackBoxMinimisation"]

Floats = NDArray[np.float64]

#: Largest number of variables.
MOST = 10_000
#: Largest number of objectives: the effort of the exact hypervolume grows with a power of it.
MOST_OBJECTIVES = 4


@dataclass(frozen=True, eq=False, repr=False)
class BlackBoxMinimisation(Model[BlackBoxPoint]):
    """Minimisation of a black-box function within bounds, with a limited number of evaluations.

    Backends never receive the function. They request values, which the model's oracle counts. The function may
    be noisy or discontinuous.
    Points without a value (NaN, infinity) are worse than all others.

    Parameters
    ----------
    function : str, mapping, callable or None
        Name of a test function, such as ``"rastrigin"``, its data (:class:`Named`), the length of a
        path among obstacles (:class:`WaypointPath`), or a callable (:class:`PythonFunction`). Hidden
        from backends. With None the model serves :func:`crosstrack.prepare` only.
    bounds : ndarray, shape (d, 2)
        Lower and upper bound of each variable; equal bounds fix the variable.
    budget : int
        Largest number of evaluations of a run, >= 1.
    samples : int
        Number of evaluations that the verification averages; more than 1 for a noisy Python
        function.
    variables : list of str, mapping or Variable, optional
        One kind per row of `bounds`: ``"real"``, ``"integer"``, or ``{"type": "category", "values":
        [...]}`` with bounds [0, m - 1]; the function receives the index of the value. With ``"when":
        {"variable": k, "in": [...]}`` a variable matters only if variable `k` has one of these values,
        and has its lower bound otherwise. By default all variables are real.
    inequalities, equalities : int
        Number of constraints g(x) <= 0 and h(x) = 0. The function then returns a 1-D array of objectives,
        inequalities and equalities. Inequalities must hold exactly.
    equality_tolerance : float
        Largest accepted |h(x)|, in the unit of h, > 0.
    objectives : int
        Number of objectives, from 1 to 4. The objective of a model with several ones is minus the
        hypervolume of a front.
    reference : ndarray, shape (objectives,), optional
        Reference point of the hypervolume: values that are just not acceptable. Required for several
        objectives.
    repeats : int
        Number of evaluations per requested point, more than 1 for a noisy function; backends receive their
        mean. Each evaluation counts against the budget.

    Raises
    ------
    InvalidData
        The bounds are reversed or not finite, or the function is unknown or has another number of
        variables or values. The message names field, place and value.

    Examples
    --------
    >>> from crosstrack.models import BlackBoxMinimisation
    >>> model = BlackBoxMinimisation("booth", [[-10, 10], [-10, 10]], budget=500)
    >>> print(model.describe())
    2 variables, 500 evaluations
    >>> print(model.verify(model.as_plan({"x": [1, 3]})).objective)
    0.0
    """

    function: Field[
        str | Mapping[str, Any] | Callable[..., Any] | BlackBoxFunction | None, BlackBoxFunction
    ] = declared(FunctionSpec(), hidden=True)
    bounds: FloatArray = declared(Array(("d", 2)))
    budget: int = declared(Whole(1, 10**9), default=10_000)
    samples: int = declared(Whole(1, 10**6), default=1)
    variables: Field[
        Sequence[str | Mapping[str, Any] | Variable] | None, tuple[Variable, ...] | None
    ] = declared(Optional(Several(VariableSpec(), "d")), default=None, added=True)
    inequalities: int = declared(Whole(0, 1000), default=0, added=True)
    equalities: int = declared(Whole(0, 1000), default=0, added=True)
    equality_tolerance: float = declared(Real(0, strict=True), default=1e-4, added=True)
    objectives: int = declared(Whole(1, MOST_OBJECTIVES), default=1, added=True)
    reference: FloatsOrNone = declared(Optional(Array(("objectives",))), default=None, added=True)
    repeats: int = declared(Whole(1, 10**6), default=1, added=True)

    kind: ClassVar[str] = "black-box"
    plan_type: ClassVar[type] = BlackBoxPoint

    def check(self) -> None:
        """Raise for empty bounds, and for functions with another number of variables."""
        if not 1 <= self.dimension <= MOST:
            raise InvalidData(
                f"bounds must have 1 … {MOST} rows, got {self.dimension}", field="bounds"
            )
        with np.errstate(over="ignore"):
            width = self.highs - self.lows
        bad = np.flatnonzero((width < 0) | ~np.isfinite(width))
        if bad.size:
            k = int(bad[0])
            raise InvalidData(
                f"bounds[{k}] must be the least and the greatest value, not reversed and with a "
                f"difference that is a number, got {show(self.bounds[k].tolist())}",
                field="bounds",
            )
        _ = self.layout  # checks the variables
        count = 0 if self.reference is None else len(self.reference)
        if count != (self.objectives if self.objectives > 1 else 0):
            needed = f"{self.objectives} numbers" if self.objectives > 1 else "None"
            raise InvalidData(
                f"reference must be {needed} for {self.objectives} "
                f"objective{'s' * (self.objectives > 1)}, got "
                f"{show(None if self.reference is None else self.reference.tolist())}",
                field="reference",
            )
        if self.repeats > self.budget:
            raise InvalidData(
                f"repeats must be at most the budget of {self.budget}, got {self.repeats}",
                field="repeats",
            )
        self.function.check_columns(self.columns)
        self.function.check_dimension(self.dimension)

    @cached_property
    def layout(self) -> Layout:
        """Checked variables, with their rounding and their conditions."""
        return Layout(self.variables, self.bounds)

    @property
    def columns(self) -> int:
        """Number of values per point: objectives, inequalities, equalities."""
        return self.objectives + self.inequalities + self.equalities

    @property
    def dimension(self) -> int:
        """Number of variables."""
        return len(self.bounds)

    @property
    def lows(self) -> Floats:
        """Lower bound of each variable, shape (d,)."""
        return self.bounds[:, 0]

    @property
    def highs(self) -> Floats:
        """Upper bound of each variable, shape (d,)."""
        return self.bounds[:, 1]

    def oracle(self) -> Callable[[Floats], Floats]:
        """Return the oracle of a run: from points of shape (m, d) to values of shape (m, columns).

        The columns are objectives, inequalities and equalities. It rejects points outside of the bounds or
        with values that their variables do not have, and requests that exceed :attr:`budget` in total.
        """
        return Oracle(self)

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def verify(self, plan: BlackBoxPoint, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective from new evaluations, without noise if it is known, and the checks.

        Parameters
        ----------
        plan : BlackBoxPoint
            Point, or front of a model with several objectives.
        tolerance : float
            Tolerance of the bounds, relative to the range of a variable. Whole numbers, conditions and
            inequalities must hold exactly, and equalities within their own tolerance.
        """
        check_tolerance(tolerance)
        required("plan", plan, BlackBoxPoint)
        return verify(self, plan, tolerance)

    def describe(self) -> str:
        """Return the size in a few words."""
        parts = [_count(self.dimension, "variable")]
        discrete = int(self.layout.discrete.sum())
        if discrete:
            parts[0] += f" ({discrete} discrete)"
        if self.objectives > 1:
            parts.append(f"{self.objectives} objectives")
        if self.inequalities:
            parts.append(_count(self.inequalities, "inequality", "inequalities"))
        if self.equalities:
            parts.append(_count(self.equalities, "equality", "equalities"))
        each = f", {self.repeats} per point" if self.repeats > 1 else ""
        return f"{', '.join(parts)}, {_count(self.budget, 'evaluation')}{each}"


def _count(number: int, one: str, several: str = "") -> str:
    return f"{number} {one if number == 1 else several or one + 's'}"
