"""Campaigns: many instances, backends and seeds from one file, their records, and what they amount to."""

from ...lazy import attach

__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "campaign": ("Campaign", "Set"),
        "records": ("Records", "read_records"),
        "profiles": ("data_profile", "performance_profile"),
        "running": ("Progress", "bench"),
        "statistics": (
            "compare_backends",
            "compare_pairs",
            "compare_seeds",
            "primal_integral",
            "shifted_geometric_mean",
            "success_interval",
        ),
    },
)
