"""Native algorithms for the slew of a satellite: the steering laws of the field, as heuristics."""
