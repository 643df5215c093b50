"""Native algorithms for polynomial trajectories."""
