"""Instances: the papers' settings and results, seeded generators, readers and writers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .catalogue import (
        CatalogueEntry as CatalogueEntry,
        Provenance as Provenance,
        entries as entries,
        entry as entry,
        load as load,
        register_entry as register_entry,
    )
    from .error_correction.files import (
        read_csv as read_csv,
        read_points as read_points,
        write_csv as write_csv,
        write_json as write_json,
    )
    from .exports import (
        ExportFormat as ExportFormat,
        export_formats as export_formats,
        export_plan as export_plan,
    )
    from .file_format import FileFormat as FileFormat, Head as Head, Target as Target
    from .formats import (
        file_formats as file_formats,
        recognise as recognise,
        register_format as register_format,
    )
    from .minimum_snap.bezier import read_bezier as read_bezier, write_bezier as write_bezier
    from .minimum_snap.paths import times_by_distance as times_by_distance
    from .minimum_snap.pieces import Poly7 as Poly7
    from .minimum_snap.poly7 import (
        Poly7Report as Poly7Report,
        read_poly7 as read_poly7,
        write_poly7 as write_poly7,
    )
    from .minimum_snap.tables import (
        Samples as Samples,
        read_samples as read_samples,
        read_waypoints as read_waypoints,
        write_samples as write_samples,
    )
    from .optimal_control.tables import write_control_samples as write_control_samples
    from .projection import project_positions as project_positions
    from .rows import TableOptions as TableOptions
    from .storage import (
        read_model as read_model,
        read_plan as read_plan,
        register_references as register_references,
        write_model as write_model,
        write_text as write_text,
    )

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
