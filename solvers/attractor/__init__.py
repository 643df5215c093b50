"""Estimators of delay, dimension, exponent and correlation dimension, and a surrogate test."""

BACKENDS = {
    "full-analysis": ".full_analysis:FullAnalysis",
    "c-c": ".delays:CorrelationIntegral",
    "improved-c-c": ".delays:ImprovedCorrelationIntegral",
    "mutual-information": ".delays:MutualInformation",
    "autocorrelation": ".delays:Autocorrelation",
    "false-neighbours": ".dimensions:FalseNeighbours",
    "cao": ".dimensions:Cao",
    "rosenstein": ".exponents:Rosenstein",
    "kantz": ".exponents:Kantz",
    "correlation-dimension": ".correlation:CorrelationDimension",
    "small-data-sets": ".paper_methods:SmallDataSets",
    "g-p": ".paper_methods:GrassbergerProcaccia",
    "surrogates": ".verdict:Surrogates",
    "lyapunov-spectrum": ".spectrum:LyapunovSpectrum",
    "measures": ".measures:SeriesMeasures",
}
DIAGNOSES = {"attractor": ".diagnosis:diagnose_attractor"}
