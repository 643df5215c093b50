"""Programs from objects of other libraries and from arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ....lazy import attach

if TYPE_CHECKING:
    from .conversion import program_of as program_of
    from .link import Source as Source

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
