"""Strict check of MPS files before a library reads them."""

from __future__ import annotations

from pathlib import Path


def check_mps(path: Path, raw: bytes) -> None:
    """Placeholder."""
