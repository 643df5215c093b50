"""Functions as readable data: a ``casadi.Function`` as a versioned graph of named operations.

``{"graph": 1, "functions": […]}`` lists functions, each in terms of earlier ones. The last function
is the result. A function is of one of four kinds:

========== =======================================================================================
kind       its other keys
========== =======================================================================================
``scalar`` ``name``, ``inputs``, ``outputs``, ``nodes``: every value is one number
``matrix`` the same; every value is a matrix
``map``    ``of``: index of an earlier function, ``times``: number of copies side by side
``table``  ``name``, ``method`` (linear or bspline), ``grid`` and ``numbers``: an interpolated table
========== =======================================================================================

An input is ``{"name", "shape"}``, with ``symbols`` if its symbols differ from CasADi's default names.
A shape is ``[rows, columns]``, or ``[rows, columns, colind, row]`` in compressed columns if it is
sparse. Values are numbered from 0: first the inputs (of a scalar function, each stored entry of each
input), then the results of ``nodes``, in order. A node is ``[operation, …]``: the numbers of its
arguments, then the parameters of the operation. A call has one result per result of its function (of
a scalar function, per stored entry). An output is ``{"name", "shape", "values"}``: one value per
output of a matrix function, one per stored entry of a scalar function.

The operations are ``const``, ``call``, those of :data:`UNARY` and :data:`BINARY` and, on matrices,
those of :data:`STRUCTURAL`. None of them reads a file, calls a library or runs code.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import casadi

__all__ = [
    "BINARY",
    "KEYS",
    "STRUCTURAL",
    "UNARY",
    "VERSION",
    "Unwritable",
    "operation_names",
    "write",
]

#: Version of the format.
VERSION = 1
#: Elementwise operations on one value, with CasADi's names.
UNARY = frozenset(
    [
        *("acos", "acosh", "asin", "asinh", "atan", "atanh", "ceil", "cos", "cosh", "erf"),
        *("erfinv", "exp", "expm1", "fabs", "floor", "inv", "log", "log1p", "neg", "not"),
        *("sign", "sin", "sinh", "sq", "sqrt", "tan", "tanh", "twice"),
    ]
)
#: Elementwise operations on two values; of two matrices, one may be a single number.
BINARY = frozenset(
    [
        *("add", "and", "atan2", "constpow", "copysign", "div", "eq", "fmax", "fmin", "fmod"),
        *("hypot", "if_else_zero", "le", "lt", "mul", "ne", "or", "pow", "remainder", "sub"),
    ]
)
#: Operations on whole matrices: the number of values (None for any) and the parameters.
STRUCTURAL: dict[str, tuple[int | None, tuple[str, ...]]] = {
    "bilin": (3, ()),
    "call": (None, ("function",)),
    "const": (0, ("shape", "numbers")),
    "diagcat": (None, ()),
    "dot": (2, ()),
    "getnonzeros": (1, ("shape", "places")),
    "horzcat": (None, ()),
    "horzrepmat": (1, ("times",)),
    "horzrepsum": (1, ("times",)),
    "horzsplit": (1, ("offsets",)),
    "logsumexp": (1, ()),
    "mmax": (1, ()),
    "mmin": (1, ()),
    "mtimes": (3, ()),
    "norm1": (1, ()),
    "normf": (1, ()),
    "norminf": (1, ()),
    "project": (1, ("shape",)),
    "rank1": (4, ()),
    "reshape": (1, ("shape",)),
    "setnonzeros": (2, ("places",)),
    "sparsity_cast": (1, ("shape",)),
    "transpose": (1, ()),
    "vertcat": (None, ()),
    "vertsplit": (1, ("offsets",)),
}
#: Keys of a function, by its kind.
KEYS = {
    "scalar": ("kind", "name", "inputs", "outputs", "nodes"),
    "matrix": ("kind", "name", "inputs", "outputs", "nodes"),
    "map": ("kind", "of", "times"),
    "table": ("kind", "name", "method", "grid", "numbers"),
}


class Unwritable(Exception):
    """The function contains an operation that the format does not cover."""


def write(function: casadi.Function) -> dict[str, Any]:
    """Return `function` as data in the format of this module.

    Raise ``Unwritable`` if it contains another operation, such as a call of a library or a solver.
    """
    functions: list[dict[str, Any]] = []
    _write(function, functions, {})
    return {"graph": VERSION, "functions": functions}


def _write(
    function: casadi.Function, functions: list[dict[str, Any]], known: dict[int, int]
) -> int:
    """Append the functions it calls and `function`; return its index. `known` maps hashes to indices."""
    key = function.__hash__()
    if key in known:
        return known[key]
    kind = function.class_name()
    if kind == "Map":
        info = function.info()
        entry = {"kind": "map", "of": _write(info["f"], functions, known), "times": info["n"]}
    elif kind in ("LinearInterpolant", "BSplineInterpolant"):
        entry = _write_table(function)
    elif kind == "SXFunction":
        entry = _write_scalar(function, functions, known)
    elif kind == "MXFunction":
        entry = _write_matrix(function, functions, known)
    else:
        raise Unwritable(f"a function of type {kind}")
    known[key] = len(functions)
    functions.append(entry)
    return known[key]


@cache
def operation_names() -> dict[int, str]:
    """Return the names of CasADi's operation codes, which do not depend on the version."""
    import casadi

    return {
        value: name[3:].lower() for name, value in vars(casadi).items() if name.startswith("OP_")
    }


