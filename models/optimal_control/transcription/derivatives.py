"""Values and exact derivatives of a declared problem at one instant and at the ends of phases.

The functions are created once per definition, in scalar operations, and mapped over the nodes of any
mesh. A finer mesh requires more evaluations but no further differentiation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi
import numpy as np

from ..definition import Definition, Phase

__all__ = ["Functions", "Twice", "functions_of"]


def _symbols(function: casadi.Function) -> Any:
    """Return the kind of symbols with which `function` is fastest."""
    return casadi.SX if function.is_a("SXFunction") else casadi.MX


@dataclass(frozen=True, eq=False)
class Twice:
    """Vector function with its Jacobian and the Hessian of any linear combination of its entries.

    `first` returns the nonzeros of the Jacobian. `second` takes multipliers, too, and returns the
    nonzeros of the Hessian's upper triangle. `jacobian` and `hessian` are their patterns.
    """

    value: casadi.Function
    first: casadi.Function
    second: casadi.Function
    jacobian: casadi.Sparsity
    hessian: casadi.Sparsity

    @property
    def entries(self) -> int:
        """Number of entries."""
        return int(self.value.size1_out(0))


def _differentiate(name: str, free: Any, entries: Any, arguments: list[Any], kind: Any) -> Twice:
    entries = casadi.densify(entries)
    jacobian = casadi.jacobian(entries, free)
    multipliers = kind.sym("multipliers", entries.numel())
    curved: Any = casadi.triu(casadi.hessian(casadi.dot(multipliers, entries), free)[0])
    # Ordered by columns, as CasADi orders nonzeros.
    return Twice(
        casadi.Function(f"{name}_value", arguments, [entries]),
        casadi.Function(f"{name}_first", arguments, [_nonzeros(jacobian, kind)]),
        casadi.Function(f"{name}_second", [*arguments, multipliers], [_nonzeros(curved, kind)]),
        jacobian.sparsity(),
        curved.sparsity(),
    )


def _nonzeros(matrix: Any, kind: Any) -> Any:
    # Indexing a row vector would give a row.
    return casadi.vec(matrix.nz[:]) if matrix.nnz() else kind(0, 1)


def _node_function(phase: Phase, parameters: int) -> Twice:
    """Return the node function of a phase: ``[(h/2) rate; (h/2) integrand; path]``.

    The first argument stacks x, u, ``T = [t0, tf]`` and p. The second is ``[σ, δ]``: the fraction of
    the phase at the instant, and the fraction that its interval covers, so that h = (tf - t0) δ.
    """
    kind = _symbols(phase.function)
    cuts = np.cumsum([0, len(phase.state_names), len(phase.control_names), 2, parameters])
    free, place = kind.sym("free", int(cuts[-1])), kind.sym("place", 2)
    x, u, times, p = casadi.vertsplit(free, cuts.tolist())
    length = times[1] - times[0]
    rate, path, integrand, _ = phase.function(times[0] + length * place[0], x, u, p)
    half = 0.5 * length * place[1]
    entries = casadi.vertcat(half * rate, half * integrand, path)
    return _differentiate("node", free, entries, [free, place], kind)


def _end_function(definition: Definition) -> Twice:
    """Return ``[objective; boundary]`` as a function of the endpoint vector and the parameters."""
    function = definition.endpoint
    kind = _symbols(function)
    free = kind.sym("free", function.size1_in(0) + function.size1_in(1))
    ends, p = casadi.vertsplit(free, [0, function.size1_in(0), free.numel()])
    entries = casadi.vertcat(*function(ends, p))
    return _differentiate("endpoint", free, entries, [free], kind)


class Functions(NamedTuple):
    """All functions of a definition: node functions of the phases, and the endpoint function."""

    nodes: tuple[Twice, ...]
    endpoint: Twice


@lru_cache(maxsize=64)
def functions_of(definition: Definition) -> Functions:
    """Return the functions of `definition`, created at the first call."""
    parameters = len(definition.parameter_names)
    nodes = tuple(_node_function(phase, parameters) for phase in definition.phases)
    return Functions(nodes, _end_function(definition))
