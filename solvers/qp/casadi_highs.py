"""Marker module: it is imported when CasADi's own HiGHS is loaded into this process.

``casadi`` in ``sys.modules`` is not sufficient, because CasADi loads its solvers on demand, and only
HiGHS conflicts with highspy and ortools.
"""
