"""`python -m resim`."""

from resim.cli import main

main()
