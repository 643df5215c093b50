"""Readers of files of programs, by suffix: MPS, LP, NL, QPLIB, CBF, MATLAB and NumPy."""
