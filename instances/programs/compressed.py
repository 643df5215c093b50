"""Bounded reading of files that may be compressed with gzip."""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import Path

from ...errors import InvalidData
from ...files import LARGEST_FILE, read_bytes

__all__ = ["read_raw"]


def read_raw(path: Path) -> bytes:
    """Return the content of a file, decompressed if its name ends in ``.gz``.

    Raise ``InvalidData`` if the file cannot be read, is damaged, or has more than
    :data:`~crosstrack.files.LARGEST_FILE` bytes before or after decompression.
    """
    raw = read_bytes(path)
    if path.suffix.casefold() == ".gz" and len(raw) <= LARGEST_FILE:
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(raw)) as stream:
                raw = stream.read(LARGEST_FILE + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise InvalidData(f"{path}: not a file compressed with gzip: {error}") from None
    if len(raw) > LARGEST_FILE:
        raise InvalidData(f"{path}: more than {LARGEST_FILE} bytes")
    return raw
