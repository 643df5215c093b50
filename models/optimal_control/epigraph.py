"""Epigraph form of costs with ``fabs``, ``fmax``, ``fmin`` and norms, which have no derivative at their kinks.

An interior-point method does not converge at such a kink. If an objective that is minimised increases with
``|e|``, then a new control ``s`` in its place, with the path constraints ``s >= e`` and ``s >= -e``, has the
same optimum, and all functions are smooth. Kinks at the ends of phases become parameters. S. Boyd, L.
Vandenberghe, "Convex Optimization" (2004), section 4.1.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..programs.compiled import scalar_form
from ..programs.convexity import MOST, Outputs, TooLarge, Value
from .definition import Definition, Phase, Quantity, Restriction
from .model import OptimalControlProblem
from .plan import ControlPlan, Piecewise
from .sampling import courses, endpoint

__all__ = ["Epigraph", "epigraph_of"]

Floats = NDArray[np.float64]

#: Operations with kinks that are replaced, in addition to the root of a sum of squares.
_KINKS = (casadi.OP_FABS, casadi.OP_FMAX, casadi.OP_FMIN)
#: Operations with jumps, which their derivatives do not show.
_JUMPS = (
    casadi.OP_LT, casadi.OP_LE, casadi.OP_EQ, casadi.OP_NE, casadi.OP_NOT, casadi.OP_AND, casadi.OP_OR,
    casadi.OP_FLOOR, casadi.OP_CEIL, casadi.OP_SIGN, casadi.OP_COPYSIGN, casadi.OP_FMOD,
    casadi.OP_REMAINDER, casadi.OP_IF_ELSE_ZERO,
)  # fmt: skip
#: Least share of a norm in its divisor, and its least value, which has a finite second derivative.
LEAST_SHARE, TINY = 0.1, 1e-20
#: Name of the new variables.
NAME = "epigraph"


class _Kink(NamedTuple):
    """Operation of a function with a kink: number of its instruction, its symbol and its arguments."""

    place: int
    operation: int
    symbol: Any
    arguments: tuple[Any, ...]

    @property
    def sign(self) -> int:
        """1 if the symbol may exceed the value of the operation, and -1 if it may be below."""
        return -1 if self.operation == casadi.OP_FMIN else 1

    @property
    def rows(self) -> list[Any]:
        """Expressions that must not be negative."""
        if self.operation == casadi.OP_SQRT:
            # The gradient of the root is unbounded at 0. That of s² - e² vanishes there, and its multiplier is
            # unbounded; that of s - e² / s is bounded. Between the nodes, s can be far below e.
            least = LEAST_SHARE * casadi.sqrt(self.arguments[0] + TINY**2)
            return [self.symbol - self.arguments[0] / casadi.fmax(self.symbol, least)]
        if self.operation == casadi.OP_FABS:
            return [self.symbol - self.arguments[0], self.symbol + self.arguments[0]]
        return [self.sign * (self.symbol - argument) for argument in self.arguments]

    @property
    def value(self) -> Any:
        """Value of the operation."""
        if len(self.arguments) == 1:
            return casadi.SX.unary(self.operation, self.arguments[0])
        return casadi.SX.binary(self.operation, *self.arguments)

    def largest(self, inputs: Any, bounds: tuple[Floats, Floats]) -> float:
        """Return an upper bound on ``|e|`` of an affine expression of bounded inputs; inf if unknown."""
        if self.operation != casadi.OP_FABS:
            return np.inf
        slope = casadi.jacobian(self.arguments[0], inputs)
        rest = casadi.substitute(self.arguments[0], inputs, casadi.DM.zeros(inputs.shape))
        if casadi.symvar(casadi.vertcat(slope.T, rest)):
            return np.inf
        slopes, constant = casadi.DM(slope).full().ravel(), float(casadi.DM(rest))
        used = slopes != 0.0
        ends = [slopes[used] * side[used] for side in bounds]
        top = constant + np.maximum(*ends).sum()
        return float(max(top, -(constant + np.minimum(*ends).sum())))


@dataclass(frozen=True)
class _Smooth:
    """Kinks of expressions, the upper bounds of their symbols, and the expressions with symbols.

    `jumps` are the arguments of operations with jumps.
    """

    kinks: list[_Kink]
    largest: list[float]
    outputs: list[Any]
    jumps: Any

    @property
    def symbols(self) -> Any:
        return casadi.vertcat(*(kink.symbol for kink in self.kinks))

    @property
    def rows(self) -> list[Any]:
        """Expressions that must not be negative."""
        return [row for kink in self.kinks for row in kink.rows]

    @property
    def values(self) -> Any:
        """Values of the kinks as expressions of the original inputs."""
        values = casadi.SX(0, 1)
        for k, kink in enumerate(self.kinks):
            value = casadi.substitute(kink.value, self.symbols[:k], values) if k else kink.value
            values = casadi.vertcat(values, value)
        return values


def _rebuilt(
    function: Any, inputs: list[Any], kept: set[int]
) -> tuple[list[_Kink], list[Any], Any]:
    """Return the kinks of a scalar function, its outputs with a symbol in place of each, and its jumps.

    Instructions in `kept` remain. The jumps are the arguments of operations with jumps.
    """
    registers: dict[int, Any] = {}
    squares: set[int] = set()  # registers with sums of squares
    kinks: list[_Kink] = []
    jumps = [casadi.SX(0, 1)]
    results = [[casadi.SX(0)] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, into = function.instruction_id(k), function.instruction_output(k)
        places = function.instruction_input(k)
        if operation == casadi.OP_INPUT:
            result = inputs[places[1]]
        elif operation == casadi.OP_CONST:
            result = casadi.SX(function.instruction_constant(k))
        elif operation == casadi.OP_OUTPUT:
            results[into[0]][into[1]] = registers[places[0]]
            continue
        else:
            arguments = tuple(registers[place] for place in places)
            kink = _Kink(k, operation, casadi.SX.sym(f"{NAME}{k}"), arguments)
            is_kink = operation in _KINKS or (operation == casadi.OP_SQRT and places[0] in squares)
            if is_kink and k not in kept:
                kinks.append(kink)
            result = kink.symbol if is_kink and k not in kept else kink.value
            jumps += arguments if operation in _JUMPS else ()
        is_square = operation == casadi.OP_SQ or (
            operation == casadi.OP_ADD and squares.issuperset(places)
        )
        squares = squares | {into[0]} if is_square else squares - {into[0]}
        registers[into[0]] = result
    outputs = [casadi.vertcat(casadi.SX(0, 1), *result) for result in results]
    return kinks, outputs, casadi.vertcat(*jumps)


def _signs(expressions: Any, by: Any, jumps: Any, time: Any = None, sign: int = 0) -> Floats:
    """Return the signs of the derivatives of `expressions` by `by`: 1, 0, -1, or nan if unknown.

    A derivative must be known at every instant: a number, or a function of `time`, which has this sign. It is
    unknown for entries of `by` on which `jumps` depend.
    """
    time = casadi.SX.sym("t") if time is None else time
    slopes = casadi.densify(casadi.jacobian(expressions, by))
    others = [symbol for symbol in casadi.symvar(slopes) if not casadi.is_equal(symbol, time)]
    inputs = [(time, Value(time, sign=sign)), *((symbol, Value(symbol, 1)) for symbol in others)]
    symbols = [symbol for symbol, _ in inputs]
    function = casadi.Function("slopes", symbols, [casadi.vec(slopes)])
    signs = np.array(Outputs(function, symbols, inputs).signs(0), float)
    zero = [slope.is_zero() for slope in casadi.vertsplit(casadi.vec(slopes))]
    table = np.where(zero, 0.0, np.where(signs == 0.0, np.nan, signs))
    table = table.reshape(slopes.shape, order="F")
    table[:, [casadi.depends_on(jumps, entry) for entry in casadi.vertsplit(by)]] = np.nan
    return table


def _weighted(demands: Floats, signs: Floats) -> Floats:
    """Return the demands on symbols, from those on expressions and the `signs` of their derivatives."""
    return np.where(signs == 0.0, 0.0, demands[:, None] * signs)


def _joint(signs: Floats) -> int:
    """Return the sign that all nonzero entries share; 0 if they have none, differ or are unknown."""
    nonzero = signs[signs != 0.0]
    shared = set(nonzero.tolist())
    return int(nonzero[0]) if len(shared) == 1 and not np.isnan(nonzero).any() else 0


def _smoothed(
    outputs: Sequence[Any],
    inputs: Any,
    demands: Floats,
    bounds: tuple[Floats, Floats],
    time: Any = None,
    sign: int = 0,
) -> _Smooth:
    """Return the kinks of expressions of `inputs` that can be replaced.

    `demands` has one entry per entry of all outputs: 1 if a smaller entry never makes the optimum worse, -1 if a
    larger one does not, 0 if the entry is not used, nan otherwise.
    """
    function = casadi.Function("scalar", [inputs], list(outputs))
    if function.n_instructions() > MOST:
        raise TooLarge
    kept: set[int] = set()
    while True:
        kinks, results, jumps = _rebuilt(function, casadi.vertsplit(inputs), kept)
        largest = [np.inf if jumps.numel() else kink.largest(inputs, bounds) for kink in kinks]
        smooth = _Smooth(kinks, largest, results, jumps)
        if not kinks:
            return smooth
        rows = casadi.vertcat(*results, *smooth.rows)
        weights = np.append(demands, np.full(len(smooth.rows), -1.0))
        signs = _weighted(weights, _signs(rows, smooth.symbols, jumps, time, sign))
        own = np.repeat(np.arange(len(kinks)), [len(kink.rows) for kink in kinks])
        signs[demands.size + np.arange(own.size), own] = 0.0  # a symbol satisfies its own rows
        # A kink that remains makes the signs of the kinks in its arguments unknown, so that they remain as well.
        remaining = {
            kink.place
            for kink, column in zip(kinks, signs.T, strict=True)
            if _joint(column) != kink.sign
        }
        if not remaining:
            return smooth
        kept |= remaining


def _sides(low: Floats, high: Floats) -> Floats:
    """Return the demands on restricted expressions: 1 if only bounded above, -1 if only below."""
    above, below = np.isfinite(high), np.isfinite(low)
    return np.where(above & below, np.nan, above.astype(float) - below.astype(float))


def _variables(smooth: _Smooth, name: str) -> tuple[list[Quantity], list[Restriction]]:
    """Return the new variables and their constraints."""
    variables, rows, free = list[Quantity](), list[Restriction](), np.full(1, np.inf)
    for k, kink in enumerate(smooth.kinks):
        label, top = f"{name} {k + 1}", np.full(1, smooth.largest[k])
        low = np.zeros(1) if kink.operation in (casadi.OP_FABS, casadi.OP_SQRT) else -free
        scale = np.where(np.isfinite(top) & (top > 0.0), top, 1.0)
        variables.append(Quantity(label, *(low, top) * 3, scale))
        for branch in range(len(kink.rows)):
            side = f"{label}, branch {branch + 1}"
            rows.append(Restriction(side, "", "", np.zeros(1), free, np.ones(1)))
    return variables, rows


@dataclass(frozen=True, eq=False)
class Epigraph:
    """Problem without kinks in its costs, and the maps between both definitions' plans.

    `phase_values` are the functions ``(t, x, u, p) -> s`` of the new controls per phase, None without new controls,
    and `end_values` that of the new parameters, ``(e, p) -> s``.
    """

    original: Definition
    problem: OptimalControlProblem
    phase_values: tuple[Any, ...]
    end_values: Any

    def extended(self, plan: ControlPlan) -> ControlPlan:
        """Return a plan of the original definition with the values of the new variables."""
        phases, parts = [], courses(self.original, plan)
        for part, course, phase, values in zip(
            plan.phases, parts, self.problem.definition.phases, self.phase_values, strict=True
        ):
            if values is None:
                phases.append(part)
                continue
            tables = []
            for k, (nodes, table) in enumerate(
                zip(part.controls.nodes, part.controls.values, strict=True)
            ):
                low, high = part.controls.knots[k : k + 2]
                times = low + 0.5 * (nodes + 1.0) * (high - low)
                new = values(times[None], part.states.on(k, nodes).T, table.T, course.parameters)
                tables.append(np.hstack([table, new.full().T]))
            controls = Piecewise(
                part.controls.knots, part.controls.nodes, tuple(tables), *phase.bounds("controls")
            )
            phases.append(replace(part, controls=controls, control_names=phase.control_names))
        parameters = dict(plan.parameters)
        if self.end_values is not None:
            new = self.end_values(endpoint(parts), parts[0].parameters).full().ravel()
            names = self.problem.definition.parameter_names[len(self.original.parameter_names) :]
            parameters |= {name: new[k : k + 1] for k, name in enumerate(names)}
        return ControlPlan(tuple(phases), parameters).attached(self.problem.definition)

    def reduced(self, plan: ControlPlan) -> ControlPlan:
        """Return a plan of the problem without the new variables."""
        phases = []
        for part, phase in zip(plan.phases, self.original.phases, strict=True):
            size = len(phase.control_names)
            controls = Piecewise(
                part.controls.knots,
                part.controls.nodes,
                tuple(table[:, :size] for table in part.controls.values),
                *phase.bounds("controls"),
            )
            phases.append(replace(part, controls=controls, control_names=phase.control_names))
        names = [item.name for item in self.original.parameters]
        parameters = {name: plan.parameters[name] for name in names}
        return ControlPlan(tuple(phases), parameters).attached(self.original)


def _extended(function: Any, count: int) -> Any:
    """Return the function of a phase with `count` parameters; it uses the first ones."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    longer = casadi.MX.sym("p", count)
    outputs = function.call([*arguments[:3], longer[: arguments[3].numel()]])
    inputs = [*arguments[:3], longer]
    names = function.name_in(), function.name_out()
    return scalar_form(casadi.Function("phase", inputs, outputs, *names))


