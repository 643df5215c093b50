"""Native algorithms for routes with error-correction points; the loops are compiled by Numba."""

BACKENDS = {
    "label-setting": ".label_setting:LabelSetting",
    "two-stage": ".two_stage:TwoStage",
    "pulse": ".pulse:Pulse",
    "dynamic-programming": ".dynamic_programming:DynamicProgramming",
    "labelling": ".labelling:Labelling",
}
DIAGNOSES = {"error-correction": ".diagnosis:diagnose_routing"}
