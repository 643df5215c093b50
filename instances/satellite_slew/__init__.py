"""Instances of satellite slews: the paper's, other axes and angles, reserves, and one without a plan."""

CATALOGUE = {"satellite-slew": ".listing:catalogue_entries"}
EXPORTS = {"samples": "..optimal_control.tables:SAMPLES"}
