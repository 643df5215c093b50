"""A suite that ships: small programs with known answers, which every backend is tried on.

``run_suite(backends)`` runs each backend in a worker of its own and returns the matrix backend ×
case; a stranger's backend is tried in the same way as ours. ``run_case(backend, name)`` runs one
case in this process. A feature that a backend does not declare makes its cases ``unsupported``.
"""

from .cases import Case, Expectation, Run
from .runner import run_suite
from .suite import CaseResult, Matrix, Status, all_cases, cases_for, run_case

__all__ = [
    "Case",
    "CaseResult",
    "Expectation",
    "Matrix",
    "Run",
    "Status",
    "all_cases",
    "cases_for",
    "run_case",
    "run_suite",
]
