"""Re-simulation: traffic objects on their traces in SUMO, the EGO in closed loop with an AD function."""
