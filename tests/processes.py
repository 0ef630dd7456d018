"""Which processes there are below one."""

from __future__ import annotations

import subprocess


def below(process: int) -> list[int]:
    """Give the processes that a process started, and those that these did."""
    found: list[int] = []
    some = [process]
    while some:
        numbers = ",".join(map(str, some))
        told = subprocess.run(["pgrep", "-P", numbers], capture_output=True, text=True, check=False).stdout
        found += (some := [int(number) for number in told.split()])
    return found
