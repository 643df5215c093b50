"""Native algorithms for the routes of a fleet."""

BACKENDS = {"fleet-search": ".fleet_search:FleetSearch"}
