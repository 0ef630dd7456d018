"""Many recordings: suites, in child processes, resumed and repeated."""
