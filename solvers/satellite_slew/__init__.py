"""Native algorithms for the slew of a satellite: the steering laws of the field, as heuristics."""

BACKENDS = {
    "slew-pseudo-inverse": ".eigenaxis:PseudoInverseSteering",
    "slew-singularity-robust": ".eigenaxis:SingularityRobust",
    "slew-generalised": ".eigenaxis:Generalised",
}
DIAGNOSES = {"satellite-slew": "..optimal_control.diagnosis:diagnose_control"}
