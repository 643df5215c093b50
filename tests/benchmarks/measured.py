"""Tables that pages show: a script writes them to ``docs/measured``, ``crosstrack-measured`` shows them."""

from __future__ import annotations

import datetime
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import crosstrack as ct

ROOT = Path(__file__).resolve().parents[2]


def write(
    problem: str,
    table: str,
    script: str,
    columns: Mapping[str, str],
    rows: Iterable[Sequence[Any]],
    packages: Sequence[str] = (),
    said: str = "",
    *,
    merge: bool = False,
    keys: int = 1,
    order: Sequence[tuple[Any, ...]] = (),
) -> None:
    """Write one table of a problem, and leave the others in its file as they are.

    ``columns`` maps heads to formats, ``said`` is a sentence to stand below, and ``packages`` are those on
    whose versions the values depend. With ``merge`` rows of the same columns stay, those with the same
    first cell excepted.
    """
    path = ROOT / "docs" / "measured" / f"{problem}.json"
    path.parent.mkdir(exist_ok=True)
    found = json.loads(path.read_text("utf-8")) if path.exists() else {}
    kept = list(map(list, rows))
    if merge and found.get(table, {}).get("columns") == dict(columns):
        firsts = {tuple(row[:keys]) for row in kept}
        kept += [row for row in found[table]["rows"] if tuple(row[:keys]) not in firsts]
        if order:
            places = {key: place for place, key in enumerate(order)}
            kept = [row for row in kept if tuple(row[:keys]) in places]
            kept.sort(key=lambda row: places[tuple(row[:keys])])
        else:
            kept.sort(key=lambda row: (isinstance(row[0], str), row[0]))
    found[table] = {
        "script": str(Path(script).resolve().relative_to(ROOT)),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "versions": {
            "crosstrack": ct.__version__,
            "Python": platform.python_version(),
            **{name: version(name) for name in packages},
        },
        "processors": os.cpu_count(),
        "said": said,
        "columns": dict(columns),
        "rows": kept,
    }
    text = json.dumps(
        dict(sorted(found.items())),
        indent=1,
        ensure_ascii=False,
        default=lambda number: number.item(),
    )
    path.write_text(text + "\n", "utf-8")
