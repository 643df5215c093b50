"""Recognition of convex problems, whose local optima are all global.

A problem is convex if its times are fixed, its dynamics are affine in states, controls and free parameters,
its objective is convex, and its constraints are affine, or convex with an upper bound, or concave with a
lower bound. The instructions of the declared functions are examined one by one with the rules of disciplined
convex programming (Grant, Boyd, Ye, "Disciplined Convex Programming", 2006). Products of affine expressions
form a polynomial, whose constant Hessian is factorised with a bound on the rounding errors. The answer False
means that convexity was not established.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..programs.curvature import least_curvature
from .definition import Definition, Phase

__all__ = ["is_convex"]

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


class _TooLarge(Exception):
    """A function has more than :data:`MOST` instructions."""


class _Value(NamedTuple):
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

    def times(self, factor: int) -> _Value:
        """Return the value times 1, -1 or 0."""
        shape = None if self.shape is None else factor * self.shape
        return _Value(factor * self.symbol, self.degree, shape, factor * self.sign)

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


def _unknown(symbol: Any) -> _Value:
    return _Value(symbol, 0, None)


def _added(a: _Value, b: _Value) -> _Value:
    shapes = {a.shape, b.shape} - {0}
    shape = None if None in shapes or len(shapes) > 1 else next(iter(shapes), 0)
    sign = a.sign if a.sign == b.sign else 0
    return _Value(a.symbol + b.symbol, max(a.degree, b.degree), shape, sign)


def _multiplied(a: _Value, b: _Value) -> _Value:
    a, b = (a, b) if a.is_known else (b, a)
    symbol = a.symbol * b.symbol
    if not a.is_known:
        return _Value(symbol, 2) if a.is_affine and b.is_affine else _unknown(symbol)
    if b.shape is None or (b.shape and not a.sign):
        return _unknown(symbol)
    return _Value(symbol, b.degree, a.sign * b.shape, a.sign * b.sign)


def _applied(operation: int, arguments: list[_Value], apart: bool) -> _Value:
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
        return _multiplied(_Value(1 / arguments[1].symbol, sign=arguments[1].sign), arguments[0])
    if operation == casadi.OP_SQ and not arguments[0].is_known and arguments[0].is_affine:
        square = arguments[0].symbol ** 2
        return _Value(casadi.SX(0), 0, 1) if apart else _Value(square, 2)
    if all(argument.is_known for argument in arguments):
        return _Value(fresh, sign=int(operation in _POSITIVE))
    shape, increases = _ATOMS.get(operation, (0, False))
    inner = (0, shape) if increases else (0,)
    if shape and all(v.degree <= 1 and v.shape in inner for v in arguments):
        return _Value(casadi.SX(0), 0, shape)
    return _unknown(fresh)


def _values(function: Any, inputs: list[_Value], apart: bool) -> list[list[_Value]]:
    """Return the values of the outputs of a scalar function of one vector of inputs."""
    registers: dict[int, _Value] = {}
    results = [[_Value(casadi.SX(0))] * function.size1_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, into = function.instruction_id(k), function.instruction_output(k)
        places = function.instruction_input(k)
        if operation == casadi.OP_INPUT:
            value = inputs[places[1]]
        elif operation == casadi.OP_CONST:
            number = function.instruction_constant(k)
            value = _Value(casadi.SX(number), sign=int(np.nan_to_num(np.sign(number))))
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


class _Outputs:
    """Values of the outputs of a function of known and unknown scalars.

    Parameters
    ----------
    function : casadi.Function
        The function.
    arguments : list of casadi.SX
        Its arguments, composed of the symbols and of numbers.
    inputs : list of (casadi.SX, _Value)
        Symbols with what is known about them.
    """

    def __init__(
        self, function: Any, arguments: list[Any], inputs: list[tuple[Any, _Value]]
    ) -> None:
        symbols = casadi.vertcat(*(symbol for symbol, _ in inputs))
        outputs = [casadi.densify(output) for output in function(*arguments)]
        scalar = casadi.Function("scalar", [symbols], outputs)
        if scalar.n_instructions() > MOST:
            raise _TooLarge
        values = [value for _, value in inputs]
        # Squares are convex without a Hessian, whose entries may be rounded. Other products may need
        # them for a definite Hessian.
        self._apart, self._whole = (_values(scalar, values, apart) for apart in (True, False))
        self._unknowns = casadi.vertcat(*(symbol for symbol, value in inputs if value.degree))

    def is_affine(self, output: int) -> list[bool]:
        """Return for each entry of an output whether it is affine."""
        return [value.is_affine for value in self._apart[output]]

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


def _symbols(name: str, count: int) -> list[tuple[Any, _Value]]:
    symbols = [casadi.SX.sym(f"{name}{k}") for k in range(count)]
    return [(symbol, _Value(symbol, 1)) for symbol in symbols]


def _stack(inputs: list[tuple[Any, _Value]]) -> Any:
    return casadi.vertcat(casadi.SX(0, 1), *(symbol for symbol, _ in inputs))


def _integrals(
    phase: Phase, p: Any, parameters: list[tuple[Any, _Value]]
) -> list[tuple[Any, _Value]] | None:
    """Return the integrals of a phase with convex constraints; None if the phase has others."""
    time = casadi.SX.sym("t")
    sign = 1 if phase.start_lower >= 0 else -1 if phase.end_upper <= 0 else 0
    x, u = _symbols("x", len(phase.state_names)), _symbols("u", len(phase.control_names))
    inputs = [(time, _Value(time, sign=sign)), *x, *u, *parameters]
    outputs = _Outputs(phase.function, [time, _stack(x), _stack(u), p], inputs)
    if not all(outputs.is_affine(0)) or not outputs.allow(1, phase.bounds("paths")):
        return None
    result = _symbols("integral", phase.integrals)
    sides = zip(outputs.is_curved(2, 1), outputs.is_curved(2, -1), strict=True)
    for k, (convex, concave) in enumerate(sides):
        if not outputs.is_affine(2)[k]:
            shape = 1 if convex else -1 if concave else None
            result[k] = result[k][0], _Value(casadi.SX(0), 0, shape)
    return result


@lru_cache(maxsize=64)
def is_convex(definition: Definition) -> bool:
    """Return True if the problem is proven to be convex, so that every local optimum is global.

    Parameters
    ----------
    definition : Definition
        Problem with the values of its data.

    Returns
    -------
    bool
        False if the problem is not convex, has a free time or integer controls, or convexity was not
        established.
    """
    for phase in definition.phases:
        fixed = phase.start_lower == phase.start_upper and phase.end_lower == phase.end_upper
        if not fixed or any(control.integer for control in phase.controls):
            return False
    parameters, p = list[tuple[Any, _Value]](), [casadi.SX(0, 1)]
    for quantity in definition.parameters:
        entries = _symbols(quantity.name, quantity.size)
        p.append(casadi.SX(casadi.DM(quantity.lower)) if quantity.given else _stack(entries))
        parameters += [] if quantity.given else entries
    ends, e = list(parameters), [casadi.SX(0, 1)]
    try:
        for phase in definition.phases:
            integrals = _integrals(phase, casadi.vertcat(*p), parameters)
            if integrals is None:
                return False
            states = _symbols("end", 2 * len(phase.state_names))
            inner = _symbols("inner", len(phase.instants) * len(phase.state_names))
            ends += [*states, *integrals, *inner]
            e += [
                casadi.SX(phase.start_lower),
                casadi.SX(phase.end_lower),
                _stack(states),
                _stack(integrals),
                _stack(inner),
            ]
        arguments = [casadi.vertcat(*e), casadi.vertcat(*p)]
        outputs = _Outputs(definition.endpoint, arguments, ends)
    except (RuntimeError, _TooLarge):  # CasADi cannot write the function in scalar operations
        return False
    is_minimum_global = all(outputs.is_curved(0, 1))
    return is_minimum_global and outputs.allow(1, definition.bounds("boundaries"))
