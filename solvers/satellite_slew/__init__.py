"""Native heuristics for the slew of a satellite: the field's steering laws."""

BACKENDS = {
    "slew-pseudo-inverse": ".eigenaxis:PseudoInverseSteering",
    "slew-singularity-robust": ".eigenaxis:SingularityRobust",
    "slew-generalised": ".eigenaxis:Generalised",
}
DIAGNOSES = {"satellite-slew": "..optimal_control.diagnosis:diagnose_control"}
