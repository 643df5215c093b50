"""Table of the published problems; the modules of this package add to it."""

from __future__ import annotations

from declared_problem import Table

__all__ = ["FINE", "PUBLISHED"]

PUBLISHED = Table()

#: Origin of a value if the printed one depends on a coarse mesh.
FINE = "value: Radau and Gauss collocation on 300 intervals agree"
