"""Reconstruction of functions from readable data with a closed list of operations.

The format is that of :mod:`.expressions`. Files may come from untrusted sources, so the data are
checked before CasADi uses them, and bounded before anything is allocated.
"""

from __future__ import annotations

import itertools
import logging
import math
import sys
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

from ...errors import InvalidData
from ..fields import show
from .expressions import (
    BINARY,
    KEYS,
    STRUCTURAL,
    UNARY,
    VERSION,
    Unwritable,
    operation_names,
    write,
)

if TYPE_CHECKING:
    import casadi

__all__ = ["LARGEST", "read", "readable"]

log = logging.getLogger("crosstrack")

#: Largest number of entries of all values of a function, counted for every call: a few hundred MB,
#: and a tenth of a second per evaluation.
LARGEST = 20_000_000
#: Largest depth of nested calls.
DEEPEST = 100
#: Weight of a symbol of a scalar function, which is an object of its own.
SYMBOL = 20


def read(data: Any, field: str = "function") -> casadi.Function:
    """Return the function in data written by :func:`write`; `field` names it in messages.

    Raise ``InvalidData`` with the place if a version or an operation is unknown, a number refers to no earlier
    value, a shape does not fit, or there are more than :data:`LARGEST` entries.
    """
    reader = _Reader(field)
    reader.keyed(data, ("graph", "functions"), field)
    if data["graph"] != VERSION or isinstance(data["graph"], bool):
        reader.refuse(f"graph must be version {VERSION}, got {show(data['graph'])}")
    for number, entry in enumerate(reader.items(data["functions"], f"{field}.functions")):
        reader.function(entry, f"{field}.functions[{number}]")
    if not reader.functions:
        reader.refuse("functions must hold 1 function at least, got 0")
    function = reader.functions[-1]
    try:
        function.call([reader.casadi.DM(function.sparsity_in(k)) for k in range(function.n_in())])
    except RuntimeError as error:
        reader.refuse(f"cannot be evaluated: {_last_line(error)}")
    return function


#: Number of values and the parameters of every operation on matrices.
_SIGNATURES: dict[str, tuple[int | None, tuple[str, ...]]] = {
    **dict.fromkeys(UNARY, (1, ())), **dict.fromkeys(BINARY, (2, ())), **STRUCTURAL
}  # fmt: skip
#: Names in CasADi of structural operations without parameters that differ from ours.
_PLAIN = {"norm1": "norm_1", "normf": "norm_fro", "norminf": "norm_inf"}


def _last_line(error: Exception) -> str:
    """Return the message of CasADi without the locations in its source."""
    return show((str(error).strip() or type(error).__name__).splitlines()[-1])


