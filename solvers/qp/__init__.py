"""Quadratic programs: one file a backend."""
