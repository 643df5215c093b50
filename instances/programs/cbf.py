"""Files in the Conic Benchmark Format."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation, show, suggestion
from ...models.programs.base import RowProgram
from ...models.programs.blocks import Block
from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import MixedIntegerProgram
from .lines import Entries, Lines

__all__ = ["read_cbf"]

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Section, kind, first number and count of equal cones, their matrix and constants.
Part = tuple[str, str, tuple[int, int], sp.csr_array, Vector]

#: Bounds of entries in linear cones.
_LINEAR = {
    "F": (-np.inf, np.inf), "L+": (0.0, np.inf), "L-": (-np.inf, 0.0), "L=": (0.0, 0.0)
}  # fmt: skip
#: Kinds of other cones.
_CONES = {
    "Q": ConeKind.SECOND_ORDER, "QR": ConeKind.SECOND_ORDER, "EXP": ConeKind.EXPONENTIAL,
    "PSD": ConeKind.SEMIDEFINITE,
}  # fmt: skip
#: Smallest dimensions of cones.
_SMALLEST = {"Q": 1, "QR": 2, "EXP": 3}
#: Parts of the format that no program can express, with the way around.
_UNSUPPORTED = {
    "EXP*": "pose dual exponential cones with the primal cone EXP",
    "POW": "pose power cones with cones EXP or Q",
    "POW*": "pose power cones with cones EXP or Q",
    "POWCONES": "pose power cones with cones EXP or Q",
    "POW*CONES": "pose power cones with cones EXP or Q",
    "GMEANABS": "pose geometric means with cones EXP or Q",
    "GMEANABS*": "pose geometric means with cones EXP or Q",
    "SVECPSD": "pose semidefinite constraints with PSDCON",
    "CHANGE": "write each program to a separate file",
    "OBJQUAD": "pose a quadratic objective with a cone QR",
}
#: Sections of structure, and of coefficients with the sections that declare the indices of an entry.
#: Indices of matrices are followed by a row and a column.
_STRUCTURE = ("OBJSENSE", "PSDVAR", "VAR", "INT", "PSDCON", "CON")
_COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "OBJFCOORD": ("PSDVAR",), "OBJACOORD": ("VAR",), "FCOORD": ("CON", "PSDVAR"), "ACOORD": ("CON", "VAR"),
    "BCOORD": ("CON",), "HCOORD": ("PSDCON", "VAR"), "DCOORD": ("PSDCON",),
}  # fmt: skip
_SECTIONS = ("VER", *_STRUCTURE, "OBJBCOORD", *_COEFFICIENTS)
#: Largest number of entries of all matrix variables, or constraints, whatever the length of the file.
_MOST_SEMIDEFINITE = 2_500_000


def read_cbf(path: Path) -> RowProgram:
    """Return the program in a file in the Conic Benchmark Format, version 1 to 4 (Friberg 2016).

    The columns are the scalar variables, then the lower triangles of the matrix variables row by row.
    The cone rows are those of the scalar variables, the matrix variables, the scalar constraints and
    the matrix constraints.

    Parameters
    ----------
    path : Path
        The file, which may be compressed. Comments start with ``#``.

    Returns
    -------
    MixedIntegerProgram or ConicProgram
        A conic program if the file has other cones than linear ones.

    Raises
    ------
    InvalidData
        The file is damaged, or has an unknown section; the message names the line.
    UnsupportedFormulation
        The file has power cones, dual exponential cones, geometric means, changes, or integers together
        with cones.
    """
    content = _File(Lines(path, "#"))
    try:
        return content.program()
    except InvalidData as error:
        raise InvalidData(f"{path}: {error}", field=error.field) from None


class _File:
    """Content of a file by section."""

    def __init__(self, lines: Lines) -> None:
        self.lines = lines
        self.maximise, self.offset = False, 0.0
        self.integers: list[int] = []
        #: Kinds and dimensions of cones; those of matrices are ("PSD", order).
        self.cones: dict[str, list[tuple[str, int]]] = {
            section: [] for section in ("VAR", "PSDVAR", "CON", "PSDCON")
        }
        #: Numbers of scalars in these sections, and numbers of columns and rows.
        self.sizes = dict.fromkeys(self.cones, 0)
        self.entries: dict[str, Entries] = {}
        known: list[str] = []
        while fields := lines.next():
            keyword = " ".join(fields)
            self._check(keyword, known)
            known.append(keyword)
            self._read(keyword)
        if "OBJSENSE" not in known:
            raise lines.error("the file ends without a section OBJSENSE")
        if not self.sizes["VAR"] + self.sizes["PSDVAR"]:
            raise lines.error("the file ends without variables")

    def _check(self, keyword: str, known: list[str]) -> None:
        """Raise if a section is not allowed after the sections `known`."""
        if keyword in _UNSUPPORTED:
            raise self._unsupported(keyword)
        if keyword not in _SECTIONS:
            raise self.lines.error(
                f"unknown section {show(keyword)}: {suggestion(keyword, _SECTIONS)}"
                f"allowed: {', '.join(_SECTIONS)}"
            )
        if keyword in known:
            raise self.lines.error(f"section {keyword} must occur once")
        if (keyword == "VER") == bool(known):
            raise self.lines.error(f"VER must be the first section, got {keyword}")
        if keyword in _STRUCTURE and any(item.endswith("COORD") for item in known):
            raise self.lines.error(f"section {keyword} must precede all coefficients")

    def _unsupported(self, name: str) -> UnsupportedFormulation:
        return UnsupportedFormulation(
            f"{self.lines.place()}: {name} has no equivalent here: {_UNSUPPORTED[name]}"
        )

    def _read(self, keyword: str) -> None:
        """Read the lines of a section."""
        lines = self.lines
        if keyword == "VER":
            lines.whole("version", *lines.fields("version", 1), 1, 4)
        elif keyword == "OBJSENSE":
            (sense,) = lines.fields("OBJSENSE", 1)
            if sense not in ("MIN", "MAX"):
                raise lines.error(f"OBJSENSE must be MIN or MAX, got {show(sense)}")
            self.maximise = sense == "MAX"
        elif keyword == "OBJBCOORD":
            self.offset = lines.number_of("constant of the objective")
        elif keyword == "INT":
            for _ in range(lines.count("integers")):
                (text,) = lines.fields("integer", 1)
                self.integers.append(lines.whole("integer", text, 0, self.sizes["VAR"] - 1))
            if len(set(self.integers)) < len(self.integers):
                raise lines.error("INT must name each variable once")
        elif keyword in ("VAR", "CON"):
            self._read_cones(keyword)
        elif keyword in ("PSDVAR", "PSDCON"):
            self._read_orders(keyword)
        else:
            self._read_coefficients(keyword)

    def _read_cones(self, section: str) -> None:
        """Read the cones of scalar variables or constraints."""
        lines = self.lines
        total, count = lines.fields(f"sizes of {section}", 2)
        size = lines.whole(f"number of {section} entries", total, 0, lines.most)
        for _ in range(lines.whole(f"number of {section} cones", count, 0, lines.most)):
            kind, text = lines.fields(f"cone of {section}", 2)
            kind = kind.rpartition(":")[2] if kind.startswith("@") else kind
            if kind in _UNSUPPORTED:
                raise self._unsupported(kind)
            if kind not in _LINEAR and kind not in _SMALLEST:
                raise lines.error(
                    f"cone must be one of {', '.join((*_LINEAR, *_SMALLEST))}, got {show(kind)}"
                )
            most = 3 if kind == "EXP" else size
            dimension = lines.whole(f"dimension of {kind}", text, _SMALLEST.get(kind, 0), most)
            self.sizes[section] += dimension
            self.cones[section].append((kind, dimension))
        if self.sizes[section] != size:
            raise lines.error(
                f"the cones of {section} must have {size} entries, got {self.sizes[section]}"
            )

    def _read_orders(self, section: str) -> None:
        """Read the orders of matrix variables or constraints."""
        lines = self.lines
        most = max(_MOST_SEMIDEFINITE, lines.most)
        for _ in range(lines.count(section)):
            order = lines.whole("order", *lines.fields(f"order of {section}", 1), 1, lines.most)
            self.sizes[section] += order * (order + 1) // 2
            if self.sizes[section] > most:
                raise lines.error(f"matrices of {section} must have at most {most} entries")
            self.cones[section].append(("PSD", order))

    def _read_coefficients(self, section: str) -> None:
        lines, owners = self.lines, _COEFFICIENTS[section]
        shape = [
            len(self.cones[owner]) if owner.startswith("PSD") else self.sizes[owner]
            for owner in owners
        ]
        matrix = next((owner for owner in owners if owner.startswith("PSD")), "")
        orders = np.array([order for _, order in self.cones.get(matrix, [])], np.int64)
        shape += [int(orders.max(initial=0))] * (2 if matrix else 0)
        entries = lines.entries(section, tuple(shape), symmetric=bool(matrix))
        if matrix:
            number = entries.index[:, owners.index(matrix)]
            outside = np.flatnonzero(entries.index[:, -2] >= orders[number])
            if outside.size:
                k = int(outside[0])
                raise lines.error(
                    f"{section}: {matrix} {number[k]} has order {orders[number[k]]}, got the row or column "
                    f"{entries.index[k, -2]}",
                    int(entries.lines[k]),
                )
        self.entries[section] = entries

    def _terms(self, section: str) -> tuple[list[Indices], Vector]:
        """Return the places of the entries of a section among the rows or columns, and their values."""
        owners = _COEFFICIENTS[section]
        if section not in self.entries:
            return [np.empty(0, np.int64)] * len(owners), np.empty(0)
        index, values = self.entries[section].index, self.entries[section].values
        places = []
        for k, owner in enumerate(owners):
            place = index[:, k]
            if owner.startswith("PSD"):
                row, column = index[:, -2:].T
                orders = np.array([order for _, order in self.cones[owner]], np.int64)
                starts = np.cumsum(orders * (orders + 1) // 2) - orders * (orders + 1) // 2
                place = starts[place] + row * (row + 1) // 2 + column
                # Scalars precede matrices.
                place += self.sizes[owner.removeprefix("PSD")]
            if owner == "PSDVAR":
                # The inner product of symmetric matrices contains off-diagonal entries twice.
                values = values * np.where(row == column, 1.0, 2.0)
            places.append(place)
        return places, values

    def _joined(self, *sections: str) -> tuple[tuple[Indices, ...], Vector]:
        """Return the places and values of sections with the same meaning."""
        places, values = zip(*(self._terms(section) for section in sections), strict=True)
        joined = tuple(np.concatenate(part) for part in zip(*places, strict=True))
        return joined, np.concatenate(values)

    def program(self) -> RowProgram:
        """Return the program."""
        size, rows = (self.sizes[name] + self.sizes[f"PSD{name}"] for name in ("VAR", "CON"))
        cost, offset = np.zeros(size), np.zeros(rows)
        for vector, sections in (
            (cost, ("OBJACOORD", "OBJFCOORD")),
            (offset, ("BCOORD", "DCOORD")),
        ):
            (place,), values = self._joined(*sections)
            vector[place] = values
        place, values = self._joined("ACOORD", "FCOORD", "HCOORD")
        matrix = sp.csr_array(sp.coo_array((values, place), shape=(rows, size)))
        identity = sp.eye_array(size, format="csr")
        column_low, column_high, _, columns = self._divided("VAR", identity, np.zeros(size))
        row_low, row_high, linear, constraints = self._divided("CON", matrix, offset)
        sign = -1.0 if self.maximise else 1.0
        shared: dict[str, Any] = {
            "cost": sign * cost, "offset": sign * self.offset, "maximise": self.maximise,
            "matrix": matrix[linear], "row_lower": row_low[linear], "row_upper": row_high[linear],
            "column_lower": column_low, "column_upper": column_high, "columns": self._columns(),
            "rows": _block("CON", "CON {0}", np.flatnonzero(linear)[:, None], 0),
        }  # fmt: skip
        parts = columns + constraints
        if not parts:
            integral = np.zeros(size, bool)
            integral[self.integers] = True
            return MixedIntegerProgram(**shared, integral=integral)
        if self.integers:
            raise UnsupportedFormulation(
                f"{self.lines.place()}: INT together with cones has no equivalent here: remove INT, or pose "
                "the cones as linear constraints"
            )
        start, cones = 0, []
        for name, kind, (first, count), body, _ in parts:
            cones.append(
                ConeBlock(
                    f"{name} {first}", "", start, body.shape[0], f"{name} {{0}}",
                    np.arange(first, first + count)[:, None],
                    kind=_CONES[kind], dimension=body.shape[0] // count,
                )
            )  # fmt: skip
            start += body.shape[0]
        return ConicProgram(
            **shared,
            cone_matrix=sp.csr_array(sp.vstack([part[3] for part in parts])),
            cone_offset=np.concatenate([part[4] for part in parts]),
            cones=tuple(cones),
        )

    def _divided(
        self, scalars: str, matrix: sp.csr_array, offset: Vector
    ) -> tuple[Vector, Vector, NDArray[np.bool_], list[Part]]:
        """Return bounds, which rows are in linear cones, and the cones of ``matrix @ x + offset``."""
        low, high = np.full(offset.size, -np.inf), np.full(offset.size, np.inf)
        linear = np.zeros(offset.size, bool)
        parts: list[Part] = []
        start = 0
        for section in (scalars, f"PSD{scalars}"):
            first = 0
            for (kind, dimension), group in groupby(self.cones[section]):
                count = len(list(group))
                size = dimension * (dimension + 1) // 2 if kind == "PSD" else dimension
                part = slice(start, start + size * count)
                if kind in _LINEAR:
                    low[part], high[part] = (bound - offset[part] for bound in _LINEAR[kind])
                    linear[part] = True
                else:
                    change = sp.kron(sp.eye_array(count), _change(kind, dimension), format="csr")
                    parts.append(
                        (
                            section,
                            kind,
                            (first, count),
                            change @ matrix[part],
                            change @ offset[part],
                        )
                    )
                start, first = part.stop, first + count
        return low, high, linear, parts

    def _columns(self) -> tuple[Block, ...]:
        """Return the blocks of columns: scalars and entries of matrices."""
        scalars = np.arange(self.sizes["VAR"])[:, None]
        matrices = [
            np.column_stack([np.full(order * (order + 1) // 2, k), *np.tril_indices(order)])
            for k, (_, order) in enumerate(self.cones["PSDVAR"])
        ]
        index = np.concatenate([np.empty((0, 3), np.int64), *matrices])
        return _block("VAR", "VAR {0}", scalars, 0) + _block(
            "PSDVAR", "PSDVAR {0}[{1}, {2}]", index, scalars.size
        )


def _block(name: str, template: str, index: Indices, start: int) -> tuple[Block, ...]:
    """Return a block, or none without entries."""
    return (Block(name, "", start, len(index), template, index),) if len(index) else ()


def _change(kind: str, dimension: int) -> sp.csr_array:
    """Return the matrix that turns a vector in a cone of the format into one in the cone here."""
    if kind == "PSD":
        row, column = np.tril_indices(dimension)
        return sp.diags_array(np.where(row == column, 1.0, np.sqrt(2.0)), format="csr")
    if kind == "EXP":  # (t, s, r) with t >= s exp(r / s)
        return sp.csr_array(np.eye(3)[::-1])
    change = sp.eye_array(dimension, format="lil")
    if kind == "QR":  # 2 x y >= |z|^2: (x + y) / sqrt(2) >= |((x - y) / sqrt(2), z)|
        change[:2, :2] = np.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0]])
    return sp.csr_array(change)
