"""Campaigns: many instances, backends and seeds from one file, their records, and what they amount to."""

from ...lazy import attach

__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "campaign": ("Campaign", "Set"),
        "records": ("Records", "read_records"),
        "running": ("Progress", "bench"),
    },
)
