"""OpenSCENARIO XML as far as it says where things are over time: its elements, places, curves and times."""
