"""Naturalistic traffic: SUMO's drivers on a map, their lateral motion laid anew, and the truth of what they do."""
