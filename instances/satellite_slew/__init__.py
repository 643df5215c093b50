"""Instances of satellite slews: the paper's, other axes and angles, reserves, and an infeasible one."""

CATALOGUE = {"satellite-slew": ".listing:catalogue_entries"}
EXPORTS = {"samples": "..optimal_control.tables:SAMPLES"}
PAPERS = {"satellite-slew": ".paper:PAPER"}
PAPER_TABLES = {
    f"satellite-slew/{name}": f".paper_tables:{name}" for name in ("readings", "methods")
}
