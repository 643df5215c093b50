"""Optimal control problems written as nonlinear programs: collocation schemes, meshes, refinement."""
