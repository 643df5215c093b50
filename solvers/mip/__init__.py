"""Backends for mixed-integer programs: one file per solver, imported only when it runs."""
