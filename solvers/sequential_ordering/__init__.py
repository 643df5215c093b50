"""Native algorithms for sequential ordering, with loops compiled by Numba."""

BACKENDS = {
    "bounded-levels": ".bounded_levels:BoundedLevels",
    "three-exchange": ".three_exchange:ThreeExchange",
}
DIAGNOSES = {"sequential-ordering": ".diagnosis:diagnose_ordering"}
