"""Native algorithms for tours of a messenger UAV; the loops are compiled by Numba."""

BACKENDS = {
    "tour-search": ".search:TourSearch",
    "euclidean-bound": ".bound:EuclideanBound",
    "curvature-bound": ".bound:CurvatureBound",
}
