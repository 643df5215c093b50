"""Bounded reading and atomic writing of files, with errors that name the file."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .errors import InvalidData, show

__all__ = [
    "LARGEST_FILE", "as_path", "decoded", "read_bytes", "read_input", "read_text", "writable", "write_bytes",
    "write_text",
]  # fmt: skip

#: Largest size of a file in bytes, and of all files together that an instance refers to.
LARGEST_FILE = 256 << 20


def as_path(path: Any) -> Path:
    """Return `path` as a :class:`~pathlib.Path`, or raise :class:`InvalidData`."""
    try:
        result = Path(path)
        os.fsencode(result)
        return result
    except (TypeError, UnicodeEncodeError):
        raise InvalidData(f"path must name a file, got {show(path)}", field="path") from None


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the UTF-8 text of a file or pipe without its byte-order mark.

    Line ends are not translated.

    Raises
    ------
    InvalidData
        The file cannot be read, has more than :data:`LARGEST_FILE` bytes or is not UTF-8.
    """
    return decoded(read_bytes(path), as_path(path))


def read_bytes(path: str | os.PathLike[str], most: int = LARGEST_FILE) -> bytes:
    """Return the content of a file or pipe, at most ``most + 1`` bytes.

    Parameters
    ----------
    path : str or path-like
        The file.
    most : int
        Size limit in bytes. A result of ``most + 1`` bytes means that the file exceeds it.

    Raises
    ------
    InvalidData
        The file does not exist or cannot be read.
    """
    file = as_path(path)
    try:
        with file.open("rb") as stream:
            return stream.read(most + 1)
    except FileNotFoundError:
        raise InvalidData(f"{file}: no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InvalidData(f"{file}: cannot be read: {reason}") from None


def read_input() -> str:
    """Return the UTF-8 text on standard input, at most :data:`LARGEST_FILE` bytes."""
    return decoded(sys.stdin.buffer.read(LARGEST_FILE + 1), "standard input")


def decoded(raw: bytes, file: str | Path) -> str:
    """Return `raw`, the content of `file`, as text.

    Raises
    ------
    InvalidData
        `raw` has more than :data:`LARGEST_FILE` bytes, is compressed, or is not UTF-8 (field
        ``encoding``); the message names the line.
    """
    if len(raw) > LARGEST_FILE:
        raise InvalidData(f"{file}: holds more than {LARGEST_FILE} bytes")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if raw[:2] == b"\x1f\x8b":
            raise InvalidData(
                f"{file}: compressed with gzip, but must be text: decompress it first, such as with gunzip"
            ) from None
        line = raw.count(b"\n", 0, error.start) + 1
        raise InvalidData(
            f"{file}, line {line}: byte 0x{raw[error.start]:02x} is no UTF-8: save it as UTF-8",
            field="encoding",
        ) from None


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write `text` as UTF-8 atomically: readers see either the old or the new content.

    Parameters
    ----------
    path : str or path-like
        The file; a link stays a link and its target is replaced.
    text : str
        The new content.

    Returns
    -------
    pathlib.Path
        `path`.

    Raises
    ------
    InvalidData
        `text` is not encodable as UTF-8, the file cannot be written, or `path` exists and is not a
        regular file.
    """
    if not isinstance(text, str):
        raise InvalidData(f"text must be a str, got {show(text)}", field="text")
    try:
        raw = text.encode()
    except UnicodeEncodeError as error:
        raise InvalidData(f"{path}: {text[error.start]!r} cannot be written as UTF-8") from None
    return write_bytes(path, raw)


def write_bytes(path: str | os.PathLike[str], raw: bytes) -> Path:
    """Write `raw` atomically; see :func:`write_text`. An existing file keeps its mode."""
    file = as_path(path)
    # A link stays a link; its target is replaced.
    target = Path(os.path.realpath(file))
    partial = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        old = target.stat() if target.exists() else None
        _require_regular(file, old)
        with partial.open("xb") as stream:
            if old is not None:
                os.fchmod(stream.fileno(), stat.S_IMODE(old.st_mode))
            stream.write(raw)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(target)
    except OSError as error:
        raise InvalidData(f"{file}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()
    return file


def _require_regular(file: Path, status: os.stat_result | None) -> None:
    """Raise if `file` is a device or a pipe, which a regular file must not replace."""
    if status is not None and not stat.S_ISREG(status.st_mode):
        raise InvalidData(f"{file}: is no regular file, and only such are written", field="file")


def writable(path: str | os.PathLike[str], suffixes: Sequence[str] = ()) -> Path:
    """Return the path of a file to write, after checking that it can be written.

    Parameters
    ----------
    path : str or path-like
        The file.
    suffixes : sequence of str
        Allowed suffixes in lower case, such as ``".html"``; empty for any.

    Raises
    ------
    InvalidData
        The suffix is not allowed, the folder does not exist, or the file cannot be written.
    """
    file = as_path(path)
    if suffixes and file.suffix.lower() not in suffixes:
        raise InvalidData(
            f"{file}: the file's name must end in {', '.join(suffixes)}", field="file"
        )
    if not file.parent.is_dir():
        raise InvalidData(f"{file}: folder {file.parent} does not exist", field="file")
    exists = file.exists()
    _require_regular(file, file.stat() if exists else None)
    # The new content is first written to a temporary file in the same folder.
    folder = Path(os.path.realpath(file)).parent
    if not os.access(folder, os.W_OK) or (exists and not os.access(file, os.W_OK)):
        raise InvalidData(f"{file}: cannot be written", field="file")
    return file
