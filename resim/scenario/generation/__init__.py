"""Drives whose truth is known: routes and speed profiles to exact motion, and the maneuvers that are in it."""
