"""Diagnosis of optimal control problems."""

DIAGNOSES = {"optimal-control": ".diagnosis:diagnose_control"}
