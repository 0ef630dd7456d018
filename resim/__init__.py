"""resim: re-simulation of measured test drives with the automated-driving function at the wheel."""

__version__ = "0.1.0"
