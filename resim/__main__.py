"""`python -m resim`."""

import sys
from pathlib import Path

if sys.path[0] == str(Path.cwd()) != str(Path(__file__).parents[1]):
    del sys.path[0]  # -m puts the working directory first, and a random.py there before Python's own

from resim.cli import main

main()
