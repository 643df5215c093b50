"""Backends for quadratic programs: one file per solver, and their common tools.

:mod:`.base` runs a solver and recomputes its claims, :mod:`.forms` writes a program in the forms that
solvers read, :mod:`.polishing` makes an answer exact, :mod:`.proofs` computes proofs.
"""
