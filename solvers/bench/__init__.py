"""Benchmark campaigns: instances, backends and seeds from a file, their records and statistics."""

from __future__ import annotations

from ...lazy import attach

__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "campaign": ("Campaign", "Set"),
        "page": ("write_page",),
        "profiles": ("data_profile", "performance_profile"),
        "records": ("Records", "read_records"),
        "running": ("Progress", "bench"),
        "statistics": (
            "compare_pairs",
            "compare_seeds",
            "primal_integral",
            "shifted_geometric_mean",
            "success_interval",
        ),
    },
)
