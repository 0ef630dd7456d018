"""The CommonRoad reactive planner as the package index has it, in an environment of its own.

`make reactive_planner` makes that environment; docs/guides/foreign_planner.md says how this was done.
"""
