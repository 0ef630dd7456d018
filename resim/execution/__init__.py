"""Tasks in supervised child processes: workers, time limits, the journal, clusters. Knows nothing of driving."""
