"""Functions as readable data: a ``casadi.Function`` as a versioned graph of named operations.

``{"graph": 1, "functions": […]}`` lists functions, each in terms of earlier ones; the last is the
function meant. A function is of one of four kinds:

========== =======================================================================================
kind       its other keys
========== =======================================================================================
``scalar`` ``name``, ``inputs``, ``outputs``, ``nodes``: every value is one number
``matrix`` the same; every value is a matrix
``map``    ``of``: the number of an earlier function, ``times``: how often it stands side by side
``table``  ``name``, ``method`` (linear or bspline), ``grid`` and ``numbers``: an interpolated table
========== =======================================================================================

An input is ``{"name", "shape"}``, and ``symbols`` where its symbols have other names than CasADi
gives. A shape is ``[rows, columns]``, or ``[rows, columns, colind, row]`` in compressed columns where
it is sparse. Values are numbered from 0: first the inputs (of a scalar function, each stored entry of
each input), then the results of ``nodes``, in order. A node is ``[operation, …]``: the numbers of the
values that it takes, then what else the operation needs; a call has a result for each that its
function has (of a scalar function, for each stored entry). An output is ``{"name", "shape",
"values"}``: a matrix function has one value an output, a scalar function one for each stored entry.

There are ``const``, ``call``, the operations of :data:`UNARY` and :data:`BINARY` and, on matrices,
those of :data:`STRUCTURAL`, and no others. None reads a file, calls a library or runs code.
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

#: The version of the format.
VERSION = 1
#: Operations entry by entry on one value, as CasADi calls them.
UNARY = frozenset(
    [
        "acos",
        "acosh",
        "asin",
        "asinh",
        "atan",
        "atanh",
        "ceil",
        "cos",
        "cosh",
        "erf",
        "erfinv",
        "exp",
        "expm1",
        "fabs",
        "floor",
        "inv",
        "log",
        "log1p",
        "neg",
        "not",
        "sign",
        "sin",
        "sinh",
        "sq",
        "sqrt",
        "tan",
        "tanh",
        "twice",
    ]
)
#: Operations entry by entry on two values; of two matrices, one may be a single number.
BINARY = frozenset(
    [
        "add",
        "and",
        "atan2",
        "constpow",
        "copysign",
        "div",
        "eq",
        "fmax",
        "fmin",
        "fmod",
        "hypot",
        "if_else_zero",
        "le",
        "lt",
        "mul",
        "ne",
        "or",
        "pow",
        "remainder",
        "sub",
    ]
)
#: Operations on whole matrices that CasADi can evaluate: how many values they take (None: any number), what follows them.
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
#: The keys of a function, by its kind.
KEYS = {
    "scalar": ("kind", "name", "inputs", "outputs", "nodes"),
    "matrix": ("kind", "name", "inputs", "outputs", "nodes"),
    "map": ("kind", "of", "times"),
    "table": ("kind", "name", "method", "grid", "numbers"),
}


class Unwritable(Exception):
    """A function holds what the format does not know."""


def write(function: casadi.Function) -> dict[str, Any]:
    """Return `function` as data.

    Raises
    ------
    Unwritable
        It holds an operation outside the list, such as a call of a library or a solver.
    """
    functions: list[dict[str, Any]] = []
    _write(function, functions, {})
    return {"graph": VERSION, "functions": functions}


def _write(
    function: casadi.Function, functions: list[dict[str, Any]], known: dict[int, int]
) -> int:
    """Append `function`, after what it calls, and return its number; `known` are those by hash."""
    key = function.__hash__()
    if key in known:
        return known[key]
    kind = function.class_name()
    if kind == "Map":
        given = function.info()
        made = {"kind": "map", "of": _write(given["f"], functions, known), "times": given["n"]}
    elif kind in ("LinearInterpolant", "BSplineInterpolant"):
        made = _write_table(function)
    elif kind == "SXFunction":
        made = _write_scalar(function, functions, known)
    elif kind == "MXFunction":
        made = _write_matrix(function, functions, known)
    else:
        raise Unwritable(f"a function of type {kind}")
    known[key] = len(functions)
    functions.append(made)
    return known[key]


@cache
def operation_names() -> dict[int, str]:
    """Return CasADi's numbers of operations with their names, which do not change by version."""
    import casadi

    return {
        value: name[3:].lower() for name, value in vars(casadi).items() if name.startswith("OP_")
    }


