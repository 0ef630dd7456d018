"""The command line, one module per command."""

import signal
import sys
from pathlib import Path

if Path(sys.argv[0]).name == "resim" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(
        signal.SIGINT, signal.SIG_DFL
    )  # Ctrl-C while the command is loaded: nobody wants a traceback

from resim.cli import (
    assess,
    augment,
    check,
    demo,
    export,
    function,
    generate,
    imports,
    lake,
    maps,
    mine,
    perception,
    play,
    prediction,
    run,
    runs,
    serve,
    space,
    suite,
    sweep,
    sweep_report,
    tasks,
    traffic,
    users,
    vary,
    verify,
)
from resim.cli.app import app, main

__all__ = [
    "app",
    "assess",
    "augment",
    "check",
    "demo",
    "export",
    "function",
    "generate",
    "imports",
    "lake",
    "main",
    "maps",
    "mine",
    "perception",
    "play",
    "prediction",
    "run",
    "runs",
    "serve",
    "space",
    "suite",
    "sweep",
    "sweep_report",
    "tasks",
    "traffic",
    "users",
    "vary",
    "verify",
]
