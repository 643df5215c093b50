"""Files in the Conic Benchmark Format."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation, show, suggestion
from ...models.programs.base import RowProgram
from ...models.programs.blocks import Block
from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import MixedIntegerProgram
from .lines import Lines

__all__ = ["read_cbf"]

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bounds of entries in linear cones.
_LINEAR = {
    "F": (-np.inf, np.inf), "L+": (0.0, np.inf), "L-": (-np.inf, 0.0), "L=": (0.0, 0.0)
}  # fmt: skip
#: Kinds of other cones with their smallest dimension.
_CONES = {
    "Q": (ConeKind.SECOND_ORDER, 1), "QR": (ConeKind.SECOND_ORDER, 2),
    "EXP": (ConeKind.EXPONENTIAL, 3), "PSD": (ConeKind.SEMIDEFINITE, 1),
}  # fmt: skip
#: Cones of the sections VAR and CON.
_NAMES = (*_LINEAR, "Q", "QR", "EXP")
#: Parts of the format that no program can express, with the way around.
_UNSUPPORTED = {
    "EXP*": "pose dual exponential cones with cones EXP",
    **dict.fromkeys(
        ("POW", "POW*", "POWCONES", "POW*CONES", "GMEANABS", "GMEANABS*"),
        "pose powers and geometric means with cones EXP or Q",
    ),
    "SVECPSD": "pose semidefinite constraints with PSDCON",
    "CHANGE": "write each program to a separate file",
    "OBJQUAD": "pose a quadratic objective with a cone QR",
}
_STRUCTURE = ("OBJSENSE", "PSDVAR", "VAR", "INT", "PSDCON", "CON")
#: Sections of coefficients with the sections that declare their row and column; empty for the objective
#: and for constants. A row and column within a matrix follow these two indices.
_COEFFICIENTS = {
    "OBJFCOORD": ("", "PSDVAR"), "OBJACOORD": ("", "VAR"), "OBJBCOORD": ("", ""),
    "FCOORD": ("CON", "PSDVAR"), "ACOORD": ("CON", "VAR"), "BCOORD": ("CON", ""),
    "HCOORD": ("PSDCON", "VAR"), "DCOORD": ("PSDCON", ""),
}  # fmt: skip
_SECTIONS = ("VER", *_STRUCTURE, *_COEFFICIENTS)
#: Largest number of entries of all matrix variables, or of all matrix constraints; longer files may have
#: one per character.
_MOST_SEMIDEFINITE = 2_500_000


def read_cbf(path: Path) -> RowProgram:
    """Return the program in a file in the Conic Benchmark Format, version 1 to 4 (Friberg 2016).

    The columns are the scalar variables, then the lower triangles of the matrix variables row by row. The cones
    are those of the scalar variables, the matrix variables, the scalar constraints and the matrix constraints;
    with linear ones alone, the program is linear. Comments start with ``#``. Raise ``InvalidData`` with the line
    if the file is damaged or has an unknown section, and ``UnsupportedFormulation`` for power cones, dual
    exponential cones, geometric means, changes, or integers together with cones.
    """
    return _File(Lines(path, "#")).program()


class _File:
    """Content of a file by section."""

    def __init__(self, lines: Lines) -> None:
        self.lines = lines
        self.maximise = False
        self.integers: list[int] = []
        #: Kinds and dimensions of cones, or orders of matrices.
        self.cones: dict[str, list[tuple[str, int]]] = {
            section: [] for section in ("VAR", "PSDVAR", "CON", "PSDCON")
        }
        #: Numbers of columns or rows.
        self.sizes = dict.fromkeys(self.cones, 0)
        #: Rows, columns and values of all coefficients.
        self.triplets: list[tuple[Indices, Indices, Vector]] = []
        #: Blocks of cones, and their matrices and constants.
        self.blocks: list[ConeBlock] = []
        self.bodies: list[tuple[sp.csr_array, Vector]] = []
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
            raise self._unsupported(keyword, _UNSUPPORTED[keyword])
        if keyword not in _SECTIONS:
            raise self.lines.error(
                f"unknown section {show(keyword)}: {suggestion(keyword, _SECTIONS)}"
                f"allowed: {', '.join(_SECTIONS)}"
            )
        if keyword in known:
            raise self.lines.error(f"section {keyword} must occur once")
        if (keyword == "VER") == bool(known):
            raise self.lines.error(f"VER must be the first section, got {keyword}")
        if keyword in _STRUCTURE and any(section in _COEFFICIENTS for section in known):
            raise self.lines.error(f"section {keyword} must precede all coefficients")

    def _unsupported(self, name: str, advice: str) -> UnsupportedFormulation:
        return UnsupportedFormulation(
            f"{self.lines.place()}: {name} has no equivalent here: {advice}"
        )

    def _read(self, keyword: str) -> None:
        """Read the lines of a section."""
        lines = self.lines
        if keyword == "VER":
            lines.integer("version", 1, 4)
        elif keyword == "OBJSENSE":
            (sense,) = lines.fields("OBJSENSE", 1)
            if sense not in ("MIN", "MAX"):
                raise lines.error(f"OBJSENSE must be MIN or MAX, got {show(sense)}")
            self.maximise = sense == "MAX"
        elif keyword == "INT":
            for _ in range(lines.count("integers")):
                self.integers.append(lines.integer("integer", 0, self.sizes["VAR"] - 1))
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
                raise self._unsupported(kind, _UNSUPPORTED[kind])
            if kind not in _NAMES:
                raise lines.error(f"cone must be one of {', '.join(_NAMES)}, got {show(kind)}")
            low, high = _CONES[kind][1] if kind in _CONES else 0, 3 if kind == "EXP" else size
            dimension = lines.whole(f"dimension of {kind}", text, low, high)
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
            order = lines.integer(f"order of {section}", 1, lines.most)
            self.sizes[section] += order * (order + 1) // 2
            if self.sizes[section] > most:
                raise lines.error(f"matrices of {section} must have at most {most} entries")
            self.cones[section].append(("PSD", order))

    @np.errstate(over="ignore")  # infinite coefficients are refused by the program
    def _read_coefficients(self, section: str) -> None:
        """Read coefficients; those of the objective are in the last row, constants in the last column."""
        lines, sizes = self.lines, self.sizes
        if section == "OBJBCOORD":
            values, places = np.array([lines.number(section)]), np.zeros((1, 0), np.int64)
        owners = [owner for owner in _COEFFICIENTS[section] if owner]
        matrix = next((owner for owner in owners if owner.startswith("PSD")), "")
        if owners:
            shape = [len(self.cones[o]) if o == matrix else sizes[o] for o in owners]
            orders = np.array([order for _, order in self.cones.get(matrix, [])], np.int64)
            if matrix:
                shape += [int(orders.max(initial=0))] * 2
            entries = lines.entries(section, tuple(shape), symmetric=bool(matrix))
            values, places = entries.values, entries.index
        if matrix:
            k = owners.index(matrix)
            number, (row, column) = places[:, k].copy(), places[:, -2:].T
            outside = np.flatnonzero(row >= orders[number])
            if outside.size:
                first = int(outside[0])
                raise lines.error(
                    f"{section}: the order of {matrix} {number[first]} is {orders[number[first]]}, got row or "
                    f"column {row[first]}",
                    int(entries.lines[first]),
                )
            extents = orders * (orders + 1) // 2
            # The scalars precede the matrices.
            starts = sizes[matrix.removeprefix("PSD")] + np.cumsum(extents) - extents
            places[:, k] = starts[number] + row * (row + 1) // 2 + column
            if matrix == "PSDVAR":
                # The inner product of symmetric matrices contains off-diagonal entries twice.
                values = values * np.where(row == column, 1.0, 2.0)
        last = [np.full(values.size, extent) for extent in self._shape()]
        remaining = iter(places.T)
        row, column = (
            next(remaining) if owner else end
            for owner, end in zip(_COEFFICIENTS[section], last, strict=True)
        )
        self.triplets.append((row, column, values))

    def _shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns."""
        sizes = self.sizes
        return sizes["CON"] + sizes["PSDCON"], sizes["VAR"] + sizes["PSDVAR"]

    def program(self) -> RowProgram:
        """Return the program."""
        rows, size = self._shape()
        row, column, value = (
            np.concatenate(part) for part in zip(*self.triplets, ([], [], []), strict=True)
        )
        place = row.astype(np.int64), column.astype(np.int64)
        whole = sp.csr_array(sp.coo_array((value, place), shape=(rows + 1, size + 1)))
        matrix, constants = whole[:, :size], whole[:, [size]].toarray().ravel()
        identity = sp.csr_array(sp.eye_array(size))
        column_low, column_high, _ = self._split("VAR", identity, np.zeros(size))
        row_low, row_high, linear = self._split("CON", matrix[:rows], constants[:rows])
        sign = -1.0 if self.maximise else 1.0
        shared: dict[str, Any] = {
            "cost": sign * matrix[[rows]].toarray().ravel(), "offset": sign * float(constants[rows]),
            "matrix": matrix[:rows][linear], "row_lower": row_low[linear], "row_upper": row_high[linear],
            "column_lower": column_low, "column_upper": column_high, "columns": self._columns(),
            "rows": _block("CON", "CON {0}", np.flatnonzero(linear)[:, None], 0),
            "maximise": self.maximise,
        }  # fmt: skip
        if not self.blocks:
            integral = np.isin(np.arange(size), self.integers)
            return MixedIntegerProgram(**shared, integral=integral)
        if self.integers:
            raise self._unsupported(
                "INT together with cones", "remove INT, or pose the cones as linear constraints"
            )
        return ConicProgram(
            **shared,
            cone_matrix=sp.csr_array(sp.vstack([body for body, _ in self.bodies])),
            cone_offset=np.concatenate([constant for _, constant in self.bodies]),
            cones=tuple(self.blocks),
        )

    def _split(
        self, section: str, matrix: sp.csr_array, offset: Vector
    ) -> tuple[Vector, Vector, NDArray[np.bool_]]:
        """Add the cones of ``matrix @ x + offset``; return the bounds and the rows of linear cones."""
        low, high = np.full(offset.size, -np.inf), np.full(offset.size, np.inf)
        linear = np.zeros(offset.size, bool)
        base = self.blocks[-1].slice.stop if self.blocks else 0
        start, stop = base, 0
        changes: list[tuple[Any, Any, Any]] = [([], [], [])]
        for name in (section, f"PSD{section}"):
            first = 0
            for (kind, dimension), group in groupby(self.cones[name]):
                count = len(list(group))
                size = dimension * (dimension + 1) // 2 if kind == "PSD" else dimension
                part = slice(stop, stop + size * count)
                if kind in _LINEAR:
                    low[part], high[part] = (bound - offset[part] for bound in _LINEAR[kind])
                    linear[part] = True
                else:
                    self.blocks.append(
                        ConeBlock(
                            f"{name} {first}", "", start, size * count, f"{name} {{0}}",
                            np.arange(first, first + count)[:, None],
                            kind=_CONES[kind][0], dimension=size,
                        )
                    )  # fmt: skip
                    row, column, value = _change(kind, dimension)
                    shift = size * np.arange(count)[:, None]
                    rows, columns = row + shift + start - base, column + shift + stop
                    changes.append((rows.ravel(), columns.ravel(), np.tile(value, count)))
                    start += size * count
                stop, first = part.stop, first + count
        rows, columns, values = (np.concatenate(part) for part in zip(*changes, strict=True))
        place = rows.astype(np.int64), columns.astype(np.int64)
        change = sp.csr_array(sp.coo_array((values, place), shape=(start - base, offset.size)))
        self.bodies.append((change @ matrix, change @ offset))
        return low, high, linear

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


def _change(kind: str, dimension: int) -> tuple[Indices, Indices, Vector]:
    """Return the entries of the matrix that turns a vector in a cone of the format into one here."""
    if kind == "PSD":
        row, column = np.tril_indices(dimension)
        place = np.arange(row.size)
        return place, place, np.where(row == column, 1.0, np.sqrt(2.0))
    place, ones = np.arange(dimension), np.ones(dimension)
    if kind == "EXP":  # (t, s, r) with t >= s exp(r / s)
        return place, place[::-1], ones
    if kind == "QR":  # 2 x y >= |z|^2: (x + y) / sqrt(2) >= |((x - y) / sqrt(2), z)|
        row, column = np.append([0, 0, 1, 1], place[2:]), np.append([0, 1, 0, 1], place[2:])
        return row, column, np.append(np.sqrt(0.5) * np.array([1.0, 1.0, 1.0, -1.0]), ones[2:])
    return place, place, ones
