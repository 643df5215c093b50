"""Missions of a fleet on a map."""

BACKENDS = {
    "staged": ".staged:Staged",
    "paper-pipeline": ".paper:PaperPipeline",
}
DIAGNOSES = {"fleet-mission": ".diagnosis:diagnose_mission"}
