"""Readers of MPS, LP and NL files that are independent of those of the package, for comparisons."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

#: Bounds of this magnitude are infinite for the readers.
INFINITE = 1e20


def _bound(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) >= INFINITE else float(value)


def canonical(
    columns: dict[str, tuple[float, float, float, bool]],
    rows: list[tuple[float, float, dict[str, float]]],
    products: dict[frozenset[str], float],
    offset: float,
    maximise: bool,
) -> dict[str, Any]:
    """Return the content of a program independent of the order and of the names of rows.

    Rows without bounds are dropped. Numbers are rounded to 10 digits, because readers compute the
    second side of a range in different ways.
    """

    def text(value: float) -> str:
        return f"{value + 0.0:.9e}"

    def bounds(lower: float, upper: float, whole: bool) -> tuple[str, str]:
        lower, upper = _bound(lower), _bound(upper)
        if whole:  # SCIP rounds bounds of integer columns
            lower = lower if math.isinf(lower) else math.ceil(lower - 1e-9)
            upper = upper if math.isinf(upper) else math.floor(upper + 1e-9)
        return text(lower), text(upper)

    sides = [
        (*bounds(lower, upper, False), tuple(sorted((n, text(v)) for n, v in terms.items() if v)))
        for lower, upper, terms in rows
        if abs(lower) < INFINITE or abs(upper) < INFINITE
    ]
    return {
        "columns": {
            name: (text(cost), *bounds(lower, upper, whole), whole)
            for name, (cost, lower, upper, whole) in columns.items()
        },
        "rows": sorted(sides),
        "products": {tuple(sorted(pair)): text(value) for pair, value in products.items() if value},
        "offset": text(offset),
        "maximise": maximise,
    }


def of_program(program: Any) -> dict[str, Any]:
    """Return the content of a program of the package, in the direction of its author."""
    sign = -1.0 if program.maximise else 1.0
    names = list(program.columns[0].labels) if program.columns else []
    matrix = program.matrix.tocsr()
    rows = []
    for row in range(matrix.shape[0]):
        part = slice(matrix.indptr[row], matrix.indptr[row + 1])
        terms = {
            names[column]: float(value)
            for column, value in zip(matrix.indices[part], matrix.data[part], strict=True)
        }
        rows.append((float(program.row_lower[row]), float(program.row_upper[row]), terms))
    integral = program.integral if program.integral is not None else np.zeros(program.size, bool)
    columns = {
        name: (sign * float(cost), float(lower), float(upper), bool(whole))
        for name, cost, lower, upper, whole in zip(
            names, program.cost, program.column_lower, program.column_upper, integral, strict=True
        )
    }
    products: dict[frozenset[str], float] = {}
    if hasattr(program, "hessian"):
        entries = program.hessian.tocoo()
        for i, j, value in zip(*entries.coords, entries.data, strict=True):
            pair = frozenset((names[i], names[j]))
            products[pair] = products.get(pair, 0.0) + sign * float(value) / 2
    return canonical(columns, rows, products, sign * program.offset, program.maximise)


def of_gurobi(path: Path) -> dict[str, Any]:
    """Return the content of a file as Gurobi reads it; raises `ValueError` if it cannot."""
    import gurobipy

    global _ENVIRONMENT
    if _ENVIRONMENT is None:
        _ENVIRONMENT = gurobipy.Env(empty=True)
        _ENVIRONMENT.setParam("OutputFlag", 0)
        _ENVIRONMENT.start()
    try:
        model = gurobipy.read(str(path), _ENVIRONMENT)
    except gurobipy.GurobiError as error:
        raise ValueError(str(error)) from None
    if model.NumSOS or model.NumQConstrs or model.NumGenConstrs:
        raise ValueError("more than a quadratic program")
    # A range is a column with the prefix "MPS_Rg" or "Rg", and one entry.
    columns, ranges, offset = {}, {}, model.ObjCon
    for var in model.getVars():
        if var.VarName[0] in ".0123456789" and not model.getCol(var).size():
            # Gurobi reads a constant of the objective as a column of this name.
            offset += var.Obj * float(var.VarName)
            continue
        if var.VType not in "CIB":
            raise ValueError("a semi-continuous column")
        if var.VarName.startswith("MPS_Rg"):
            ranges[var.VarName] = var.UB
        else:
            columns[var.VarName] = (var.Obj, var.LB, var.UB, var.VType != "C")
    rows, matrix = [], model.getA().tocsr()
    names = [var.VarName for var in model.getVars()]
    for row, constraint in enumerate(model.getConstrs()):
        lower = -math.inf if constraint.Sense == "<" else constraint.RHS
        upper = math.inf if constraint.Sense == ">" else constraint.RHS
        terms, part = {}, slice(*matrix.indptr[row : row + 2])
        for column, value in zip(matrix.indices[part], matrix.data[part].tolist(), strict=True):
            name = names[column]
            if name not in ranges:
                terms[name] = value
            elif value > 0:
                lower -= ranges[name]
            else:
                upper += ranges[name]
        rows.append((lower, upper, terms))
    products: dict[frozenset[str], float] = {}
    if model.IsQP:
        objective = model.getObjective()
        for k in range(objective.size()):
            pair = frozenset((objective.getVar1(k).VarName, objective.getVar2(k).VarName))
            products[pair] = products.get(pair, 0.0) + objective.getCoeff(k)
    return canonical(columns, rows, products, offset, model.ModelSense < 0)


_ENVIRONMENT: Any = None


def of_scip(path: Path) -> dict[str, Any]:
    """Return the content of a file as SCIP reads it; raises `ValueError` if it cannot."""
    import pyscipopt

    model = pyscipopt.Model()
    model.hideOutput()
    try:
        model.readProblem(str(path))
    except (OSError, Exception) as error:  # PySCIPOpt raises plain exceptions
        raise ValueError(str(error)) from None
    columns, rows = {}, []
    for var in model.getVars():
        whole = var.vtype() != "CONTINUOUS"
        columns[var.name] = (
            var.getObj(),
            var.getLbOriginal(),
            var.getUbOriginal(),
            whole,
        )
    for constraint in model.getConss():
        if not constraint.isLinear():
            raise ValueError(f"a constraint of type {constraint.getConshdlrName()}")
        terms = dict(model.getValsLinear(constraint))
        rows.append((model.getLhs(constraint), model.getRhs(constraint), terms))
    return canonical(
        columns, rows, {}, model.getObjoffset(), model.getObjectiveSense() == "maximize"
    )


class NlReader:
    """Program in an NL file in text form, evaluated without CasADi."""

    _UNARY: ClassVar[dict[int, Callable[[float], float]]] = {
        13: math.floor, 14: math.ceil, 15: abs, 16: lambda x: -x, 37: math.tanh, 38: math.tan, 39: math.sqrt,
        40: math.sinh, 41: math.sin, 42: math.log10, 43: math.log, 44: math.exp, 45: math.cosh, 46: math.cos,
        49: math.atan, 51: math.asin, 53: math.acos,
    }  # fmt: skip
    _BINARY: ClassVar[dict[int, Callable[[float, float], float]]] = {
        0: lambda x, y: x + y, 1: lambda x, y: x - y, 2: lambda x, y: x * y, 3: lambda x, y: x / y,
        5: math.pow, 48: math.atan2,
    }  # fmt: skip

    def __init__(self, path: Path) -> None:
        lines = [line.partition("#")[0].split() for line in path.read_text().splitlines()]
        head = [[int(field) for field in line] for line in lines[1:10]]
        self.columns, self.rows = head[0][:2]
        self.expressions: dict[tuple[str, int], list[str]] = {}
        self.linear: dict[tuple[str, int], list[tuple[int, float]]] = {}
        self.bounds: dict[str, list[tuple[float, float]]] = {"b": [], "r": []}
        self.guess = [0.0] * self.columns
        self.maximise = False
        self.integral = self._integral(head)
        self._lines = iter(lines[10:])
        for line in self._lines:
            if line:
                self._segment(line[0][0], int(line[0][1:] or 0), line[1:])

    def _integral(self, head: list[list[int]]) -> list[bool]:
        """Return the integer columns, in the order of table 3 of Gay (2005)."""
        in_rows, in_objective, both = head[3][:3]
        binary, other, *nonlinear = head[5][:5]
        last = max(in_rows, in_objective)
        sizes = (both, in_rows - both, last - in_rows)
        result: list[bool] = []
        for size, whole in zip(sizes, nonlinear, strict=True):
            result += [False] * (size - whole) + [True] * whole
        return result + [
            k >= self.columns - last - binary - other for k in range(self.columns - last)
        ]

    def _segment(self, letter: str, number: int, rest: list[str]) -> None:
        if letter in "COV":
            if letter == "O":
                self.maximise = rest[0] == "1"
            if letter == "V":
                self.linear["V", number] = self._terms(int(rest[0]))
            self.expressions[letter, number] = self._expression()
        elif letter in "JG":
            self.linear["C" if letter == "J" else "O", number] = self._terms(int(rest[0]))
        elif letter in "br":
            for _ in range(self.columns if letter == "b" else self.rows):
                kind, *values = next(self._lines)
                low, high = {
                    "0": lambda a, b: (a, b), "1": lambda a: (-math.inf, a), "2": lambda a: (a, math.inf),
                    "3": lambda: (-math.inf, math.inf), "4": lambda a: (a, a),
                }[kind](*map(float, values))  # fmt: skip
                self.bounds[letter].append((low, high))
        elif letter == "x":
            for place, value in self._terms(number):
                self.guess[place] = value
        elif letter == "d":
            self._terms(number)
        elif letter == "k":
            for _ in range(number):
                next(self._lines)
        else:
            raise ValueError(letter)

    def _terms(self, count: int) -> list[tuple[int, float]]:
        pairs = [next(self._lines) for _ in range(count)]
        return [(int(index), float(value)) for index, value in pairs]

    def _expression(self) -> list[str]:
        tokens: list[str] = []
        missing = 1
        while missing:
            (token,) = next(self._lines)
            missing -= 1
            if token == "o54":
                (count,) = next(self._lines)
                token, missing = f"o54 {count}", missing + int(count)
            elif token[0] == "o":
                missing += 1 if int(token[1:]) in self._UNARY else 2
            tokens.append(token)
        return tokens

    def value(self, key: tuple[str, int], point: list[float]) -> float:
        """Return the value of a row ``("C", i)`` or of the objective ``("O", 0)``; NaN if undefined."""
        total = sum(value * self._column(k, point) for k, value in self.linear.get(key, []))
        stack: list[float] = []
        for token in reversed(self.expressions.get(key, ["n0"])):
            kind, rest = token[0], token[1:]
            if kind == "v":
                stack.append(self._column(int(rest), point))
            elif kind in "nsl":
                stack.append(float(rest))
            else:
                operator, _, count = rest.partition(" ")
                size = int(count) if count else 1 if int(operator) in self._UNARY else 2
                given = [stack.pop() for _ in range(size)]
                try:
                    if count:
                        stack.append(sum(given))
                    else:
                        stack.append((self._UNARY | self._BINARY)[int(operator)](*given))  # type: ignore[operator]
                except (ValueError, ZeroDivisionError, OverflowError):
                    stack.append(math.nan)
        (result,) = stack
        return total + result

    def _column(self, index: int, point: list[float]) -> float:
        return point[index] if index < self.columns else self.value(("V", index), point)

    def differs(self, program: Any) -> str:
        """Return the first part of a nonlinear program that differs; empty if it is the same."""
        given = program.integral
        integral = [False] * self.columns if given is None else list(map(bool, given))
        sides = {
            "b": list(
                zip(program.column_lower.tolist(), program.column_upper.tolist(), strict=True)
            ),
            "r": list(zip(program.row_lower.tolist(), program.row_upper.tolist(), strict=True)),
        }
        for name, mine, theirs in (
            ("direction", self.maximise, program.maximise),
            ("integer columns", self.integral, integral),
            ("bounds", self.bounds["b"], sides["b"]),
            ("sides", self.bounds["r"], sides["r"]),
            ("start", self.guess, program.guess.tolist()),
        ):
            if mine != theirs:
                return name
        generator = np.random.default_rng(0)
        for scale in (0.3, 1.0, 3.0):
            point = (scale * generator.normal(size=self.columns)).tolist()
            objective, rows = program.values(np.array(point))
            sign = -1.0 if self.maximise else 1.0
            values = [sign * self.value(("O", 0), point)]
            values += [self.value(("C", row), point) for row in range(self.rows)]
            for key, (value, other) in enumerate(zip(values, [objective, *rows], strict=True)):
                undefined = not math.isfinite(value)
                if not undefined and abs(value - other) > 1e-9 * (1 + abs(value)):
                    return f"value of {'the objective' if not key else f'row {key - 1}'}"
        return ""
