"""Backends for quadratic programs: one file a solver, and what they share.

:mod:`.base` runs a solver and settles what its answer proves, :mod:`.forms` writes a program in the
forms that solvers read, :mod:`.polishing` makes an answer exact, :mod:`.proofs` computes proofs.
"""
