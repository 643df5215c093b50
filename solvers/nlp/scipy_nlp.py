"""Base of SciPy's two methods for constrained programs: the program as functions of arrays."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.nonlinear import NonlinearProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import Clock, Ended, Ending, limit_reached, stop_reason
from ..programs.casadi_plugins import last_line, vector
from .base import COMMON, NonlinearBackend
from .scaled import Scaled

__all__ = ["Posed", "ScipyNlp"]

Vector = NDArray[np.float64]


class _Stopped(Exception):
    """Exception that ends SciPy's search, which has no other reliable way to stop."""


class Posed:
    """Scaled program as functions of arrays that cache their last values.

    Every evaluation checks the clock and stop requests.

    Parameters
    ----------
    program : NonlinearProgram
        The program.
    limit_reached : callable
        Function that returns True if the run must stop.
    """

    def __init__(self, program: NonlinearProgram, limit_reached: Callable[[], bool]) -> None:
        self.scaled = Scaled(program)
        self.size, self.row_count = program.size, program.row_count
        self._over = limit_reached
        self._kept: dict[str, tuple[bytes, Any]] = {}
        self.last: Vector | None = None
        self.count = 0

    def _value(self, name: str, make: Callable[[], Any], z: Vector) -> Any:
        key = z.tobytes()
        cached = self._kept.get(name)
        if cached is not None and cached[0] == key:
            return cached[1]
        if self._over():
            raise _Stopped
        value = make()
        self._kept[name] = key, value
        return value

    def objective(self, z: Vector) -> float:
        """Return the scaled objective."""
        f, _ = self._value("f", lambda: self.scaled.gradient(z, []), z)
        return float(f)

    def gradient(self, z: Vector) -> Vector:
        """Return the gradient of the objective, shape (n,)."""
        _, gradient = self._value("f", lambda: self.scaled.gradient(z, []), z)
        return vector(gradient)

    def rows(self, z: Vector) -> Vector:
        """Return the rows, shape (m,)."""
        rows, _ = self._value("g", lambda: self.scaled.jacobian(z, []), z)
        return vector(rows)

    def jacobian(self, z: Vector) -> sp.csc_array:
        """Return the Jacobian of the rows, shape (m, n)."""
        _, jacobian = self._value("g", lambda: self.scaled.jacobian(z, []), z)
        return sp.csc_array(jacobian.sparse())

    def hessian(self, z: Vector, weight: float, duals: Vector) -> sp.csc_array:
        """Return the Hessian of ``weight f + duals·g``, both triangles, shape (n, n)."""
        upper = sp.csc_array(self.scaled.hessian(z, [], weight, duals).sparse())
        return sp.csc_array(upper + sp.triu(upper, 1).T)

    def seen(self, z: Vector) -> None:
        """Store `z` as the point of an iteration."""
        self.last, self.count = np.array(z, float), self.count + 1


class ScipyNlp(NonlinearBackend):
    """Base of the backends for ``scipy.optimize.minimize``."""

    requires = ("casadi",)
    distribution = "scipy"
    features = COMMON | {Feature.INTERRUPT}
    single_threaded: ClassVar[bool] = True

    @abstractmethod
    def search(
        self, posed: Posed, bounds: Mapping[str, Vector], request: Request, start: Vector
    ) -> Ending:
        """Run SciPy's search in scaled columns; point and duals of the ending are scaled, too."""

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: Vector
    ) -> Ending:
        """Pass the program to SciPy. A stopped run returns the point of its last iteration."""
        posed = Posed(program, lambda: limit_reached(request, clock) is not None)
        scaled = posed.scaled
        z = scaled.start(start)
        posed.last = z
        clock.lap("build")
        try:
            with np.errstate(all="ignore"):
                ending = self.search(posed, scaled.bounds, request, z)
        except _Stopped:
            limit = stop_reason(request.control, Limit.TIME)
            counts = {"iterations": posed.count}
            ending = Ending(Ended.STOPPED, posed.last, limit=limit, statistics=counts)
        except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
            message = f"{self.name}: {last_line(error)}"
            ending = Ending(Ended.FAILED, posed.last, message=message)
        clock.lap("solve")
        point = None if ending.point is None else scaled.point(ending.point)
        duals = None if ending.duals is None else scaled.duals(ending.duals)
        return replace(ending, point=point, duals=duals)
