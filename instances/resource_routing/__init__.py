"""Instances of routes with resources: electric vehicles among stations, networks of streets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .generator import (
        generate_electric as generate_electric,
        generate_network as generate_network,
    )
    from .readers import read_rcsp as read_rcsp
    from .spprclib import read_spprclib as read_spprclib

CATALOGUE = {"resource-routing": ".listing:catalogue_entries"}
DEMOS = {"resource-routing": "resource-routing/network-20"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
