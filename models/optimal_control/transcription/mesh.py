"""Meshes: the intervals of a phase, and their numbers of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....errors import UnsupportedOption
from ...fields import frozen, show
from ..plan import PhasePlan

__all__ = ["DEGREE", "LINEAR", "UNIFORM", "Mesh", "even"]

Floats = NDArray[np.float64]

#: Uniform meshes that are tried if refinement does not settle: numbers of intervals in the order of the
#: stages, and seeds of their starts; 0 is the guess. A drawn start is second, because a symmetric guess is
#: infeasible on every mesh.
UNIFORM = ((20, 0), (20, 1), (60, 0), (40, 2), (120, 0))
#: Their number of nodes per interval. Low degrees on many intervals converge on problems on which a few high
#: polynomials oscillate.
DEGREE = 3
#: Intervals and nodes per interval of the mesh with linear controls per interval. Their motion is smooth, so
#: plans often verify although optimal controls chatter, are singular or are not unique.
LINEAR = 40, 5


@dataclass(frozen=True, eq=False)
class Mesh:
    """Intervals of one phase.

    `fractions` are their ends, from 0 to 1, and `degrees` the numbers of collocation nodes. Controls of `calm`
    intervals, by default none, are polynomials of half the degree, or lines if `linear`. This prevents
    chattering on a singular arc.
    """

    fractions: Floats
    degrees: NDArray[np.int64]
    calm: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((), bool))
    linear: bool = False

    def __post_init__(self) -> None:
        fractions = np.asarray(self.fractions, float)
        degrees = np.asarray(self.degrees, np.int64)
        ends = fractions.ndim == 1 and fractions.size >= 2 and fractions[0] == 0.0
        if not ends or fractions[-1] != 1.0 or not (np.diff(fractions) > 0).all():
            raise UnsupportedOption(
                f"a mesh must increase from 0 to 1, got {show(np.asarray(self.fractions).tolist())}"
            )
        if degrees.shape != (fractions.size - 1,) or (degrees < 1).any():
            raise UnsupportedOption(
                f"a mesh of {fractions.size - 1} intervals needs as many degrees >= 1, "
                f"got {show(degrees.tolist())}"
            )
        calm = np.broadcast_to(np.asarray(self.calm, bool), degrees.shape)
        for name, array in (("fractions", fractions), ("degrees", degrees), ("calm", calm)):
            object.__setattr__(self, name, frozen(array))

    @property
    def intervals(self) -> int:
        """Number of intervals."""
        return int(self.degrees.size)

    @property
    def nodes(self) -> int:
        """Number of collocation nodes."""
        return int(self.degrees.sum())

    def same(self, other: Mesh) -> bool:
        """Return whether both meshes are equal."""
        return self.intervals == other.intervals and bool(self.unchanged(other).all())

    def unchanged(self, other: Mesh) -> NDArray[np.bool_]:
        """Return which intervals also belong to another mesh."""

        def rows(mesh: Mesh) -> list[tuple[float, ...]]:
            columns = mesh.fractions[:-1], mesh.fractions[1:], mesh.degrees, mesh.calm
            return list(zip(*(column.tolist() for column in columns), strict=True))

        other_rows = set(rows(other))
        return np.array([row in other_rows for row in rows(self)])

    def halved(self, chosen: NDArray[np.bool_], calm: NDArray[np.bool_] | None = None) -> Mesh:
        """Return the mesh with the chosen intervals bisected.

        Bisected intervals are not calm, unless `calm` states for all intervals which are.
        """
        middle = 0.5 * (self.fractions[1:] + self.fractions[:-1])
        parts = np.where(chosen, 2, 1)
        quiet = self.calm & ~chosen if calm is None else calm
        fractions = np.sort(np.concatenate([self.fractions, middle[chosen]]))
        degrees, quiet = np.repeat(self.degrees, parts), np.repeat(quiet, parts)
        return Mesh(fractions, degrees, quiet, self.linear)

    @property
    def calm_rows(self) -> NDArray[np.int64]:
        """Number of Legendre coefficients of a control that vanish, per interval."""
        least = 1 if self.linear else self.degrees // 2
        return np.where(self.calm, self.degrees - 1 - least, 0)


def even(intervals: int, degree: int, knots: Sequence[float] = ()) -> Mesh:
    """Return a mesh of equal intervals with `degree` nodes each.

    With `knots`, the parts between them are divided evenly into intervals that are not longer.
    """
    edges = np.array([0.0, *knots, 1.0])
    parts = np.maximum(np.ceil(np.diff(edges) * intervals - 1e-9).astype(int), 1)
    spans = zip(edges[:-1].tolist(), edges[1:].tolist(), parts.tolist(), strict=True)
    pieces = [np.linspace(low, high, count + 1)[:-1] for low, high, count in spans]
    fractions = np.append(np.concatenate(pieces), 1.0)
    return Mesh(fractions, np.full(fractions.size - 1, degree))


def mesh_of(part: PhasePlan) -> Mesh:
    """Return the mesh of a plan of one phase."""
    knots = part.states.knots
    fractions = (knots - knots[0]) / (knots[-1] - knots[0])
    fractions[-1] = 1.0
    source = part.controls if part.controls.size else part.states
    return Mesh(fractions, np.array([nodes.size for nodes in source.nodes]))


def read_mesh(mesh: Any, degree: int) -> Mesh:
    """Return a mesh from the fractions given by the user, with `degree` nodes per interval."""
    if isinstance(mesh, Mesh):
        return mesh
    try:
        if not isinstance(mesh, Sequence | np.ndarray) or isinstance(mesh, str):
            raise TypeError
        fractions = np.asarray(mesh, float)
    except (TypeError, ValueError):
        raise UnsupportedOption(f"mesh must be fractions from 0 to 1, got {show(mesh)}") from None
    return Mesh(fractions, np.full(max(fractions.size - 1, 0), degree))


def read_meshes(meshes: Any, degree: int, phases: int) -> tuple[Mesh, ...]:
    """Return one mesh per phase from fractions for all phases, or from one list of them per phase."""
    nested = isinstance(meshes, list | tuple) and any(
        isinstance(item, Mesh) or np.ndim(item) == 1 for item in meshes
    )
    if not nested:
        return (read_mesh(meshes, degree),) * phases
    if len(meshes) != phases:
        raise UnsupportedOption(f"option 'mesh' has {len(meshes)} lists for {phases} phases")
    return tuple(read_mesh(item, degree) for item in meshes)
