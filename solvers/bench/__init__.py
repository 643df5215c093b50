"""Benchmark campaigns: instances, backends and seeds from a file, their records and statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .campaign import Campaign as Campaign, Set as Set
    from .page import write_page as write_page
    from .profiles import data_profile as data_profile, performance_profile as performance_profile
    from .records import Records as Records, read_records as read_records
    from .running import Progress as Progress, bench as bench
    from .statistics import (
        compare_pairs as compare_pairs,
        compare_seeds as compare_seeds,
        primal_integral as primal_integral,
        shifted_geometric_mean as shifted_geometric_mean,
        success_interval as success_interval,
    )

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
