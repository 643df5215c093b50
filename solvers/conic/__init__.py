"""Backends for conic programs: their common base, proofs, and ECOS.

:mod:`.base` recomputes the claims of a solver, and :mod:`.proofs` computes proofs. Clarabel, SCS and
CVXPY also solve quadratic programs; their modules are in :mod:`..qp` and :mod:`..mip`.
"""
