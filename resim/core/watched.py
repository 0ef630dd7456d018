"""How a simulation is told that somebody watches."""

LIVE_VARIABLE = "RESIM_LIVE"
"""Environment variable with the path of the file into which a simulation writes its latest state."""
