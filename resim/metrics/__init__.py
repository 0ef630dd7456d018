"""Judges a drive: how near an accident it was, with time and object."""
