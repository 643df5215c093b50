"""Problem of the literature: its declaration with the best known value, and tables of such problems."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from crosstrack.models import OptimalControlProblem

__all__ = ["DeclaredProblem", "Table"]


@dataclass(frozen=True)
class DeclaredProblem:
    """Problem with its best known value.

    Parameters
    ----------
    declare : callable
        Function that declares the problem on the `OptimalControlProblem` that it receives.
    value : float or None
        Best known value of the minimised objective; None if no value is published. Then a
        verified plan is judged by the agreement of two independent programs.
    source : str
        Source of statement and value.
    exact : float
        Relative accuracy of `value`: the printed precision, or that of the mesh of the source.
    options : dict
        Keyword arguments of `declare`.
    """

    declare: Callable[..., None]
    value: float | None
    source: str
    exact: float
    options: dict[str, Any]

    def build(self, name: str) -> OptimalControlProblem:
        """Return the declared problem."""
        ocp = OptimalControlProblem(name)
        self.declare(ocp, **self.options)
        return ocp


class Table(dict[str, DeclaredProblem]):
    """Declared problems by name; a call returns a decorator that adds one."""

    def __call__(
        self,
        value: float | None,
        source: str,
        exact: float = 1e-6,
        name: str = "",
        **options: Any,
    ) -> Callable[[Any], Any]:
        """Return the decorator that adds a declaration with its value.

        Raises
        ------
        ValueError
            The name is in the table already.
        """

        def add(declare: Any) -> Any:
            key = name or declare.__name__
            if key in self:
                raise ValueError(f"name {key!r} is declared twice; choose another")
            self[key] = DeclaredProblem(declare, value, source, exact, options)
            return declare

        return add
