"""Table of the published problems; the modules of this package add to it."""

from __future__ import annotations

from declared_problem import Table

__all__ = ["PUBLISHED"]

PUBLISHED = Table()