def _number(value: float) -> float | str:
    """Return what JSON holds for `value`, which may be infinite or no number."""
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
    inputs, first = [], []
    total = 0
    for k, name in enumerate(function.name_in()):
        sparsity = function.sparsity_in(k)
        given, usual = (
            [one.name() for one in argument.nonzeros()]  # type: ignore[attr-defined]
            for argument in (function.sx_in(k), casadi.SX.sym(name, sparsity))
        )
        inputs.append(_entry(name, sparsity, **({} if given == usual else {"symbols": given})))
        first.append(total)
        total += sparsity.nnz()
    outputs = [
        _entry(name, function.sparsity_out(k), values=[0] * function.nnz_out(k))
        for k, name in enumerate(function.name_out())
    ]
    nodes: list[list[Any]] = []
    place: dict[int, int] = {}  # what each register holds
    calls: Any = None
    for k in range(function.n_instructions()):
        name = names[function.instruction_id(k)]
        taken, made = function.instruction_input(k), function.instruction_output(k)
        if name == "input":
            place[made[0]] = first[taken[0]] + taken[1]
            continue
        if name == "output":
            outputs[made[0]]["values"][made[1]] = place[taken[0]]
            continue
        if name == "const":
            nodes.append([name, _number(function.instruction_constant(k))])
        elif name in UNARY or name in BINARY:
            nodes.append([name, *(place[one] for one in taken)])
        elif name == "call":
            calls = calls or function.instructions_sx().nonzeros()
            called = _write(calls[k].which_function(), functions, known)
            nodes.append([name, *(place[one] for one in taken), called])
        else:
            raise Unwritable(f"operation {name}")
        for register in made:
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
    if not all(one.is_symbolic() or not one.nnz() for one in arguments):
        # An argument that is made of several symbols becomes one that is taken apart.
        arguments = [
            casadi.MX.sym(name, one.sparsity())
            for name, one in zip(labels[0], arguments, strict=True)
        ]
        results = function.call(arguments, True, False)
        function = casadi.Function(function.name(), arguments, results, labels[0], labels[1])
    inputs = []
    for name, one in zip(labels[0], arguments, strict=True):
        symbol = one.name() if one.nnz() else name
        further = {} if symbol == name else {"symbols": [symbol]}
        inputs.append(_entry(name, one.sparsity(), **further))
    nodes: list[list[Any]] = []
    total = len(inputs)
    place: dict[int, int] = {}
    parts: list[list[int]] = [[] for _ in range(function.n_out())]  # of each output
    for k in range(function.n_instructions()):
        name = names[function.instruction_id(k)]
        taken, made = function.instruction_input(k), function.instruction_output(k)
        if name == "input":
            place[made[0]] = taken[0]
            continue
        if name == "output":
            parts[made[0]].append(place[taken[0]])
            continue
        node = function.instruction_MX(k)
        if name == "call":
            others = [_write(node.which_function(), functions, known)]
        else:
            others = _others(name, node)
        if min(taken, default=0) < 0:
            raise Unwritable("a call without all its arguments")
        nodes.append([name, *(place[one] for one in taken), *others])
        for register in made:
            place[register] = total
            total += 1

    def joined(expression: casadi.MX, values: Iterator[int]) -> int:
        """Return the value of an output; CasADi's list has the parts of what it puts together."""
        nonlocal total
        name = names.get(expression.op(), "")  # a call's result has none
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

    outputs = []
    expressions = function.call(arguments, True, False)
    for name, one, values in zip(function.name_out(), expressions, parts, strict=True):
        outputs.append(_entry(name, one.sparsity(), values=[joined(one, iter(values))]))
    name = function.name()
    return {"kind": "matrix", "name": name, "inputs": inputs, "outputs": outputs, "nodes": nodes}


def _others(name: str, node: casadi.MX) -> list[Any]:
    """Return what follows the values of a matrix node."""
    if name in UNARY or name in BINARY:
        return []
    if name not in STRUCTURAL:
        raise Unwritable(f"operation {name}")
    given = node.info()
    found: list[Any] = []
    for what in STRUCTURAL[name][1]:
        if what == "shape":
            found.append(_shape(node.sparsity()))
        elif what == "numbers":
            numbers = [_number(one) for one in node.to_DM().nonzeros()]
            found.append(numbers[0] if numbers and len(set(numbers)) == 1 else numbers)
        elif what == "times":
            sizes = sorted((node.size2(), node.dep(0).size2()))
            found.append(sizes[1] // max(1, sizes[0]))
        elif what == "offsets":
            parts, side = given["output"], int(name == "horzsplit")
            sizes = [parts.size_out(k)[side] for k in range(parts.n_out())]
            found.append([0, *itertools.accumulate(sizes)])
        elif given.get("add"):
            raise Unwritable("operation addnonzeros")
        elif "slice" in given:
            found.append(given["slice"])
        else:
            found.append(_places(given))
    return found


def _places(given: Mapping[str, Any]) -> list[int]:
    """Return the stored entries that a node takes or sets, one by one."""
    if "nz" in given:
        return list(given["nz"])
    outer, inner = (
        range(*(given[k][w] for w in ("start", "stop", "step"))) for k in ("outer", "inner")
    )
    return [one + other for one in outer for other in inner]


def _write_table(function: casadi.Function) -> dict[str, Any]:
    """Return an interpolated table; CasADi tells its numbers only in its own text."""
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
        "grid": [grid[one:other] for one, other in itertools.pairwise(offset)],
        "numbers": vector("Interpolant::values", "d", "<d"),
    }
