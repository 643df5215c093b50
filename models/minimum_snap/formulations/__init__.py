"""Quadratic and nonlinear programs of trajectory problems, in several bases."""
