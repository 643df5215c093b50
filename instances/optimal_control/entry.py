"""Construction of catalogue entries for optimal control, and sources that several entries share."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from ...models.optimal_control.model import OptimalControlProblem
from ..catalogue import CatalogueEntry, Provenance

__all__ = [
    "ATHANS",
    "BETTS",
    "BRYSON",
    "COPS",
    "MAURER",
    "MAXIMUM",
    "RAO",
    "SHOOTING",
    "VASSILIADIS",
    "entry",
]

BRYSON = "A. E. Bryson, Y.-C. Ho: Applied Optimal Control, Hemisphere, 1975"
BETTS = (
    "J. T. Betts: Practical Methods for Optimal Control and Estimation Using Nonlinear "
    "Programming, SIAM, 2010"
)
COPS = (
    "E. D. Dolan, J. J. Moré, T. S. Munson: Benchmarking Optimization Software with COPS 3.0, "
    "Argonne National Laboratory, 2004"
)
MAURER = (
    "H. Maurer, D. Augustin: Sensitivity analysis and real-time control of parametric optimal "
    "control problems using boundary value methods, in Online Optimization of Large Scale "
    "Systems, Springer, 2001"
)
VASSILIADIS = (
    "V. S. Vassiliadis, R. W. H. Sargent, C. C. Pantelides: Solution of a class of multistage "
    "dynamic optimization problems, Industrial and Engineering Chemistry Research 33, 1994"
)
RAO = (
    "A. V. Rao, K. D. Mease: Eigenvector approximate dichotomic basis method for solving "
    "hyper-sensitive optimal control problems, Optimal Control Applications and Methods 21, 2000"
)
ATHANS = "M. Athans, P. L. Falb: Optimal Control, McGraw-Hill, 1966"

SHOOTING = "Pontryagin's conditions, shot with DOP853"
MAXIMUM = "The paper maximises, so the objective has the opposite sign."


def entry(
    problem: Callable[..., OptimalControlProblem],
    title: str,
    paper: str,
    objective: float,
    source: str,
    *,
    name: str = "",
    analytic: bool = False,
    printed: str = "",
    provenance: Provenance = Provenance.PUBLIC,
    note: str = "",
    **options: Any,
) -> CatalogueEntry:
    """Return a catalogue entry.

    Parameters
    ----------
    problem : callable
        Function that declares the problem.
    title, paper, note
        See :class:`~crosstrack.instances.CatalogueEntry`.
    objective : float
        Reference value of the objective.
    source : str
        Derivation of the value.
    name : str
        Name of the instance; by default that of the function.
    analytic : bool
        Whether the value follows from a formula or from one root of a formula.
    printed : str
        Value as printed in the paper.
    provenance : Provenance
        Source of the data.
    **options
        Options of the problem.
    """
    full = f"optimal-control/{name or problem.__name__.replace('_', '-')}"
    published: dict[str, Any] = {"objective": objective, "source": source, "analytic": analytic}
    words = [note, f"Value: {source}."]
    if printed:
        published["printed"] = printed
        words.append(f"Printed: {printed}.")
    return CatalogueEntry(
        name=full,
        model="optimal-control",
        title=title,
        paper=paper,
        provenance=provenance,
        builder=partial(_build, problem, full, **options),
        published=published,
        note=" ".join(filter(None, words)),
    )


def _build(
    problem: Callable[..., OptimalControlProblem], name: str, **options: Any
) -> OptimalControlProblem:
    """Return the built problem; the functions return builders, which accept further declarations."""
    return problem(name, **options).build()
