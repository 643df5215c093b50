"""Uniform meshes of another scheme, solved if refinement does not lead to a settled plan."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .base import Transcription

__all__ = ["uniform_meshes"]

#: Numbers of intervals, in the order of the stages, and seeds of their starts; 0 is the guess. A drawn
#: start is second, because a symmetric guess is infeasible on every mesh.
UNIFORM = ((20, 0), (20, 1), (60, 0), (40, 2), (120, 0))
#: Number of nodes per interval.
DEGREE = 3


def uniform_meshes(first: Transcription) -> Iterator[tuple[str, Transcription]]:
    """Yield labels and transcriptions by the scheme that confirms `first`, started like `first`.

    Low degrees on many intervals converge on problems on which a few high polynomials oscillate. Without
    refinement, or a confirming scheme of variable degree, nothing is yielded.
    """
    scheme = first.confirmed_by
    if scheme is None or scheme.rules.fixed_degree is not None or not first.refine:
        return
    for intervals, seed in UNIFORM:
        other = scheme(first.model, intervals, DEGREE, dependent=first.dependent)
        other = other.like(first)
        label = f"{other.name} {intervals}x{DEGREE}"
        yield (f"{label}, seed {seed}", other.started(seed)) if seed else (label, other)
