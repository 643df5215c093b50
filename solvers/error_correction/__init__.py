"""Native algorithms for routes with error-correction points; the loops are compiled by Numba."""

BACKENDS = {
    "label-setting": ".label_setting:LabelSetting",
    "two-stage": ".printed:TwoStage",
    "pulse": ".printed:Pulse",
    "dynamic-programming": ".printed:DynamicProgramming",
    "labelling": ".printed:Labelling",
}
DIAGNOSES = {"error-correction": ".diagnosis:diagnose_routing"}
