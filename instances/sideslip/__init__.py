"""Instances of sideslip estimation: simulated drives, and recordings read from files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .exports import write_sideslip_csv as write_sideslip_csv
    from .generator import generate as generate
    from .readers import read_recording as read_recording
    from .vehicles import read_vehicle as read_vehicle, write_vehicle as write_vehicle

CATALOGUE = {"sideslip": ".listing:catalogue_entries"}
REFERENCES = {"sideslip": ".vehicles:resolve_references"}
TABLE_FILES = {"sideslip": ".readers:table_file"}
TABLE_COLUMNS = {
    "sideslip": {
        "time [s]": "recording.times", "speed [m/s]": "recording.speed", "steering [rad]": "recording.steering",
        "yaw_rate [rad/s]": "recording.yaw_rate",
        "lateral_acceleration [m/s²]": "recording.lateral_acceleration",
        "sideslip [rad]": "truth",
    }
}  # fmt: skip
TEMPLATES = {"sideslip": "sideslip/untrained"}
DEMOS = {"sideslip": "sideslip/lane-change"}
EXPORTS = {"csv": ".exports:CSV"}
PAPERS = {"sideslip": ".paper:PAPER"}
PAPER_TABLES = {f"sideslip/table-{number}": f".paper_tables:table_{number}" for number in (1, 2, 3)}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
