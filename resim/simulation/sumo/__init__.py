"""SUMO, the first engine."""
