"""Export formats of trajectories for other software."""

from __future__ import annotations

from ..exports import ExportFormat
from .bezier import write_bezier
from .poly7 import write_poly7
from .tables import write_samples

__all__ = ["BEZIER", "POLY7", "SAMPLES"]

POLY7 = ExportFormat("pieces of degree 7 as a Crazyflie flies them (CSV)", ".csv", write_poly7)
SAMPLES = ExportFormat("samples of all derivatives (CSV)", ".csv", write_samples)
BEZIER = ExportFormat("Bézier points (JSON)", ".json", write_bezier)
