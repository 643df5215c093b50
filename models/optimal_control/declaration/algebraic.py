"""Declaration of algebraic variables and of the equations that determine them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi

from ....errors import InvalidData
from ...fields import Text
from ..definition import Restriction
from .guess import Guessed
from .terms import bounds, constraint, quantity

__all__ = ["Algebraic"]

Symbol = Any  # casadi.MX


class Algebraic(Guessed):
    """Part of a phase under declaration that declares differential-algebraic equations."""

    paths: list[tuple[Restriction, Symbol]]
    _check_name: Callable[[str, str, Any], int]
    _constraints: Callable[[], list[str]]

    def algebraic(
        self,
        name: str,
        size: int = 1,
        *,
        lower: Any = None,
        upper: Any = None,
        guess: Any = None,
        scale: Any = None,
        unit: str = "",
    ) -> Symbol:
        """Declare an algebraic variable, which the algebraic equations of the phase determine.

        It may occur in rates, path constraints, integrals and outputs, as a control may. With the
        rates of states as algebraic variables, implicit dynamics F(ẋ, x, u, t) = 0 are declared by
        ``phase.dynamics({x: rate})`` and ``phase.algebraic_equation(F == 0)``.

        Parameters
        ----------
        name, size, lower, upper, scale, unit
            See :meth:`~.phase.PhaseBuilder.state`.
        guess : float, array_like or callable, optional
            See :meth:`~.guess.Guessed.guess`. Integrations start Newton's method at it.

        Returns
        -------
        casadi.MX
            Symbol of the variable.
        """
        size = self._check_name("an algebraic variable", name, size)
        low, high = bounds(name, lower, upper, size)
        self.controls[name] = quantity(name, scale, unit, (low, high) * 3, algebraic=True)
        self.symbols[name] = casadi.MX.sym(name, size)
        if guess is not None:
            self.guess(**{name: guess})
        return self.symbols[name]

    def algebraic_equation(
        self,
        expression: Any,
        *,
        equals: Any = None,
        name: str = "",
        equation: str = "",
        unit: str = "",
        scale: Any = None,
    ) -> None:
        """Declare an algebraic equation of index 1, such as ``z**3 + z == x``.

        The equations of a phase have as many entries as its algebraic variables, and determine them
        for given states, controls and time. They hold at every instant, as path constraints do.

        Parameters
        ----------
        expression : casadi expression
            Relation with ``==``, or an expression with the value `equals`.
        equals : float or array_like, optional
            Required value.
        name, equation, unit : str
            Name and equation number in the paper, and unit.
        scale : float or array_like, optional
            Typical size of the terms of the expression.

        Raises
        ------
        InvalidData
            The expression is not an equation, or a name is taken. When the problem is built: the
            numbers of equations and variables differ, or the index is above 1.
        """
        self.opened()
        count = sum(item.algebraic for item, _ in self.paths)
        name = Text().coerce("name", name, {}) or f"algebraic equation {count + 1}"
        sides = (None, None, equals)
        labels = (name, equation, unit)
        item, bounded = constraint("path", labels, self._constraints(), expression, sides, scale)
        if (item.lower != item.upper).any():
            raise InvalidData(
                f"algebraic equation {name!r} must be a relation with == or have a value (equals), "
                "got an inequality",
                field="equals",
            )
        self.paths.append((replace(item, algebraic=True), bounded))
