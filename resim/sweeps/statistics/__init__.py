"""Design of experiments: which parameters are tried at which values, and what the results say about them."""
