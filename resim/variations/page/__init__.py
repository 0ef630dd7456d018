"""Pages of kernels and of variations."""
