"""Drives in the formats of other tools: one module a format, each from what the player shows of a drive."""
