"""Instances of messenger tours: seeded ones with the sizes of the paper, and readers."""
