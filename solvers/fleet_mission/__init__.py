"""Solvers for missions of a fleet."""

BACKENDS = {"staged": ".staged:Staged", "paper-pipeline": ".paper:PaperPipeline"}
DIAGNOSES = {"fleet-mission": ".diagnosis:diagnose_mission"}
