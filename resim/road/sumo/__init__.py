"""OpenDRIVE to SUMO: nets with the map's exact lanes and links, and how exact each of them is."""

from resim.road.sumo.cache import SumoNet, default_cache, sumo_net
from resim.road.sumo.conversion import EXACT, VARIED, Conversion, Jump, LaneError

__all__ = ["EXACT", "VARIED", "Conversion", "Jump", "LaneError", "SumoNet", "default_cache", "sumo_net"]
