"""Shortest paths on a grid."""
