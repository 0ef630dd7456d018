"""Sweeps of perception-error models: the file, the plans, the runs, their statistics and the page."""
