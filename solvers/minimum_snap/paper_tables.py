"""The paper's tables, and our runs beside their columns."""

from __future__ import annotations

from ..report.layout import Column, PaperTable, PaperTables

__all__ = ["TABLES"]

TABLES = PaperTables(
    {
        1: PaperTable(
            "The paper's equations (5-13, 23-25) as printed, and the same problem in other bases",
            (
                Column("banded"),
                Column("clarabel:legendre"),
                Column("clarabel:monomial"),
                Column("clarabel:hermite"),
                Column("clarabel:paper"),
            ),
        ),
        2: PaperTable(
            "The minimum-snap spline, whose jerk is continuous too, by backends of every kind",
            (
                Column("banded"),
                Column("interior-point"),
                Column("piqp:legendre"),
                Column("clarabel:legendre"),
                Column("osqp:legendre"),
            ),
        ),
    },
    note=(
        "The paper prints equations and a picture, but neither waypoints nor values: the instances "
        "are ours, and nothing stands beside its figures. What is reproduced is how its program "
        "behaves. Where an answer is rejected, its powers of absolute time have lost the digits "
        "that the conditions at the waypoints need."
    ),
)
