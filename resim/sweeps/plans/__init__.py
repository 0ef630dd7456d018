"""Plans of a sweep: which values are run."""
