"""Backends for nonlinear programs: one file a solver; the plugins of ``casadi.nlpsol`` share one."""
