"""A mark: importing this module means that CasADi's own HiGHS is loaded into this process.

``casadi`` in ``sys.modules`` does not say so, for CasADi loads its solvers when they are asked for, and
only this one clashes with highspy and ortools.
"""
