"""Backends for mixed-integer programs: one file a solver, each imported only when it runs."""
