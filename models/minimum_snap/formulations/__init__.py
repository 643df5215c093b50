"""A trajectory problem as a quadratic program, in several bases."""
