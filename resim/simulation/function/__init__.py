"""The AD function: its interface, its build file, and how it is driven."""
