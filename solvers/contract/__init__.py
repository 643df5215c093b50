"""What a backend is and returns: request, answer, solution, limits, registry, verdict."""
