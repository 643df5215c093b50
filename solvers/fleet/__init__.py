"""Routes of a fleet."""
