"""AD functions under test: one module each. `builds/*.toml` pin one to a version and its parameters."""
