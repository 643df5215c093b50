"""Rows and cones of gates at given times."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...programs.blocks import Block
from ...programs.cones import ConeBlock, ConeKind
from ..bounds import PathData
from .piecewise import PiecewiseFormulation

__all__ = ["GateRows", "gate_rows"]

Floats = NDArray[np.float64]


class GateRows(NamedTuple):
    """Rows ``lower <= matrix x <= upper`` and cones ``cone_matrix x + cone_offset`` of all gates."""

    matrix: sp.csr_array
    lower: Floats
    upper: Floats
    rows: tuple[Block, ...]
    cone_matrix: sp.csr_array
    cone_offset: Floats
    cones: tuple[ConeBlock, ...]


def gate_rows(model: PathData, base: PiecewiseFormulation, start: int) -> GateRows:
    """Return the rows and cones of the gates of `model` on the coefficients of `base`.

    Planes and polygons are rows, and discs and balls are second-order cones. `start` is the number of
    rows of `base`.
    """
    parts, lower, upper, rows = [], [], [], []
    cone_parts, offsets, cones = [], [], []
    at, cone_at = start, 0
    for gate in model.gates:
        first = min(gate.knot, model.segments - 1)
        segment = np.full(model.dimensions, first)
        axes = np.arange(model.dimensions)
        basis = base.basis_rows(segment, np.full(axes.size, float(gate.knot - first)), 0)
        position = base._sparse((base.columns(segment, axes), basis))
        frame = gate.frame
        flat = frame.axes @ frame.centre
        blocks = [
            ("plane", frame.normals, frame.normals @ frame.centre, frame.normals @ frame.centre)
        ]
        if gate.radius is None:
            normals, edges = gate.edges
            blocks.append(
                (
                    "polygon",
                    normals @ frame.axes,
                    np.full(edges.size, -np.inf),
                    edges + normals @ flat,
                )
            )
        else:
            size = len(frame.axes) + 1
            side = sp.csr_array(np.concatenate([np.zeros((1, model.dimensions)), frame.axes]))
            cone_parts.append(side @ position)
            offsets.append(np.append(gate.radius, -flat))
            name = f"disc of gate {gate.knot}"
            cones.append(
                ConeBlock(name, "", cone_at, size, kind=ConeKind.SECOND_ORDER, dimension=size)
            )
            cone_at += size
        for name, normals, low, high in blocks:
            if len(normals):
                parts.append(sp.csr_array(normals) @ position)
                lower.append(low)
                upper.append(high)
                rows.append(Block(f"{name} of gate {gate.knot}", "", at, len(normals)))
                at += len(normals)
    none = sp.csr_array((0, model.segments * model.dimensions * (model.degree + 1)))
    return GateRows(
        sp.csr_array(sp.vstack([none, *parts])), np.concatenate([[], *lower]),
        np.concatenate([[], *upper]), tuple(rows), sp.csr_array(sp.vstack([none, *cone_parts])),
        np.concatenate([[], *offsets]), tuple(cones),
    )  # fmt: skip
