"""Finds scenarios in recordings: features of every sample, maneuver labels, and the windows worth driving again."""
