"""Minimisation of a function of bounded variables that is known only by its values.

Source of the test functions and of the algorithms' setting: "The Robot Path Planning Based on Improved
Artificial Fish Swarm Algorithm", Mathematical Problems in Engineering 2016, article 3297585, doi
10.1155/2016/3297585.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Whole, declared, required, show
from ..inputs import Field, FloatArray
from ..model import Model
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .functions import BlackBoxFunction, FunctionSpec
from .plan import BlackBoxPoint

__all__ = ["BlackBoxMinimisation"]

Floats = NDArray[np.float64]

#: Largest number of variables.
MOST = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class BlackBoxMinimisation(Model[BlackBoxPoint]):
    """Minimisation of a black-box function within bounds, with a limited number of evaluations.

    Backends never receive the function. They run in a separate process and request values, which
    are counted by the process that holds the function. The function may be noisy or discontinuous.
    Points without a value (NaN, infinity) are worse than all others.

    Parameters
    ----------
    function : str, mapping or callable
        Name of a test function, such as ``"rastrigin"``, its data (:class:`Named`), the length of a
        path among obstacles (:class:`WaypointPath`), or a callable (:class:`PythonFunction`). Hidden
        from backends.
    bounds : ndarray, shape (d, 2)
        Lower and upper bound of each variable; equal bounds fix the variable.
    budget : int
        Largest number of evaluations of a run, >= 1.
    samples : int
        Number of evaluations that the verification averages; more than 1 for a noisy Python
        function.

    Raises
    ------
    InvalidData
        The bounds are reversed or not finite, or the function is unknown or has another number of
        variables. The message names field, place and value.

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
        str | Mapping[str, Any] | Callable[..., Any] | BlackBoxFunction, BlackBoxFunction
    ] = declared(FunctionSpec(), hidden=True)
    bounds: FloatArray = declared(Array(("d", 2)))
    budget: int = declared(Whole(1, 10**9), default=10_000)
    samples: int = declared(Whole(1, 10**6), default=1)

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
        self.function.check_dimension(self.dimension)

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
        """Return the oracle of a run: from points of shape (m, d) to values of shape (m, 1).

        It rejects points outside of the bounds, and requests that exceed :attr:`budget` in total.
        """
        return _Evaluations(self)

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def verify(self, plan: BlackBoxPoint, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the value at the point, without noise if it is known, and the check of the bounds."""
        check_tolerance(tolerance)
        required("plan", plan, BlackBoxPoint)
        if len(plan.x) != self.dimension:
            raise InvalidData(f"x must have {self.dimension} entries, got {len(plan.x)}", field="x")
        x = np.array(plan.x)
        excess = np.maximum(self.lows - x, x - self.highs)
        # Relative to the range, or for equal bounds to their digits.
        scale = np.maximum(self.highs - self.lows, 1e-9 * np.abs(self.highs))
        bounds = Check.largest("bounds", excess, scale, "", lambda k: f"x[{k}]", tolerance)
        values = self.function.values(np.repeat(x[None], self.samples, axis=0))
        numbers = np.isfinite(values)
        number_check = Check.count("value is a number", [f"{v:g}" for v in values[~numbers]])
        spread = 2 * float(values.std(ddof=1)) / self.samples**0.5 if self.samples > 1 else 0.0
        if not numbers.all():
            return Verification(None, (bounds, number_check))
        return Verification(float(values.mean()), (bounds, number_check), spread)

    def describe(self) -> str:
        """Return the size in a few words."""
        several = "1 variable" if self.dimension == 1 else f"{self.dimension} variables"
        return f"{several}, {self.budget} evaluation{'s' if self.budget > 1 else ''}"


class _Evaluations:
    """Counted evaluations of one run."""

    def __init__(self, model: BlackBoxMinimisation) -> None:
        self.model = model
        self.left = model.budget
        self.noise = np.random.default_rng(model.scene_seeds(1)[0])

    def __call__(self, points: Floats) -> Floats:
        """Return the values at `points`, including the noise."""
        model = self.model
        if points.ndim != 2 or points.shape[1] != model.dimension:
            raise InvalidData(
                f"points must have shape (m, {model.dimension}), got {points.shape}", field="x"
            )
        if len(points) > self.left:
            raise InvalidData(
                f"budget: {len(points)} evaluations asked for, {self.left} of {model.budget} left",
                field="budget",
            )
        outside = ~((points >= model.lows) & (points <= model.highs))
        if outside.any():
            row, k = np.argwhere(outside)[0].tolist()
            raise InvalidData(
                f"x[{k}] must lie in [{model.lows[k]:g}, {model.highs[k]:g}], got "
                f"{show(float(points[row, k]))}",
                field="x",
            )
        self.left -= len(points)
        values = model.function.values(points)
        if model.function.noise:
            values = values + self.noise.normal(0.0, model.function.noise, len(points))
        return np.asarray(values, np.float64)[:, None]
