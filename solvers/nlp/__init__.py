"""Backends for nonlinear programs: one file per solver, and a base for plugins of ``casadi.nlpsol``."""
