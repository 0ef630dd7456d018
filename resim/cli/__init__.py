"""The command line, one module per command."""

from resim.cli import check, imports, maps, run
from resim.cli.app import app, main

__all__ = ["app", "check", "imports", "main", "maps", "run"]
