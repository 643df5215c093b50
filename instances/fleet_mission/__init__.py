"""Missions of a fleet on a map."""
