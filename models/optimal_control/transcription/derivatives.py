"""Values and exact derivatives of a declared problem at one instant and at the phases' ends.

Made once a definition, in scalar operations, and mapped over the nodes of whatever mesh: what a
finer mesh costs is the evaluation, not the differentiation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import casadi
import numpy as np
from numpy.typing import NDArray

from ..definition import Definition, Phase

__all__ = ["EndpointFunctions", "NodeFunctions", "functions_of"]


def _symbols(function: casadi.Function) -> Any:
    """Return the kind of symbols that `function` takes at its fastest."""
    return casadi.SX if function.is_a("SXFunction") else casadi.MX


def _pattern(expression: Any) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    rows, columns = expression.sparsity().get_triplet()
    return np.array(rows, np.int64), np.array(columns, np.int64)


@dataclass(frozen=True, eq=False)
class _Twice:
    """A vector function with its Jacobian and the Hessian of any combination of its entries.

    Parameters
    ----------
    value : casadi.Function
        Arguments to entries.
    first : casadi.Function
        Arguments to the nonzeros of the Jacobian.
    second : casadi.Function
        Arguments and multipliers to the nonzeros of the Hessian's upper triangle.
    first_at, second_at : tuple of ndarray
        Rows and columns of those nonzeros.
    """

    value: casadi.Function
    first: casadi.Function
    second: casadi.Function
    first_at: tuple[NDArray[np.int64], NDArray[np.int64]]
    second_at: tuple[NDArray[np.int64], NDArray[np.int64]]


def _differentiate(name: str, free: Any, entries: Any, arguments: list[Any], kind: Any) -> _Twice:
    jacobian = casadi.jacobian(entries, free)
    multipliers = kind.sym("multipliers", entries.numel())
    curved = casadi.triu(casadi.hessian(casadi.dot(multipliers, entries), free)[0])
    # In order of columns, CasADi's order of nonzeros.
    return _Twice(
        casadi.Function(f"{name}_value", arguments, [entries]),
        casadi.Function(f"{name}_first", arguments, [_nonzeros(jacobian, kind)]),
        casadi.Function(f"{name}_second", [*arguments, multipliers], [_nonzeros(curved, kind)]),
        _pattern(jacobian),
        _pattern(curved),
    )


def _nonzeros(matrix: Any, kind: Any) -> Any:
    # A row keeps its shape otherwise.
    return casadi.vec(matrix.nz[:]) if matrix.nnz() else kind(0, 1)


class NodeFunctions:
    """What one phase asks for at one instant: ``[(h/2) rate; (h/2) integrand; path]``.

    The arguments are x, u, ``T = [t0, tf]``, p, and the place: ``[σ, δ]``, the fraction of the phase
    at which the instant lies, and that which its interval covers, so that h = (tf - t0) δ.
    """

    def __init__(self, phase: Phase, parameters: int) -> None:
        kind = _symbols(phase.function)
        self.states, self.controls = len(phase.state_names), len(phase.control_names)
        self.integrals = phase.integrals
        self.paths = int(phase.function.size1_out(1))
        x, u = kind.sym("x", self.states), kind.sym("u", self.controls)
        times, p, place = kind.sym("T", 2), kind.sym("p", parameters), kind.sym("place", 2)
        length = times[1] - times[0]
        rate, path, integrand, _ = phase.function(times[0] + length * place[0], x, u, p)
        half = 0.5 * length * place[1]
        entries = casadi.vertcat(half * rate, half * integrand, path)
        entries = casadi.densify(entries)
        free = casadi.vertcat(x, u, times, p)
        if kind is casadi.MX:
            # CasADi differentiates with respect to symbols only: one stack of all that is free.
            free = casadi.MX.sym("free", free.numel())
            cuts = np.cumsum([0, self.states, self.controls, 2, parameters]).tolist()
            parts = casadi.vertsplit(free, cuts)
            value = casadi.Function("entries", [x, u, times, p, place], [entries])
            entries = value(*parts, place)
            whole = _differentiate("node", free, entries, [free, place], kind)
            self.twice = _unstacked(whole, cuts)
        else:
            self.twice = _differentiate("node", free, entries, [x, u, times, p, place], kind)
        self.entries = int(entries.numel())


def _unstacked(whole: _Twice, cuts: list[int]) -> _Twice:
    """Return the functions with x, u, T and p as arguments of their own."""

    def apart(function: casadi.Function) -> casadi.Function:
        sizes = np.diff(cuts).tolist()
        parts = [casadi.MX.sym(f"a{k}", n) for k, n in enumerate(sizes)]
        others = [
            casadi.MX.sym(f"b{k}", *function.size_in(k + 1)) for k in range(function.n_in() - 1)
        ]
        return casadi.Function(
            function.name(), [*parts, *others], [function(casadi.vertcat(*parts), *others)]
        )

    return _Twice(
        apart(whole.value), apart(whole.first), apart(whole.second), whole.first_at, whole.second_at
    )


class EndpointFunctions:
    """``[objective; boundary]`` of the stacked ends and the parameters, with derivatives."""

    def __init__(self, definition: Definition) -> None:
        function = definition.endpoint
        kind = _symbols(function)
        ends, parameters = function.size1_in(0), function.size1_in(1)
        free = kind.sym("free", ends + parameters)
        objective, boundary = function(free[:ends], free[ends:])
        entries = casadi.densify(casadi.vertcat(objective, boundary))
        self.twice = _differentiate("endpoint", free, entries, [free], kind)
        self.entries = int(entries.numel())


class Functions:
    """All functions of a definition."""

    def __init__(self, definition: Definition) -> None:
        parameters = len(definition.parameter_names)
        self.nodes = tuple(NodeFunctions(phase, parameters) for phase in definition.phases)
        self.endpoint = EndpointFunctions(definition)


_known: WeakKeyDictionary[Definition, Functions] = WeakKeyDictionary()


def functions_of(definition: Definition) -> Functions:
    """Return the functions of `definition`, made at the first call."""
    found = _known.get(definition)
    if found is None:
        found = _known[definition] = Functions(definition)
    return found