class _Reader:
    """Reader that rebuilds functions one by one and checks every number before its use."""

    def __init__(self, field: str) -> None:
        import casadi

        self.casadi: Any = casadi
        self.field = field.partition("[")[0]
        self.place = field
        self.functions: list[casadi.Function] = []
        #: Number of entries per function, including those of its calls, and their sum.
        self.costs: list[int] = []
        self.total = 0
        #: Depth of calls per function, and of the function being built.
        self.depths: list[int] = []
        self.depth = 0
        self.codes = {name: code for code, name in operation_names().items()}

    # -- pieces of data --

    def refuse(self, what: str) -> NoReturn:
        raise InvalidData(f"{self.place}: {what}", field=self.field)

    def keyed(
        self, data: Any, keys: tuple[str, ...], place: str, further: tuple[str, ...] = ()
    ) -> None:
        """Raise unless `data` is an object with all of `keys` and no others than `further`."""
        self.place = place
        if not isinstance(data, Mapping):
            self.refuse(f"must be an object, got {show(data)}")
        for key in data:
            if key not in keys and key not in further:
                allowed = ", ".join((*keys, *further))
                self.refuse(f"unknown key {show(key)}; allowed: {allowed}")
        for key in keys:
            if key not in data:
                self.refuse(f"key {key!r} is missing")

    def items(self, data: Any, place: str) -> Any:
        self.place = place
        if not isinstance(data, list | tuple):
            self.refuse(f"must be a list, got {show(data)}")
        return data

    def text(self, data: Any) -> str:
        if not isinstance(data, str):
            self.refuse(f"must be a string, got {show(data)}")
        return data

    def whole(self, data: Any, end: int, what: str) -> int:
        """Return `data` if it is an integer from 0 to `end` - 1, or raise."""
        if type(data) is not int or not 0 <= data < end:
            self.refuse(f"{what} must be a whole number >= 0 and < {end}, got {show(data)}")
        return data

    def times(self, data: Any) -> int:
        """Return `data` if it is a positive count, or raise: CasADi divides by it."""
        return self.whole(data, LARGEST, "times") or self.refuse("times must be >= 1, got 0")

    def wholes(self, data: Any, end: int, what: str) -> list[int]:
        if not isinstance(data, list | tuple):
            self.refuse(f"{what} must be a list, got {show(data)}")
        return [self.whole(item, end, what) for item in data]

    def finites(self, data: Any, place: str) -> list[float]:
        """Return the finite numbers of a list."""
        numbers = [self.number(item) for item in self.items(data, place)]
        for value in numbers:
            if not math.isfinite(value):
                self.refuse(f"must be finite, got {value}")
        return numbers

    def number(self, data: Any) -> float:
        if isinstance(data, str) and data in ("inf", "-inf", "nan"):
            return float(data)
        if type(data) not in (int, float) or not abs(data) <= sys.float_info.max:
            self.refuse(f'must be a number, "inf", "-inf" or "nan", got {show(data)}')
        return float(data)

    def count(self, entries: int) -> None:
        """Add `entries` to the count, or raise if it exceeds the limit."""
        self.total += entries
        if self.total > LARGEST:
            self.refuse(f"more than {LARGEST} entries in all")

    def shape(self, data: Any, weight: int = 1) -> Any:
        if not isinstance(data, list | tuple) or len(data) not in (2, 4):
            self.refuse(f"a shape must be [rows, columns] or with colind and row, got {show(data)}")
        rows, columns = (self.whole(item, 2**31, "rows and columns") for item in data[:2])
        if len(data) == 2:
            self.count(rows + columns + rows * columns * weight)
            return self.casadi.Sparsity.dense(rows, columns)
        row = self.wholes(data[3], max(rows, 1), "row")
        colind = self.wholes(data[2], len(row) + 1, "colind")
        self.count(rows + columns + len(row) * weight)
        if len(colind) != columns + 1 or colind[0] != 0 or colind[-1] != len(row):
            self.refuse(f"colind must hold {columns + 1} numbers from 0 to {len(row)}")
        for start, end in itertools.pairwise(colind):
            part = row[start:end]
            if end < start or part != sorted(set(part)):
                self.refuse("colind must not decrease, and rows must increase in each column")
        return self.casadi.Sparsity(rows, columns, colind, row)

    # -- functions --

    def function(self, data: Any, place: str) -> None:
        """Append the function in `data`."""
        self.place = place
        kind = data.get("kind") if isinstance(data, Mapping) else None
        if not isinstance(kind, str) or kind not in KEYS:
            self.refuse(f"kind must be one of {', '.join(KEYS)}, got {show(kind)}")
        self.keyed(data, KEYS[kind], place)
        before, self.depth = self.total, 0
        try:
            result = getattr(self, f"_{kind}")(data, place)
        except InvalidData:
            raise
        except (RuntimeError, NotImplementedError, TypeError, ValueError, OverflowError) as error:
            # CasADi's own checks, such as shapes that do not fit or an invalid name.
            self.refuse(f"no valid function: {_last_line(error)}")
        self.functions.append(result)
        self.costs.append(self.total - before)
        self.depths.append(self.depth)

    def called(self, data: Any, times: int = 1) -> casadi.Function:
        """Return an earlier function and add the cost of `times` calls."""
        index = self.whole(data, len(self.functions), "a function")
        self.count(times * max(1, self.costs[index]))
        self.depth = max(self.depth, 1 + self.depths[index])
        if self.depth > DEEPEST:
            self.refuse(f"calls are nested more than {DEEPEST} deep")
        return self.functions[index]

    def _entries(self, data: Any, place: str, further: str) -> Iterator[Any]:
        """Yield the checked inputs or outputs in `data`."""
        for k, entry in enumerate(self.items(data, place)):
            self.keyed(entry, ("name", "shape"), f"{place}[{k}]", (further,))
            self.text(entry["name"])
            yield entry

    def _map(self, data: Any, place: str) -> casadi.Function:
        times = self.times(data["times"])
        return self.called(data["of"], times).map(times)

    def _table(self, data: Any, place: str) -> casadi.Function:
        if data["method"] not in ("linear", "bspline"):
            self.refuse(f"method must be linear or bspline, got {show(data['method'])}")
        axes = self.items(data["grid"], f"{place}.grid")
        grid = [self.finites(axis, f"{place}.grid") for axis in axes]
        numbers = self.finites(data["numbers"], f"{place}.numbers")
        self.place = place
        size = math.prod(map(len, grid))
        if not grid or not size or not numbers or len(numbers) % size:
            self.refuse(f"{len(numbers)} numbers do not fit a grid of {size} points")
        # The coefficients of a spline solve a banded system.
        self.count(size * (size // max(map(len, grid)) if data["method"] == "bspline" else 1))
        name = self.text(data["name"])
        function: casadi.Function = self.casadi.interpolant(name, data["method"], grid, numbers)
        if data["method"] == "bspline":
            # CasADi stores derivatives in a spline once they have been requested. They are
            # requested here, so that a digest does not depend on earlier solves.
            x = self.casadi.MX.sym("x", len(grid))
            y = function(x)
            weights = self.casadi.MX.sym("weights", y.numel())
            self.casadi.hessian(self.casadi.dot(weights, self.casadi.vec(y)), x)
        return function

    def _scalar(self, data: Any, place: str) -> Any:
        sx = self.casadi.SX
        arguments: list[Any] = []
        values: list[Any] = []
        for entry in self._entries(data["inputs"], f"{place}.inputs", "symbols"):
            shape = self.shape(entry["shape"], SYMBOL)
            if "symbols" in entry:
                names = self.items(entry["symbols"], self.place)
                argument = self._fill(shape, [sx.sym(self.text(name)) for name in names])
            else:
                argument = sx.sym(entry["name"], shape)
            arguments.append(argument)
            values += argument.nonzeros()
        nodes = self.items(data["nodes"], f"{place}.nodes")
        self.count(len(nodes))
        for k, node in enumerate(nodes):
            self.place = f"{place}.nodes[{k}]"
            name, *others = self._operation(node)
            if name == "const" and len(others) == 1:
                values.append(sx(self.number(others[0])))
            elif name == "call" and others:
                values += self._scalar_call(others.pop(), self._arguments(values, others))
            elif name in UNARY and len(others) == 1:
                values.append(sx.unary(self.codes[name], *self._arguments(values, others)))
            elif name in BINARY and len(others) == 2:
                values.append(sx.binary(self.codes[name], *self._arguments(values, others)))
            else:
                self.refuse(f"must be an operation on numbers and what it takes, got {show(node)}")
        results = []
        for entry in self._entries(data["outputs"], f"{place}.outputs", "values"):
            entries = self._arguments(values, self.items(entry.get("values"), self.place))
            results.append(self._fill(self.shape(entry["shape"]), entries))
        return self._build(data, place, arguments, results)

    def _fill(self, shape: Any, entries: list[Any]) -> Any:
        """Return the scalar expressions `entries` as a matrix."""
        if shape.nnz() != len(entries):
            self.refuse(f"a shape with {shape.nnz()} entries is given {len(entries)}")
        return self.casadi.SX(shape, self.casadi.vertcat(self.casadi.SX(0, 1), *entries))

    def _matrix(self, data: Any, place: str) -> Any:
        mx = self.casadi.MX
        arguments = []
        for entry in self._entries(data["inputs"], f"{place}.inputs", "symbols"):
            symbols = self.items(entry.get("symbols", [entry["name"]]), self.place)
            if len(symbols) != 1:
                self.refuse(f"symbols must hold 1 name, got {len(symbols)}")
            arguments.append(mx.sym(self.text(symbols[0]), self.shape(entry["shape"])))
        values: list[Any] = list(arguments)
        for k, node in enumerate(self.items(data["nodes"], f"{place}.nodes")):
            self.place = f"{place}.nodes[{k}]"
            name, *others = self._operation(node)
            if name not in _SIGNATURES:
                self.refuse(f"unknown operation {show(name)}")
            count, parameters = _SIGNATURES[name]
            arity = len(others) - len(parameters) if count is None else count
            if arity < 0 or len(others) != arity + len(parameters):
                what = ", ".join([f"{'' if count is None else arity} values", *parameters])
                self.refuse(f"{name} takes {what.strip()}, got {show(node)}")
            taken = self._arguments(values, others[:arity])
            if name in UNARY:
                results_of = [mx.unary(self.codes[name], *taken)]
            elif name in BINARY:
                results_of = [mx.binary(self.codes[name], *taken)]
            else:
                results_of = getattr(self, f"_{name}", self._plain)(name, taken, *others[arity:])
            for entry in results_of:
                self.count(entry.nnz())
            values += results_of
        results = []
        for entry in self._entries(data["outputs"], f"{place}.outputs", "values"):
            outputs = self._arguments(values, self.items(entry.get("values"), self.place))
            if len(outputs) != 1 or outputs[0].sparsity() != self.shape(entry["shape"]):
                self.refuse("values must hold 1 value, of the shape given")
            results += outputs
        return self._build(data, place, arguments, results)

    def _arguments(self, values: list[Any], numbers: list[Any]) -> list[Any]:
        return [values[self.whole(index, len(values), "a value")] for index in numbers]

    def _operation(self, node: Any) -> Any:
        if not isinstance(node, list | tuple) or not node or not isinstance(node[0], str):
            self.refuse(f"must be [operation, …], got {show(node)}")
        return node

    def _build(self, data: Any, place: str, arguments: list[Any], results: list[Any]) -> Any:
        self.place = place
        names = ([entry["name"] for entry in data[key]] for key in ("inputs", "outputs"))
        return self.casadi.Function(self.text(data["name"]), arguments, results, *names)

    # -- matrix operations: name, values, parameters --

    def _plain(self, name: str, taken: list[Any]) -> list[Any]:
        # The result has as many entries as all arguments together.
        self.count(sum(value.nnz() + sum(value.shape) for value in taken))
        return [getattr(self.casadi, _PLAIN.get(name, name))(*taken)]

    def _const(self, name: str, taken: list[Any], shape: Any, numbers: Any) -> list[Any]:
        sparsity = self.shape(shape)
        if isinstance(numbers, list | tuple):
            if len(numbers) != sparsity.nnz():
                self.refuse(f"numbers must be {sparsity.nnz()}, got {len(numbers)}")
            return [self.casadi.MX(self.casadi.DM(sparsity, list(map(self.number, numbers))))]
        return [self.casadi.MX(self.casadi.DM(sparsity, self.number(numbers)))]

    def _call(self, name: str, taken: list[Any], number: Any) -> list[Any]:
        return self.called(number).call(taken, False, True)

    def _scalar_call(self, number: Any, taken: list[Any]) -> list[Any]:
        function = self.called(number)
        sizes = [function.nnz_in(k) for k in range(function.n_in())]
        if sum(sizes) != len(taken):
            self.refuse(f"function {number} takes {sum(sizes)} values, got {len(taken)}")
        self.count(SYMBOL * sum(function.nnz_out(k) for k in range(function.n_out())))
        ends = itertools.accumulate(sizes)
        arguments = [
            self._fill(function.sparsity_in(k), taken[end - size : end])
            for k, (size, end) in enumerate(zip(sizes, ends, strict=True))
        ]
        results = function.call(arguments, False, True)
        return [entry for result in results for entry in result.nonzeros()]

    def _mtimes(self, name: str, taken: list[Any]) -> list[Any]:
        return [self.casadi.mac(taken[1], taken[2], taken[0])]

    def _getnonzeros(self, name: str, taken: list[Any], shape: Any, places: Any) -> list[Any]:
        sparsity = self.shape(shape)
        entries = taken[0].nz[self.casadi.DM(sparsity, self._places(places, taken[0].nnz()))]
        same = entries.shape == sparsity.shape
        return [entries if same else self.casadi.reshape(entries, sparsity)]

    def _setnonzeros(self, name: str, taken: list[Any], places: Any) -> list[Any]:
        result = self.casadi.MX(taken[0])
        result.nz[self._places(places, result.nnz())] = taken[1]
        return [result]

    def _places(self, data: Any, end: int) -> list[int]:
        if not isinstance(data, Mapping):
            return self.wholes(data, end, "places")
        self.keyed(data, ("start", "stop", "step"), self.place)
        start, stop = (self.whole(data[key], end + 1, key) for key in ("start", "stop"))
        return list(range(start, stop, self.whole(data["step"], end + 1, "step") or 1))

    def _horzrepmat(self, name: str, taken: list[Any], times: Any) -> list[Any]:
        count = self.times(times)
        self.count(count * (taken[0].nnz() + taken[0].size2()))
        return [self.casadi.repmat(taken[0], 1, count)]

    def _horzrepsum(self, name: str, taken: list[Any], times: Any) -> list[Any]:
        count = self.times(times)
        if taken[0].size2() % count:
            self.refuse(f"{taken[0].size2()} columns are no {count} blocks")
        return [self.casadi.repsum(taken[0], 1, count)]

    def _horzsplit(self, name: str, taken: list[Any], offsets: Any) -> list[Any]:
        ends = self.wholes(offsets, max(taken[0].shape) + 1, "offsets")
        return list(getattr(self.casadi, name)(taken[0], ends))

    _vertsplit = _horzsplit

    def _reshape(self, name: str, taken: list[Any], shape: Any) -> list[Any]:
        return [getattr(self.casadi, name)(taken[0], self.shape(shape))]

    _project = _sparsity_cast = _reshape


def readable(function: casadi.Function) -> tuple[dict[str, Any] | str, casadi.Function]:
    """Return the stored form of `function`, and the function that reading it gives.

    A function that the format does not cover is stored in CasADi's text format, with `function` itself.
    """
    try:
        data = write(function)
        rebuilt = read(data)
    except (Unwritable, InvalidData, RecursionError) as error:
        log.info("function %r is stored as CasADi's own text: %s", function.name(), error)
        return function.serialize(), function
    # The rebuilt function may lose a cached derivative, but its values must not differ.
    if rebuilt.serialize() != function.serialize() and not _agree(function, rebuilt):
        return function.serialize(), function
    return data, rebuilt


def _agree(function: casadi.Function, other: casadi.Function) -> bool:
    """Return whether two functions give bitwise equal numbers at random points."""
    import casadi
    import numpy as np

    draw = np.random.default_rng(0)
    for sample in (draw.standard_normal, draw.random):
        shapes = map(function.sparsity_in, range(function.n_in()))
        point = [casadi.DM(shape, sample(shape.nnz())) for shape in shapes]
        for first, second in zip(function.call(point), other.call(point), strict=True):
            numbers = first.nonzeros(), second.nonzeros()
            if first.sparsity() != second.sparsity() or not np.array_equal(
                *numbers, equal_nan=True
            ):
                return False
    return True
