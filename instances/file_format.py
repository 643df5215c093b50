"""Declaration of a format of files: how its content is recognised, and the reader of each model."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from ..errors import InvalidData
from ..models.fields import required, show

__all__ = ["FileFormat", "Head", "Target"]

#: Bytes of a file that are read to recognise its format.
GLANCE = 1 << 16

#: Token of JSON: a string, or a character of its structure.
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*+"|[{}\[\]:,]')


class Head(NamedTuple):
    """Beginning of a file, which identifies its format.

    Parameters
    ----------
    text : str
        The first 64 KiB, up to the end of a line, decompressed if the file is compressed with gzip.
        Bytes that are not UTF-8 or UTF-16 are decoded as Latin-1.
    keys : mapping of str to str
        Keys of a JSON object at its top level, with the values that are strings.
    """

    text: str
    keys: Mapping[str, str]

    @classmethod
    def of(cls, file: Path) -> Head:
        """Return the beginning of `file`. A pipe has an empty one, because it can be read only once."""
        if not file.is_file():
            return cls("", {})
        try:
            with file.open("rb") as stream:
                raw = stream.read(GLANCE + 1)
        except OSError as error:
            raise InvalidData(f"{file}: cannot be read: {error.strerror}") from None
        whole = len(raw) <= GLANCE
        if raw[:2] == b"\x1f\x8b":
            unpacked = zlib.decompressobj(wbits=31)
            try:
                raw = unpacked.decompress(raw, GLANCE)
            except zlib.error:
                raw = b""
            whole = unpacked.eof
        text = _decoded(raw)
        if not whole and "\n" in text:
            text = text[: text.rindex("\n") + 1]
        return cls(text, _top_level(text))


def _decoded(raw: bytes) -> str:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", "replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # A character may be cut at the end of the prefix.
        cut = error.start >= len(raw) - 3
        return raw[: error.start].decode("utf-8-sig") if cut else raw.decode("latin-1")


def _top_level(text: str) -> dict[str, str]:
    """Return the keys of a JSON object at its top level, with the values that are strings."""
    result: dict[str, str] = {}
    if not text.lstrip().startswith("{"):
        return result
    depth, key = 0, None
    for match in _TOKEN.finditer(text):
        token = match[0]
        depth += (token in "{[") - (token in "}]")
        if depth == 1 and token == ",":
            key = None
        elif depth == 1 and token[0] == '"':
            if key is None:
                key = token[1:-1]
                result[key] = ""
            else:
                result[key] = token[1:-1]
    return result


class Target(NamedTuple):
    """Model that a file can become.

    Parameters
    ----------
    reader : callable or str
        Function ``(path, **data) -> model``, lazily as ``"module:function"``. `data` are the values of
        ``--data``. The reader receives the parameters ``find`` (path of a file beside it, by name),
        ``form`` (name of the format), ``model``, ``trusted`` and ``folder`` (of
        :func:`crosstrack.load`) if its signature has them.
    needs : mapping of str to str
        Data that the file never contains, with examples as JSON text.
    may : mapping of str to str
        Data that some files lack, with examples as JSON text.
    """

    reader: Callable[..., Any] | str
    needs: Mapping[str, str] = MappingProxyType({})
    may: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class FileFormat:
    """Format of files that :func:`crosstrack.load` and the command line read.

    Parameters
    ----------
    name : str
        Name of the format, such as ``"movingai-map"``.
    title : str
        Noun phrase for messages and tables, such as ``"a grid map of MovingAI"``.
    targets : mapping of str to Target
        Reader for each kind of model that the file can become; the key is empty for a reader that
        chooses the kind.
    content : str or callable
        Regular expression that the beginning of the file contains (``^`` matches at each line), or
        function of a :class:`Head`; empty to recognise the format by the suffix only.
    suffixes : tuple of str
        Suffixes in lower case. They select the format if no content matches.
    remedy : str
        Advice that is added to the errors of the readers; required without `targets`.

    Raises
    ------
    InvalidData
        A field has another type, `content` is not a regular expression, or the format has neither
        targets nor a remedy.
    """

    name: str
    title: str
    targets: Mapping[str, Target] = field(default_factory=dict, hash=False)
    content: Callable[[Head], bool] | str = ""
    suffixes: tuple[str, ...] = ()
    remedy: str = ""

    def __post_init__(self) -> None:
        for name in ("name", "title", "remedy"):
            required(name, getattr(self, name), str)
        targets, content = self.targets, self.content
        if not isinstance(targets, Mapping) or not all(
            isinstance(target, Target) for target in targets.values()
        ):
            raise InvalidData(
                f"targets must be a mapping of models to Target, got {show(targets)}",
                field="targets",
            )
        if not isinstance(self.suffixes, tuple) or not all(
            isinstance(suffix, str) for suffix in self.suffixes
        ):
            raise InvalidData(
                f"suffixes must be a tuple of str, got {show(self.suffixes)}", field="suffixes"
            )
        if not callable(content):
            try:
                re.compile(required("content", content, str), re.MULTILINE)
            except re.error as error:
                raise InvalidData(
                    f"content must be a regular expression, got {show(content)}: {error}",
                    field="content",
                ) from None
        if not targets and not self.remedy:
            raise InvalidData(
                f"format {show(self.name)} must have targets, or a remedy", field="targets"
            )

    def matches(self, head: Head) -> bool:
        """Return whether the beginning of a file has the form of this format."""
        if callable(self.content):
            return self.content(head)
        # The cache of re holds 512 patterns.
        return bool(self.content and re.search(self.content, head.text, re.MULTILINE))