def _guessed_ends(definition: Definition) -> Floats:
    """Return the endpoint vector of the guess, with integrals of 0."""
    parts: list[Floats] = []
    for phase in definition.phases:
        guess = phase.guess
        at = [0.0, 1.0, *phase.instants]
        columns = [np.interp(at, guess.fractions, column) for column in guess.states.T]
        begin, end, *inner = np.array(columns).T
        parts += [np.array([guess.start, guess.end]), begin, end, np.zeros(phase.integrals), *inner]
    return np.concatenate(parts)


def _with_controls(phase: Phase, p: Any, values: Floats, demands: Floats) -> tuple[Phase, Any]:
    """Return the phase with a new control per kink of its integrands, and their values as a function.

    `values` are those of the guessed parameters, and `demands` those on the integrals (see :func:`_smoothed`).
    """
    sizes = {"t": 1, "x": len(phase.state_names), "u": len(phase.control_names)}
    t, x, u = (casadi.SX.sym(name, size) for name, size in sizes.items())
    rate, path, integrand, invariant = phase.function(t, x, u, p)
    edges = [
        np.concatenate([[time], states, controls, np.full(p.numel(), side)])
        for time, states, controls, side in zip(
            (phase.start_lower, phase.end_upper), phase.bounds("states"), phase.bounds("controls"),
            (-np.inf, np.inf), strict=True,
        )
    ]  # fmt: skip
    sign = 1 if phase.start_lower >= 0 else -1 if phase.end_upper <= 0 else 0
    inputs = casadi.vertcat(t, x, u, p)
    smooth = _smoothed([casadi.densify(integrand)], inputs, demands, (edges[0], edges[1]), t, sign)
    if not smooth.kinks:
        return phase, None
    variables, rows = _variables(smooth, NAME)
    function = casadi.Function(
        "phase",
        [t, x, casadi.vertcat(u, smooth.symbols), p],
        [rate, casadi.vertcat(path, *smooth.rows), smooth.outputs[0], invariant],
        phase.function.name_in(),
        phase.function.name_out(),
    )
    values_of = casadi.Function("values", [t, x, u, p], [smooth.values])
    guess = phase.guess
    times = guess.start + guess.fractions * (guess.end - guess.start)
    new = values_of(times[None], guess.states.T, guess.controls.T, values).full().T
    wider = replace(
        phase,
        controls=(*phase.controls, *variables),
        paths=(*phase.paths, *rows),
        function=function,
        guess=replace(guess, controls=np.hstack([guess.controls, new])),
        outputs=(),
        outputs_function=None,
    )
    return wider, values_of


