"""Contract of backends: request, answer, solution, limits, registry and verdict."""
