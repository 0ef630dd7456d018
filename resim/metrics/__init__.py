"""Judges a drive: how near an accident it was, when, and because of whom."""
