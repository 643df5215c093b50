"""Native algorithms for the tour of a guided vehicle, with loops compiled by Numba."""

BACKENDS = {
    "a-star": ".a_star:AStar",
    "dynamic-programming": ".dynamic_programming:DynamicProgramming",
    "chain-search": ".chain_search:ChainSearch",
    "insert-nearest": ".insertion:InsertNearest",
    "insert-index": ".insertion:InsertIndex",
    "track-search": ".track_search:TrackSearch",
    "greedy": ".insertion:Greedy",
}
DIAGNOSES = {"guided-path-tour": ".diagnosis:diagnose_tour"}
