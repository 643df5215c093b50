"""Transcription of optimal control problems to nonlinear programs: collocation, meshes, refinement."""
