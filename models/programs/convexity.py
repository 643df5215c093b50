"""Curvature of CasADi functions by the rules of disciplined convex programming.

The instructions of a function are examined one by one (Grant, Boyd, Ye, "Disciplined Convex Programming", 2006).
Products of affine expressions form a polynomial, whose constant Hessian is factorised with a bound on the
rounding errors. A curvature that is not established is unknown.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .curvature import least_curvature

__all__ = ["MOST", "Outputs", "TooLarge", "Value", "named", "stack"]

Floats = NDArray[np.float64]

#: Largest number of instructions of a function that is examined, in about 0.1 s.
MOST = 10_000
#: Functions of one or two expressions: their curvature, and whether they increase in each argument.
_ATOMS = {
    casadi.OP_EXP: (1, True), casadi.OP_FMAX: (1, True), casadi.OP_FABS: (1, False),
    casadi.OP_LOG: (-1, True), casadi.OP_SQRT: (-1, True), casadi.OP_FMIN: (-1, True),
}  # fmt: skip
#: Functions whose values are never negative.
_POSITIVE = (casadi.OP_EXP, casadi.OP_FABS, casadi.OP_SQRT, casadi.OP_SQ)
_SUMS = {casadi.OP_ADD: 1, casadi.OP_SUB: -1}


class TooLarge(Exception):
    """A function has more than :data:`MOST` instructions."""


class Value(NamedTuple):
    """Scalar as the sum of a polynomial in the unknowns and a rest.

    `degree` of the polynomial is 0 (known at every instant), 1 or 2, and `symbol` its expression. The
    `shape` of the rest is 0 without a rest, 1 if it is convex, -1 if it is concave, None otherwise. A known
    value has the `sign` 1 if it is never negative, -1 if it is never positive, and 0 otherwise.
    """

    symbol: Any
    degree: int = 0
    shape: int | None = 0
    sign: int = 0

    @property
    def is_known(self) -> bool:
        return self.degree == 0 and self.shape == 0

    @property
    def is_affine(self) -> bool:
        return self.degree <= 1 and self.shape == 0

    def times(self, factor: int) -> Value:
        """Return the value times 1, -1 or 0."""
        shape = None if self.shape is None else factor * self.shape
        return Value(factor * self.symbol, self.degree, shape, factor * self.sign)

    def curved(self, side: int, unknowns: Any) -> bool:
        """Return True if the value is proven to be convex (`side` 1) or concave (-1)."""
        if self.shape not in (0, side):
            return False
        if self.degree < 2:
            return True
        hessian = side * casadi.hessian(self.symbol, unknowns)[0]
        if casadi.symvar(hessian):  # it depends on time
            return False
        rows, columns = hessian.sparsity().get_triplet()
        data = np.array(casadi.DM(hessian).nonzeros())
        matrix = sp.csr_array((data, (rows, columns)), shape=hessian.shape)
        return bool(np.isfinite(data).all() and (least_curvature(matrix) >= 0).all())


def _unknown(symbol: Any) -> Value:
    return Value(symbol, 0, None)


def _added(a: Value, b: Value) -> Value:
    shapes = {a.shape, b.shape} - {0}
    shape = None if None in shapes or len(shapes) > 1 else next(iter(shapes), 0)
    sign = a.sign if a.sign == b.sign else 0
    return Value(a.symbol + b.symbol, max(a.degree, b.degree), shape, sign)


def _multiplied(a: Value, b: Value) -> Value:
    a, b = (a, b) if a.is_known else (b, a)
    symbol = a.symbol * b.symbol
    if not a.is_known:
        return Value(symbol, 2) if a.is_affine and b.is_affine else _unknown(symbol)
    if b.shape is None or (b.shape and not a.sign):
        return _unknown(symbol)
    return Value(symbol, b.degree, a.sign * b.shape, a.sign * b.sign)


def _applied(operation: int, arguments: list[Value], apart: bool) -> Value:
    """Return the result of an instruction; squares are part of the rest if `apart`."""
    fresh = casadi.SX.sym("value")
    if operation in _SUMS:
        return _added(arguments[0], arguments[1].times(_SUMS[operation]))
    if operation == casadi.OP_NEG:
        return arguments[0].times(-1)
    if operation == casadi.OP_TWICE:
        return _added(arguments[0], arguments[0])
    if operation == casadi.OP_MUL:
        return _multiplied(*arguments)
    if operation == casadi.OP_DIV and arguments[1].is_known:
        return _multiplied(Value(1 / arguments[1].symbol, sign=arguments[1].sign), arguments[0])
    if operation == casadi.OP_SQ and not arguments[0].is_known and arguments[0].is_affine:
        square = arguments[0].symbol ** 2
        return Value(casadi.SX(0), 0, 1) if apart else Value(square, 2)
    if all(argument.is_known for argument in arguments):
        return Value(fresh, sign=int(operation in _POSITIVE))
    shape, increases = _ATOMS.get(operation, (0, False))
    inner = (0, shape) if increases else (0,)
    if shape and all(v.degree <= 1 and v.shape in inner for v in arguments):
        return Value(casadi.SX(0), 0, shape)
    return _unknown(fresh)


def _values(function: Any, inputs: list[Value], apart: bool) -> list[list[Value]]:
    """Return the values of the outputs of a scalar function of one vector of inputs."""
    registers: dict[int, Value] = {}
    results = [[Value(casadi.SX(0))] * function.size1_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, into = function.instruction_id(k), function.instruction_output(k)
        places = function.instruction_input(k)
        if operation == casadi.OP_INPUT:
            value = inputs[places[1]]
        elif operation == casadi.OP_CONST:
            number = function.instruction_constant(k)
            value = Value(casadi.SX(number), sign=int(np.nan_to_num(np.sign(number))))
            value = value if number else value._replace(sign=1)
        elif operation == casadi.OP_OUTPUT:
            results[into[0]][into[1]] = registers[places[0]]
            continue
        else:  # a call, as of a table, has several results
            operands = [registers[place] for place in places]
            registers.update((place, _applied(operation, operands, apart)) for place in into)
            continue
        registers[into[0]] = value
    return results


class Outputs:
    """Values of the outputs of a function of known and unknown scalars.

    `arguments` are CasADi expressions of numbers and of the symbols in `inputs`, paired with what is known about
    each.
    """

    def __init__(
        self, function: Any, arguments: list[Any], inputs: list[tuple[Any, Value]]
    ) -> None:
        symbols = casadi.vertcat(*(symbol for symbol, _ in inputs))
        outputs = [casadi.densify(output) for output in function.call(arguments)]
        scalar = casadi.Function("scalar", [symbols], outputs)
        if scalar.n_instructions() > MOST:
            raise TooLarge
        values = [value for _, value in inputs]
        # Squares are convex without a Hessian, whose entries may be rounded. Other products may need
        # them for a definite Hessian.
        self._apart, self._whole = (_values(scalar, values, apart) for apart in (True, False))
        self._unknowns = casadi.vertcat(*(symbol for symbol, value in inputs if value.degree))

    def is_affine(self, output: int) -> list[bool]:
        """Return for each entry of an output whether it is affine."""
        return [value.is_affine for value in self._apart[output]]

    def signs(self, output: int) -> list[int]:
        """Return for each entry of an output its sign, 0 if it is unknown."""
        return [value.sign if value.is_known else 0 for value in self._apart[output]]

    def is_curved(self, output: int, side: int) -> list[bool]:
        """Return for each entry of an output whether it is convex (`side` 1) or concave (-1)."""
        pairs = zip(self._apart[output], self._whole[output], strict=True)
        return [any(value.curved(side, self._unknowns) for value in pair) for pair in pairs]

    def allow(self, output: int, bounds: tuple[Floats, Floats]) -> bool:
        """Return True if the points whose output is within its bounds form a convex set."""
        sides = zip(self.is_curved(output, -1), self.is_curved(output, 1), strict=True)
        return all(
            (concave or np.isneginf(low)) and (convex or np.isposinf(high))
            for (concave, convex), low, high in zip(sides, *bounds, strict=True)
        )


def named(name: str, count: int) -> list[tuple[Any, Value]]:
    """Return `count` unknown scalars, as symbols with what is known about them."""
    symbols = [casadi.SX.sym(f"{name}{k}") for k in range(count)]
    return [(symbol, Value(symbol, 1)) for symbol in symbols]


def stack(inputs: list[tuple[Any, Value]]) -> Any:
    """Return the symbols of the inputs as a column."""
    return casadi.vertcat(casadi.SX(0, 1), *(symbol for symbol, _ in inputs))