def _number(value: float) -> float | str:
    """Return the JSON value for `value`, which may be infinite or NaN."""
    return value if math.isfinite(value) else repr(float(value))


def _shape(sparsity: casadi.Sparsity) -> list[Any]:
    rows, columns = sparsity.shape
    if sparsity.is_dense():
        return [rows, columns]
    return [rows, columns, sparsity.colind(), sparsity.row()]


def _entry(name: str, sparsity: casadi.Sparsity, **others: Any) -> dict[str, Any]:
    return {"name": name, "shape": _shape(sparsity), **others}


def _write_scalar(
    function: casadi.Function, functions: list[dict[str, Any]], known: dict[int, int]
) -> dict[str, Any]:
    import casadi

    names = operation_names()
    inputs, first = [], [0]
    for k, name in enumerate(function.name_in()):
        sparsity = function.sparsity_in(k)
        symbols, default = (
            [item.name() for item in argument.nonzeros()]  # type: ignore[attr-defined]
            for argument in (function.sx_in(k), casadi.SX.sym(name, sparsity))
        )
        extra = {} if symbols == default else {"symbols": symbols}
        inputs.append(_entry(name, sparsity, **extra))
        first.append(first[-1] + sparsity.nnz())
    total = first[-1]
    outputs = [
        _entry(name, function.sparsity_out(k), values=[0] * function.nnz_out(k))
        for k, name in enumerate(function.name_out())
    ]
    nodes: list[list[Any]] = []
    place: dict[int, int] = {}  # number of the value in each register
    calls: Any = None
    for k in range(function.n_instructions()):
        name = names[function.instruction_id(k)]
        arguments, results = function.instruction_input(k), function.instruction_output(k)
        if name == "input":
            place[results[0]] = first[arguments[0]] + arguments[1]
            continue
        if name == "output":
            outputs[results[0]]["values"][results[1]] = place[arguments[0]]
            continue
        if name == "const":
            nodes.append([name, _number(function.instruction_constant(k))])
        elif name in UNARY or name in BINARY:
            nodes.append([name, *(place[item] for item in arguments)])
        elif name == "call":
            calls = calls or function.instructions_sx().nonzeros()
            callee = _write(calls[k].which_function(), functions, known)
            nodes.append([name, *(place[item] for item in arguments), callee])
        else:
            raise Unwritable(f"operation {name}")
        for register in results:
            place[register] = total
            total += 1
    name = function.name()
    return {"kind": "scalar", "name": name, "inputs": inputs, "outputs": outputs, "nodes": nodes}


