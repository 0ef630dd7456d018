"""Rates, shares that were not seen, and expected accidents, each with an interval that is never of width zero."""
