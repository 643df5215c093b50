"""Kinds of evidence for the bound of several answers to one program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .solution import Solution

__all__ = ["kind_of_proof", "strongest"]

#: Kinds that do not depend on a solver, from the strongest; see ``Proof`` of the certificates.
RIGOROUS = ("exact", "safe bound")
#: Solver's bound, and one with which that of another solver agrees.
CLAIMED, CHECKED = "solver's bound", "solver's bound, cross-checked"
#: Solvers that backends of other names call. Backends with several solvers record theirs in the
#: statistics or have an option for it.
CALLED = {"ortools": "scip", "scipy": "highs"}


def strongest(proofs: Iterable[str]) -> str:
    """Return the strongest kind of evidence, the first of several others; empty without any.

    Parameters
    ----------
    proofs : iterable of str
        Kinds of evidence; empty ones are ignored.
    """
    known = [proof for proof in proofs if proof]
    return next((kind for kind in RIGOROUS if kind in known), known[0] if known else "")


def kind_of_proof(best: Solution[Any], near: Sequence[Solution[Any]]) -> str:
    """Return the kind of evidence for the best bound, which other backends may confirm.

    A rigorous bound within the gap takes the place of the best one.

    Parameters
    ----------
    best : Solution
        Answer with the best bound.
    near : sequence of Solution
        Answers of exact backends whose bounds agree with it within the gap.
    """
    proof = strongest([best.proof, *(s.proof for s in near if s.proof in RIGOROUS)])
    solvers = {_solver(s) for s in near if s.proof}
    return CHECKED if proof == CLAIMED and len(solvers) > 1 else proof


def _solver(solution: Solution[Any]) -> str:
    """Return the name of the solver that a backend calls, which another library may contain."""
    options = solution.options.get("backend_options") or {}
    name = solution.statistics.get("solver") or options.get("solver") or options.get("plugin")
    return str(name or CALLED.get(solution.backend, solution.backend)).lower()