@lru_cache(maxsize=64)
def epigraph_of(definition: Definition, name: str = "") -> Epigraph | None:
    """Return the epigraph form of a definition, as a problem called `name`; None if no cost has such kinks."""
    try:
        return _epigraph(definition, name)
    except (RuntimeError, TooLarge):  # CasADi cannot write a function in scalar operations
        return None
    except InvalidData:  # the problem has the name of a new variable or row
        return None


def _epigraph(definition: Definition, name: str) -> Epigraph | None:
    sizes = [phase.end_size for phase in definition.phases]
    e, p = casadi.SX.sym("e", sum(sizes)), casadi.SX.sym("p", len(definition.parameter_names))
    outputs = [casadi.densify(output) for output in definition.endpoint(e, p)]
    demands = np.concatenate([[1.0], _sides(*definition.bounds("boundaries"))])
    free = np.full(e.numel() + p.numel(), np.inf)
    smooth = _smoothed(outputs, casadi.vertcat(e, p), demands, (-free, free))
    outputs = [smooth.outputs[0], casadi.vertcat(smooth.outputs[1], *smooth.rows)]
    demands = np.append(demands, -np.ones(len(smooth.rows)))
    variables, rows = _variables(smooth, f"{NAME} of ends")
    values = definition.stacked("parameters", "initial_lower")
    signs = _weighted(demands, _signs(casadi.vertcat(*outputs), e, smooth.jumps))
    phases, phase_values, first = [], [], 0
    for phase, size in zip(definition.phases, sizes, strict=True):
        last = first + size - len(phase.instants) * len(phase.state_names)
        columns = signs[:, last - phase.integrals : last].T
        of_integrals = np.array([_joint(column) or np.nan for column in columns])
        wider, values_of = _with_controls(phase, p, values, of_integrals)
        phases.append(wider)
        phase_values.append(values_of)
        first += size
    if not smooth.kinks and not any(phase_values):
        return None
    end_values, endpoint_function = None, definition.endpoint
    if smooth.kinks:
        end_values = casadi.Function("values", [e, p], [smooth.values])
        guesses = end_values(_guessed_ends(definition), values).full().ravel()
        variables = [
            replace(item, initial_lower=guess, initial_upper=guess)
            for item, guess in zip(variables, np.split(guesses, guesses.size), strict=True)
        ]
        count = p.numel() + len(variables)
        phases = [
            replace(
                phase, function=_extended(phase.function, count), outputs=(), outputs_function=None
            )
            for phase in phases
        ]
        endpoint_function = casadi.Function(
            "endpoint",
            [e, casadi.vertcat(p, smooth.symbols)],
            outputs,
            definition.endpoint.name_in(),
            definition.endpoint.name_out(),
        )
    lifted = replace(
        definition,
        phases=tuple(phases),
        parameters=(*definition.parameters, *variables),
        boundaries=(*definition.boundaries, *rows),
        endpoint=endpoint_function,
    )
    problem = OptimalControlProblem(name, definition=lifted)
    return Epigraph(definition, problem, tuple(phase_values), end_values)
