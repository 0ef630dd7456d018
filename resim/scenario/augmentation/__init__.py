"""Variations of a drive by chance: paths, speeds, vehicles, colours, time of day and weather (Kaefer 2022, 4.5.3)."""
