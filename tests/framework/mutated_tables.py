"""Random tables in many styles, with and without damage, and their expected values.

``python -m framework.mutated_tables 3000`` prints how many were read, rejected and wrong.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from crosstrack.errors import InvalidData
from crosstrack.instances.attractor import read_series
from crosstrack.instances.error_correction import read_points
from crosstrack.instances.fleet import read_nodes
from crosstrack.instances.guided_path import read_stops
from crosstrack.instances.messenger import read_vehicles
from crosstrack.instances.minimum_snap import read_samples, read_waypoints
from crosstrack.instances.sideslip import read_recording

LENGTH = {"": 1.0, "m": 1.0, "km": 1e3, "cm": 1e-2, "ft": 0.3048, "nmi": 1852.0}
SPEED = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600}
ANGLE = {"rad": 1.0, "deg": np.pi / 180, "°": np.pi / 180}
RATE = {"rad/s": 1.0, "deg/s": np.pi / 180, "°/s": np.pi / 180}
FORCE = {"m/s²": 1.0, "m/s**2": 1.0, "m/s^2": 1.0, "g": 9.80665}
TIME = {"s": 1.0, "ms": 1e-3, "min": 60.0}
PLAIN = {"": 1.0}

#: Reader, names of columns with their units, words in a column of text, and numbers from the result.
KINDS: dict[str, tuple[Any, dict[str, dict[str, float]], dict[str, Any], Any]] = {
    "nodes": (
        read_nodes, {"x": LENGTH, "y": LENGTH, "demand": {"": 1.0, "kg": 1.0}}, {"id": "n{}"},
        lambda d: np.column_stack([d["points"], d["demands"]]),
    ),
    "vehicles": (
        read_vehicles, {"x": LENGTH, "y": LENGTH, "vx": SPEED, "vy": SPEED}, {"id": "v{}"},
        lambda d: np.column_stack([d["positions"], d["velocities"]]),
    ),
    "stops": (
        read_stops, {"coordinate": LENGTH}, {"id": "s{}"},
        lambda d: np.array(d["coordinates"])[:, None],
    ),
    "recording": (
        read_recording,
        {"time": TIME, "speed": SPEED, "steering": ANGLE, "yaw_rate": RATE,
         "lateral_acceleration": FORCE}, {},
        lambda d: np.column_stack([d.times, d.speed, d.steering, d.yaw_rate, d.lateral_acceleration]),
    ),
    "series": (
        read_series, {"time": TIME, "height": {"m": 1.0}}, {}, lambda d: d.series[:, None],
    ),
    "waypoints": (read_waypoints, {"x": LENGTH, "y": LENGTH, "z": LENGTH}, {}, lambda d: d),
    "samples": (
        read_samples, {"t": PLAIN, "x": PLAIN, "vx": PLAIN}, {},
        lambda d: np.column_stack([d.times, *d.values[:, :, 0]]),
    ),
    "points": (
        read_points, {"x": LENGTH, "y": LENGTH, "z": LENGTH}, {"kind": None, "id": "p{}"},
        lambda d: d.points,
    ),
}  # fmt: skip
ROWS = 14
#: Characters that damage inserts.
CHARACTERS = "0123456789.,;\t -+eE#%/\"'[]()xyzA\x00é°\n"


def draw(rng: random.Random) -> tuple[str, str, list[int], np.ndarray, dict[str, Any]]:
    """Return the kind, text, lines of the rows, values (SI units) and options of a table."""
    kind = rng.choice([*KINDS])
    _, columns, words, _ = KINDS[kind]
    count = 52 if kind == "series" else ROWS
    ordered = kind in ("waypoints", "samples")
    names = [*columns, *words]
    if not ordered:
        rng.shuffle(names)
    separator = rng.choice(",;\t ")
    comma = separator in ";\t" and rng.random() < 0.6
    units = {name: rng.choice([*table]) for name, table in columns.items()}
    mapped = {}
    if kind != "samples" and rng.random() < 0.4:
        # Waypoints take their axes from the map.
        mapped = {name: f"{name.upper()}_raw" for name in names if ordered or rng.random() < 0.5}
    labels = [mapped.get(name, name) for name in names]
    below = separator != " " and rng.random() < 0.3 and sum(map(bool, units.values())) > 1
    if not below:
        style = rng.choice(["{} [{}]", "{} ({})", "{}[{}]"])
        labels = [
            style.format(label, units[name]) if units.get(name) else label
            for label, name in zip(labels, names, strict=True)
        ]
    quote = rng.random() < 0.3
    lines, places = [quoted(separator, labels, quote)], []
    if below:
        lines.append(separator.join(units.get(name, "") for name in names))
    values = np.array(
        [[round(rng.uniform(-1, 1), 4) for _ in columns] for _ in range(count)], float
    )
    for at, name in enumerate(columns):
        if name in ("time", "t"):
            values[:, at] = 0.1 * np.arange(count)
        elif name == "speed":
            values[:, at] = np.abs(values[:, at]) + 5.0
    for row in range(count):
        cells = []
        for name in names:
            if name == "kind":
                cells.append("A" if row == 0 else "B" if row == count - 1 else str(row % 2))
            elif name in words:
                cells.append(words[name].format(row))
            else:
                number = float(values[row, [*columns].index(name)] / columns[name][units[name]])
                cells.append(repr(number).replace(".", "," if comma else "."))
        if rng.random() < 0.1:
            lines.append(rng.choice(["", "# a note", "% end", "// see above", "#", separator]))
        places.append(len(lines))
        lines.append(quoted(separator, cells, quote))
    if rng.random() < 0.3:
        lines.insert(0, "# exported by a logger")
        places = [place + 1 for place in places]
    return (
        kind,
        rng.choice(["\n", "\r\n"]).join(lines) + "\n",
        places,
        values,
        ({"columns": mapped} if mapped else {}),
    )


def quoted(separator: str, cells: list[str], quote: bool) -> str:
    """Return a row with all cells in quotes if `quote`."""
    mark = '"' if quote else ""
    pad = " " * (1 + len(cells[0]) % 3) if separator == " " else separator
    if separator == " " and not quote:
        cells = [cell.replace(" [", "[").replace(" (", "(") for cell in cells]
    return pad.join(f"{mark}{cell}{mark}" for cell in cells)


def damage(rng: random.Random, text: str) -> tuple[str, set[int]]:
    """Return the text with damage, and the numbers of the damaged lines from 0."""
    lines = text.split("\n")
    hurt = set()
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(lines) - 1)
        line, k = lines[at], rng.randint(0, len(lines[at]))
        kind = rng.randrange(4)
        if kind == 0:
            line = line[:k] + rng.choice(CHARACTERS) + line[k:]
        elif kind == 1:
            line = line[:k] + line[k + 1 :]
        elif kind == 2:
            line = line[:k] + rng.choice(CHARACTERS) + line[k + 1 :]
        else:
            cells = line.split(",")
            cells[rng.randrange(len(cells))] = rng.choice(["", "NA", "-", "1e999", "1.234,5", "x"])
            line = ",".join(cells)
        lines[at] = line
        hurt.add(at)
    return "\n".join(lines), hurt


def encoded(rng: random.Random, text: str) -> tuple[bytes, dict[str, str]]:
    """Return the bytes of a text and the option of its encoding."""
    name = rng.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16", "windows-1252"])
    try:
        raw = text.encode(name)
    except UnicodeEncodeError:
        return text.encode(), {}
    return raw, {"encoding": name} if name == "windows-1252" else {}


def judge(seed: int, folder: Path) -> str:
    """Return "read", "damaged" (read with damage) or "rejected" for a table, or raise."""
    rng = random.Random(seed)
    kind, text, places, values, options = draw(rng)
    harmed = rng.random() < 0.8
    hurt: set[int] = set()
    if harmed:
        text, hurt = damage(rng, text)
    raw, more = encoded(rng, text)
    file = folder / "table.csv"
    file.write_bytes(raw)
    read, _, _, numbers = KINDS[kind]
    try:
        got = numbers(read(file, **options, **more))
    except InvalidData as error:
        if not harmed or not any(word in str(error) for word in (str(file), "columns must")):
            raise AssertionError(f"seed {seed}\n{text}") from error
        return "rejected"
    if kind == "series":
        values = values[:, 1:]
    if not harmed:
        assert got.shape == values.shape
        assert np.allclose(got, values, rtol=1e-12, atol=1e-12), f"seed {seed}\n{text}"
        return "read"
    # A damaged header can change units, and quotes can join lines.
    if min(hurt) >= places[0] and '"' not in text:
        intact = [row for row, place in enumerate(places) if place not in hurt]
        rows = iter(got)
        for row in intact:
            assert any(
                np.allclose(row_got, values[row], rtol=1e-12, atol=1e-12) for row_got in rows
            ), f"seed {seed}: row {row} is lost\n{text}"
    return "damaged"


def main(count: int, start: int = 0) -> Counter[str]:
    """Judge tables and return the number of each verdict."""
    with tempfile.TemporaryDirectory() as folder:
        return Counter(judge(seed, Path(folder)) for seed in range(start, start + count))


if __name__ == "__main__":
    print(dict(main(int(sys.argv[1]))))
