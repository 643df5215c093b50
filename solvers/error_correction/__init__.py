"""Native algorithms for routes with error-correction points; the loops are compiled by Numba."""
