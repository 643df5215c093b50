"""Covering problem: select the cheapest items whose weights reach a demand."""

MODELS = {"covering": ".model:Covering"}
PICTURES = {"covering": ".tables:draw"}
BACKENDS = {"dynamic-programming": ".solving:CoverByWeight"}
DIAGNOSES = {"covering": ".solving:diagnose_covering"}
PAPERS = {"covering": ".tables:PAPER"}
PAPER_TABLES = {"covering/table-1": ".tables:measure"}
CATALOGUE = {"covering": ".tables:catalogue_entries"}
EXPORTS = {"list": ".tables:LIST"}
DEMOS = {"covering": ".tables:DEMO"}
