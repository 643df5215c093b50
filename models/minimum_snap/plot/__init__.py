"""The picture of a trajectory."""