def _write_matrix(
    function: casadi.Function, functions: list[dict[str, Any]], known: dict[int, int]
) -> dict[str, Any]:
    import casadi

    names = operation_names()
    arguments = function.mx_in()
    labels = [list(function.name_in()), list(function.name_out())]
    if not all(item.is_symbolic() or not item.nnz() for item in arguments):
        # An argument that consists of several symbols is replaced by one symbol that is split.
        arguments = [
            casadi.MX.sym(name, item.sparsity())
            for name, item in zip(labels[0], arguments, strict=True)
        ]
        results = function.call(arguments, True, False)
        function = casadi.Function(function.name(), arguments, results, labels[0], labels[1])
    inputs = []
    for name, item in zip(labels[0], arguments, strict=True):
        symbol = item.name() if item.nnz() else name
        extra = {} if symbol == name else {"symbols": [symbol]}
        inputs.append(_entry(name, item.sparsity(), **extra))
    nodes: list[list[Any]] = []
    total = len(inputs)
    place: dict[int, int] = {}
    parts: list[list[int]] = [[] for _ in range(function.n_out())]  # values of each output
    for k in range(function.n_instructions()):
        name = names[function.instruction_id(k)]
        inputs_of, outputs_of = function.instruction_input(k), function.instruction_output(k)
        if name == "input":
            place[outputs_of[0]] = inputs_of[0]
            continue
        if name == "output":
            parts[outputs_of[0]].append(place[inputs_of[0]])
            continue
        node = function.instruction_MX(k)
        if name == "call":
            others = [_write(node.which_function(), functions, known)]
        else:
            others = _parameters(name, node)
        if min(inputs_of, default=0) < 0:
            raise Unwritable("a call without all its arguments")
        nodes.append([name, *(place[item] for item in inputs_of), *others])
        for register in outputs_of:
            place[register] = total
            total += 1

    def joined(expression: casadi.MX, values: Iterator[int]) -> int:
        """Return the value of an output; CasADi lists the parts of a concatenated output."""
        nonlocal total
        name = names.get(expression.op(), "")  # the result of a call has no operation
        if name in ("horzcat", "vertcat", "diagcat"):
            parts = [joined(expression.dep(k), values) for k in range(expression.n_dep())]
            nodes.append([name, *parts])
        elif name in ("reshape", "sparsity_cast"):
            nodes.append([name, joined(expression.dep(0), values), _shape(expression.sparsity())])
        elif not expression.nnz():
            nodes.append(["const", _shape(expression.sparsity()), 0])
        else:
            return next(values)
        total += 1
        return total - 1

    expressions = function.call(arguments, True, False)
    outputs = [
        _entry(name, item.sparsity(), values=[joined(item, iter(values))])
        for name, item, values in zip(function.name_out(), expressions, parts, strict=True)
    ]
    name = function.name()
    return {"kind": "matrix", "name": name, "inputs": inputs, "outputs": outputs, "nodes": nodes}


def _parameters(name: str, node: casadi.MX) -> list[Any]:
    """Return the parameters of a matrix node."""
    if name in UNARY or name in BINARY:
        return []
    if name not in STRUCTURAL:
        raise Unwritable(f"operation {name}")
    info = node.info()
    result: list[Any] = []
    for parameter in STRUCTURAL[name][1]:
        if parameter == "shape":
            result.append(_shape(node.sparsity()))
        elif parameter == "numbers":
            numbers = [_number(value) for value in node.to_DM().nonzeros()]
            result.append(numbers[0] if numbers and len(set(numbers)) == 1 else numbers)
        elif parameter == "times":
            sizes = sorted((node.size2(), node.dep(0).size2()))
            result.append(sizes[1] // max(1, sizes[0]))
        elif parameter == "offsets":
            parts, side = info["output"], int(name == "horzsplit")
            sizes = [parts.size_out(k)[side] for k in range(parts.n_out())]
            result.append([0, *itertools.accumulate(sizes)])
        elif info.get("add"):
            raise Unwritable("operation addnonzeros")
        elif "slice" in info:
            result.append(info["slice"])
        else:
            result.append(_entry_indices(info))
    return result


def _entry_indices(info: Mapping[str, Any]) -> list[int]:
    """Return the indices of the stored entries that a node reads or sets."""
    if "nz" in info:
        return list(info["nz"])
    outer, inner = (
        range(*(info[k][w] for w in ("start", "stop", "step"))) for k in ("outer", "inner")
    )
    return [first + second for first in outer for second in inner]


def _write_table(function: casadi.Function) -> dict[str, Any]:
    """Return an interpolated table, whose numbers CasADi exposes only in its text format."""
    text = function.serialize({"debug": True}).encode()
    raw = bytes(
        (low - 97) | (high - 97) << 4 for low, high in zip(text[::2], text[1::2], strict=True)
    )

    def vector(label: str, kind: str, code: str) -> list[Any]:
        start = raw.index(label.encode()) + len(label)
        (size,) = struct.unpack_from("<q", raw, start + 2)
        step = 1 + struct.calcsize(code)
        entries = [struct.unpack_from(code, raw, start + 11 + k * step)[0] for k in range(size)]
        if raw[start : start + 2] != b"VJ" or any(
            raw[start + 10 + k * step] != ord(kind) for k in range(size)
        ):
            raise Unwritable("an interpolated table of this version of CasADi")
        return entries

    grid = vector("Interpolant::grid", "d", "<d")
    offset = vector("Interpolant::offset", "J", "<q")
    return {
        "kind": "table",
        "name": function.name(),
        "method": "linear" if function.class_name() == "LinearInterpolant" else "bspline",
        "grid": [grid[first:last] for first, last in itertools.pairwise(offset)],
        "numbers": vector("Interpolant::values", "d", "<d"),
    }
