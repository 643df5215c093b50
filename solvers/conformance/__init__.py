"""Conformance suite: small programs with known answers for testing backends.

``run_suite(backends)`` runs each backend in a worker process and returns the matrix of backends and
cases, for backends of this package and of others alike. ``run_case(backend, name)`` runs one case in
this process. Cases that need a feature which a backend does not declare are ``unsupported``.
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
