"""Roads: OpenDRIVE geometry, routes along lanes, conversion to SUMO nets."""
