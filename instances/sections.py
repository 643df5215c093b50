"""Files of the TSPLIB family: ``KEYWORD : VALUE`` lines, then sections of rows, then ``EOF``."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidData
from ..files import read_text
from ..models.fields import show
from .tables import NUMBER

__all__ = ["KeywordFile"]


class KeywordFile(NamedTuple):
    """Content of a file.

    `head` holds the value of each keyword, and `sections` the words of each row by names such as
    ``"NODE_COORD_SECTION"``. Errors name the file.
    """

    path: Path
    head: dict[str, str]
    sections: dict[str, list[list[str]]]

    @classmethod
    def read(cls, path: Path, known: Mapping[str, Collection[str]]) -> KeywordFile:
        """Return the content of a file with `known` keywords and sections.

        A keyword maps to the allowed first words of its value; without any, every value is allowed.
        """
        content = cls(path, {}, {})
        head, sections = content.head, content.sections
        rows: list[list[str]] | None = None
        ended = False
        for line in read_text(path).splitlines():
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if ended:
                raise InvalidData(
                    f"{path}: nothing may follow EOF, got {show(words[0])}", field="eof"
                )
            key, sign, value = (part.strip() for part in line.partition(":"))
            word = key if sign else words[0]
            ended = word == "EOF"
            if ended:
                continue
            if not sign and "_SECTION" not in word:
                if rows is None:
                    raise InvalidData(
                        f"{path}: no TSPLIB or VRPLIB file: {show(line)} has no keyword",
                        field="keyword",
                    )
                rows.append(words)
                continue
            if word not in known:
                raise InvalidData(
                    f"{path}: {show(word)} is not supported, and leaving it out would change the problem; "
                    f"allowed: {', '.join(sorted(known))}",
                    field=word.lower(),
                )
            if (word in head or word in sections) and word != "COMMENT":
                raise InvalidData(f"{path}: {word} must be there once", field=word.lower())
            if "_SECTION" in word:
                rows = sections[word] = []
            elif rows is not None:
                raise InvalidData(f"{path}: {word} must be before the sections", field=word.lower())
            else:
                head[word] = value
                if known[word]:
                    content.require(word, known[word])
        return content

    def size(self, least: int, most: int) -> int:
        """Return the number of nodes; raise unless it is a whole number from `least` to `most`."""
        text = self.head.get("DIMENSION")
        # Longer numbers are too large, and Python limits the digits of an integer.
        plain = text is not None and text.isascii() and text.isdigit() and len(text) < 10
        if text is None or not plain or not least <= int(text) <= most:
            raise InvalidData(
                f"{self.path}: DIMENSION must be a whole number from {least} to {most}, got {show(text)}",
                field="dimension",
            )
        return int(text)

    def require(self, keyword: str, allowed: Collection[str]) -> str:
        """Return the first word of a keyword's value; raise unless it is one of `allowed`."""
        value = self.head.get(keyword)
        first = "" if value is None else value.partition(" ")[0]
        if first not in allowed:
            names = ", ".join(allowed)
            raise InvalidData(
                f"{self.path}: {keyword} must be {'one of ' * (len(allowed) > 1)}{names}, got {show(value)}",
                field=keyword.lower(),
            )
        return first

    def numbers(self, section: str, field: str) -> NDArray[np.float64]:
        """Return all numbers of a section; raise for words that are not finite numbers."""
        words = [word for row in self.sections.get(section, ()) for word in row]
        bad = next((word for word in words if not NUMBER.fullmatch(word)), None)
        values = np.array([] if bad else words, float)
        if bad is not None or not np.isfinite(values).all():
            bad = bad or words[int((~np.isfinite(values)).argmax())]
            raise InvalidData(
                f"{self.path}: {section} must hold finite numbers, got {show(bad)}", field=field
            )
        return values
