"""Strict check of NL files before a library reads them."""

from __future__ import annotations

from pathlib import Path


def check_nl(path: Path, raw: bytes) -> None:
    """Placeholder."""
