"""Labels of rows of data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InvalidData
from .specs import Spec, count_rows, show

__all__ = ["Ids"]


@dataclass(frozen=True)
class Ids(Spec):
    """Distinct labels of rows, as in the file that the data come from.

    Parameters
    ----------
    rows : str
        Name of the dimension that the labels count.
    """

    rows: str = "n"

    content = False

    def coerce(
        self, name: str, value: Any, sizes: dict[str, tuple[int, str]]
    ) -> tuple[int | str, ...]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise InvalidData(
                f"{name} must be a list of numbers or words, got {show(value)}", field=name
            )
        ids: list[int | str] = []
        rows: dict[int | str, int] = {}
        for row, entry in enumerate(value):
            if isinstance(entry, bool) or not isinstance(entry, int | np.integer | str):
                raise InvalidData(
                    f"{name}[{row}] must be a whole number or a word, got {show(entry)}", field=name
                )
            label = entry if isinstance(entry, str) else int(entry)
            if label in rows:
                raise InvalidData(
                    f"{name}[{row}] is {label!r}, as is {name}[{rows[label]}]: ids must differ",
                    field=name,
                )
            rows[label] = row
            ids.append(label)
        count_rows(name, len(ids), self.rows, sizes)
        return tuple(ids)

    def encode(self, value: tuple[int | str, ...]) -> Any:
        return list(value)
