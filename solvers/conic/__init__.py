"""Backends for conic programs: what they share beyond the quadratic ones, and ECOS.

:mod:`.base` settles what an answer proves, :mod:`.proofs` computes proofs. Clarabel, SCS and CVXPY
solve quadratic programs too and stand in :mod:`..qp` and :mod:`..mip`.
"""
