"""Campaigns of many instances and backends: what they found, compared fairly and shown."""

from __future__ import annotations

from ...lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, {"page": ("write_page",)})
