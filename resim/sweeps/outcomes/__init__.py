"""Outcomes of a sweep's runs: in which respects runs are told apart, one module each."""
