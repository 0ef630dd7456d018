"""The jobs: one function a command, for the command line, notebooks and tests. They print nothing."""
