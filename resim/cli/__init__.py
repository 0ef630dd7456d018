"""The command line, one module per command."""

from resim.cli import (
    assess,
    check,
    imports,
    maps,
    perception,
    prediction,
    run,
    runs,
    suite,
    sweep,
    sweep_report,
    verify,
)
from resim.cli.app import app, main

__all__ = [
    "app",
    "assess",
    "check",
    "imports",
    "main",
    "maps",
    "perception",
    "prediction",
    "run",
    "runs",
    "suite",
    "sweep",
    "sweep_report",
    "verify",
]
