"""Units in the headers of tables: factors to the first unit of each quantity."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from ..errors import InvalidData, show

__all__ = [
    "ACCELERATIONS", "ANGLES", "LENGTHS", "RATES", "SPEEDS", "TIMES", "factor_of", "is_unit_row",
    "label_parts", "with_units",
]  # fmt: skip

_DEGREE, _GRAVITY = math.pi / 180.0, 9.80665


def _units(**names: float) -> Mapping[str, float]:
    return MappingProxyType(names)


#: Times in seconds. Lower case turns the micro sign into the Greek letter.
TIMES = _units(
    s=1.0, ms=1e-3, us=1e-6, μs=1e-6, ns=1e-9, min=60.0, h=3600.0, d=86400.0
)  # fmt: skip
#: Lengths in metres.
LENGTHS = _units(
    m=1.0, km=1e3, dm=0.1, cm=1e-2, mm=1e-3, ft=0.3048, yd=0.9144, mi=1609.344, nmi=1852.0,
    metres=1.0, meters=1.0, feet=0.3048, miles=1609.344,
)  # fmt: skip
#: Angles in radians.
ANGLES = _units(
    rad=1.0, deg=_DEGREE, **{"°": _DEGREE}, mrad=1e-3, degrees=_DEGREE, radians=1.0
)  # fmt: skip
#: Angular rates in radians per second.
RATES = _units(**{"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE, "mrad/s": 1e-3})
#: Speeds in metres per second.
SPEEDS = _units(
    **{"m/s": 1.0, "km/h": 1 / 3.6}, kph=1 / 3.6, mph=0.44704, kn=1852 / 3600, kt=1852 / 3600,
    **{"cm/s": 1e-2, "ft/s": 0.3048},
)  # fmt: skip
#: Accelerations in metres per second squared.
ACCELERATIONS = _units(
    **{"m/s²": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "m/s**2": 1.0}, g=_GRAVITY
)  # fmt: skip

#: Further units of columns that no reader converts. "A" is missing: it is a kind of point.
_OTHER = (  # noqa: SIM905
    "n kn nm n*m n·m kg lb t l m² m^2 m³ m^3 pa kpa mpa bar hpa v mv kv w kw wh kwh j kj hz khz "
    "k °c °f % rpm rev/min 1/min 1/s rad/s² rad/s^2 deg/s² deg/s^2 °/s² m/s³ m/s^3 m/s⁴ m/s^4"
).split()
_KNOWN = frozenset(_OTHER).union(TIMES, LENGTHS, ANGLES, RATES, SPEEDS, ACCELERATIONS)

#: Label of a column: a name, and optionally a unit in brackets.
_LABEL = re.compile(r"([^\[\]()]*)(?:\[([^\[\]]*)\]|\(([^()]*)\))?")


def label_parts(label: str) -> tuple[str, str]:
    """Return name and unit of a column's label as written; the unit may be empty."""
    match = _LABEL.fullmatch(label)
    if match is None:
        return label, ""
    return match[1].rstrip(), (match[2] or match[3] or "").strip()


def factor_of(
    unit: str, units: Mapping[str, float], where: str, field: str, *, bare: bool = False
) -> float:
    """Return the factor of a unit in `units`, or raise. With `bare`, the unit may be empty."""
    if bare and not unit:
        return 1.0
    if unit.casefold() not in units:
        got = f"got {show(unit.casefold())}" if unit else "got none"
        raise InvalidData(
            f"{where}: must state its unit in brackets, one of {', '.join(units)}; {got}",
            field=field,
        )
    return units[unit.casefold()]


def _bare(cell: str) -> str:
    """Return a cell of a row of units without brackets."""
    return cell.strip("[]() ")


def is_unit_row(cells: Sequence[str]) -> bool:
    """Return whether every cell is a known unit or empty.

    Several columns need two units: a single one could be the id of an incomplete row.
    """
    units = [_bare(cell).casefold() for cell in cells if _bare(cell) not in ("", "-")]
    return len(units) >= min(2, len(cells)) > 0 and _KNOWN.issuperset(units)


def with_units(labels: Sequence[str], cells: Sequence[str], where: str) -> list[str]:
    """Return the labels of a header with the units in the row below it, at `where`.

    Raises
    ------
    InvalidData
        A column has two different units.
    """
    result = []
    for label, unit in zip(labels, map(_bare, cells), strict=True):
        stated = label_parts(label)[1]
        if unit not in ("", "-", stated):
            if stated:
                raise InvalidData(
                    f"{where}: column {show(label)} must have one unit, got {show(unit)} below it",
                    field="header",
                )
            label = f"{label} [{unit}]"
        result.append(label)
    return result
