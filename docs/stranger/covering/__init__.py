"""The cheapest items whose weights reach a demand: a problem that crosstrack knows nothing of."""

MODELS = {"covering": ".model:Covering"}
PICTURES = {"covering": ".tables:draw"}
BACKENDS = {"dynamic-programming": ".solving:CoverByWeight"}
DIAGNOSES = {"covering": ".solving:diagnose_covering"}
PAPER_TABLES = {"covering": ".tables:TABLES"}
CATALOGUE = {"covering": ".tables:catalogue_entries"}
EXPORTS = {"list": ".tables:LIST"}
DEMOS = {"covering": ".tables:DEMO"}
