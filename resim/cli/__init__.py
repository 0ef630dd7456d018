"""The command line, one module per command."""

from resim.cli import imports, maps, run
from resim.cli.app import app, main

__all__ = ["app", "imports", "main", "maps", "run"]
